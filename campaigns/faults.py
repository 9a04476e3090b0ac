"""Puts faults of 50 kinds into logs: is each named by the log's health, harmless, or silently wrong."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scenarios.document import BadInput
from scenarios.field.read import read_log
from scenarios.field.replay import Replay, measure, method_of
from scenarios.field.told import Told
from scenarios.load import load_scenario
from scenarios.report.comparison import pose_std
from scenarios.scenario import nominal_pipe, nominal_rig
from sensor_model.recording import NominalPipe
from sensor_model.rig import Rig, load_settings, save_settings
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate

POINTS = (
    "sensing.fidelity=points",
    "sensing.frame_rate_hz=10",
    "pipe.features=[{kind: pocket, distance_mm: 220, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]",
    "drive.stages=[{to_mm: 200}]",
)
PICTURES = (POINTS[2], "drive.stages=[{to_mm: 160}]", "sensing.fidelity=raycast", "sensing.frame_rate_hz=8")
HARMLESS_SIGMAS = 3.0
Rng = np.random.Generator


class Fault(NamedTuple):
    """One kind of fault: what it does to a recording's folder, and the findings that name it (or a refusal)."""

    do: Callable[[Path, Rng], None]
    named_by: tuple[str, ...]
    pictures: bool = False


def rows(folder: Path, sensor: str) -> tuple[str, np.ndarray, list[list[str]]]:
    """Header, stamps and fields of one log."""
    lines = (folder / sensor / "data.csv").read_text().splitlines()
    split = [line.split(",") for line in lines[1:]]
    return lines[0], np.array([int(row[0]) for row in split]), [row[1:] for row in split]


def put(folder: Path, sensor: str, header: str, stamps: np.ndarray, fields: list[list[str]]) -> None:
    """Write one log; its old file may be linked to from elsewhere."""
    lines = [",".join([str(stamp), *row]) for stamp, row in zip(stamps.tolist(), fields, strict=True)]
    file = folder / sensor / "data.csv"
    file.unlink()
    file.write_text("\n".join([header, *lines]) + "\n")


def numbers(
    folder: Path, sensor: str, change: Callable[[np.ndarray, np.ndarray], np.ndarray], form: str = "%.9g"
) -> None:
    """Change one log's numbers: `change(time from 0 to 1, values)`."""
    header, stamps, fields = rows(folder, sensor)
    share = (stamps - stamps[0]) / (stamps[-1] - stamps[0])
    values = change(share, np.array(fields, dtype=float))
    put(folder, sensor, header, stamps, [[form % value for value in row] for row in values])


def without(folder: Path, sensors: tuple[str, ...], begin: float, end: float) -> None:
    """Cut a stretch of time out of logs."""
    for sensor in sensors:
        header, stamps, fields = rows(folder, sensor)
        share = (stamps - stamps[0]) / (stamps[-1] - stamps[0])
        kept = (share < begin) | (share > end)
        put(folder, sensor, header, stamps[kept], [row for row, keep in zip(fields, kept, strict=True) if keep])


def shifted(folder: Path, sensors: tuple[str, ...], from_share: float, by_s: float) -> None:
    """Have a clock jump."""
    for sensor in sensors:
        header, stamps, fields = rows(folder, sensor)
        share = (stamps - stamps[0]) / (stamps[-1] - stamps[0])
        put(folder, sensor, header, stamps + np.where(share > from_share, round(by_s * 1e9), 0), fields)


ALL = ("imu0", "orientation0", "encoders0", "cam0")


def counts(change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Callable[[Path, Rng], None]:
    """A fault of the encoders."""
    return lambda folder, _: numbers(folder, "encoders0", change, "%d")


def imu(change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Callable[[Path, Rng], None]:
    """A fault of the IMU."""
    return lambda folder, _: numbers(folder, "imu0", change)


def rig(**changes: Callable[[dict], None]) -> Callable[[Path, Rng], None]:
    """A rig that is not the sensor's."""

    def do(folder: Path, _: Rng) -> None:
        told = load_settings(Rig, folder / "rig.yaml").model_dump(mode="json")
        for part, change in changes.items():
            change(told[part])
        save_settings(Rig.model_validate(told), folder / "rig.yaml")

    return do


def wider(projector: dict, by_deg: float) -> None:
    """All slits turned outward."""
    for slit in projector["slits"]:
        slit["half_angle_deg"] += by_deg
    projector["outer_half_angle_deg"] += by_deg


def pipe(scale: float) -> Callable[[Path, Rng], None]:
    """A pipe told of another size."""

    def do(folder: Path, _: Rng) -> None:
        told = load_settings(NominalPipe, folder / "pipe.yaml")
        save_settings(told.model_copy(update={"inner_radius_mm": scale * told.inner_radius_mm}), folder / "pipe.yaml")

    return do


def frames(folder: Path) -> list[Path]:
    """The frames' files in order."""
    return sorted((folder / "cam0" / "data").iterdir(), key=lambda file: int(file.stem))


def replaced(file: Path, data: bytes) -> None:
    """New content under an old name."""
    file.unlink()
    file.write_bytes(data)


def repeated(begin: float, end: float) -> Callable[[Path, Rng], None]:
    """The camera hangs: a stretch of frames shows what the first of them showed."""

    def do(folder: Path, _: Rng) -> None:
        every = frames(folder)
        stretch = every[int(begin * len(every)) : max(int(end * len(every)), int(begin * len(every)) + 2)]
        for file in stretch[1:]:
            replaced(file, stretch[0].read_bytes())

    return do


def dropped(folder: Path, rng: Rng) -> None:
    """A fifth of the frames is lost."""
    header, stamps, fields = rows(folder, "cam0")
    kept = np.append(True, rng.random(stamps.size - 1) > 0.2)
    put(folder, "cam0", header, stamps[kept], [row for row, keep in zip(fields, kept, strict=True) if keep])


def jittered(folder: Path, rng: Rng) -> None:
    """Stamps made on arrival."""
    header, stamps, fields = rows(folder, "cam0")
    step = np.median(np.diff(stamps))
    late = (rng.random(stamps.size) * 0.8 * step).astype(np.int64)
    put(folder, "cam0", header, np.minimum(stamps + late, stamps[-1] + np.arange(-stamps.size, 0)), fields)


def missing(folder: Path, rng: Rng) -> None:
    """A frame's file is gone."""
    frames(folder)[int(rng.integers(1, 5))].unlink()


def garbled(folder: Path, rng: Rng) -> None:
    """A line that was written by two."""
    file = folder / "imu0" / "data.csv"
    lines = file.read_text().splitlines()
    k = int(rng.integers(5, len(lines)))
    lines[k] = lines[k][:25] + lines[k - 1]
    replaced(file, "\n".join(lines).encode())


def microseconds(folder: Path, _: Rng) -> None:
    """The camera's stamps are in another unit."""
    header, stamps, fields = rows(folder, "cam0")
    put(folder, "cam0", header, stamps // 1000, fields)


def painted(paint: Callable[[np.ndarray, float, Rng], np.ndarray]) -> Callable[[Path, Rng], None]:
    """Change every picture: `paint(rgb, time from 0 to 1, rng)`."""

    def do(folder: Path, rng: Rng) -> None:
        import cv2

        every = frames(folder)
        for k, file in enumerate(every):
            rgb = cv2.imread(str(file), cv2.IMREAD_COLOR_RGB)
            new = paint(rgb, k / max(len(every) - 1, 1), rng)
            if new is not rgb:
                replaced(file, cv2.imencode(".png", np.ascontiguousarray(new[:, :, ::-1]))[1].tobytes())

    return do


def polar(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radius (px) from the picture's middle, and angle (degrees, clockwise from the top), of every pixel."""
    y, x = np.mgrid[: rgb.shape[0], : rgb.shape[1]] - np.array([rgb.shape[0] / 2, rgb.shape[1] / 2])[:, None, None]
    return np.hypot(x, y), np.degrees(np.arctan2(x, -y)) % 360


def smudge(rgb: np.ndarray, _: float, __: Rng) -> np.ndarray:
    """A drop on the lens: blurred and pale between 3 and 5 o'clock."""
    import cv2

    _, angle = polar(rgb)
    blurred = cv2.GaussianBlur(rgb, (0, 0), 25)
    return np.where(((angle > 90) & (angle < 150))[:, :, None], blurred // 2 + 60, rgb).astype(np.uint8)


def half_dark(rgb: np.ndarray, _: float, __: Rng) -> np.ndarray:
    """The projector's outer half fails."""
    radius, _ = polar(rgb)
    return np.where((radius > 330)[:, :, None], rgb // 16, rgb).astype(np.uint8)


def water(rgb: np.ndarray, _: float, __: Rng) -> np.ndarray:
    """A level of water: below it the picture is its own mirror image, darker."""
    line = int(rgb.shape[0] * 0.72)
    out = rgb.copy()
    height = rgb.shape[0] - line
    out[line:] = rgb[line - height : line][::-1] // 2
    return out


def truncated(share: float) -> Callable[[Path, Rng], None]:
    """Pictures that end too early."""

    def do(folder: Path, rng: Rng) -> None:
        every = frames(folder)
        for k in sorted(rng.choice(np.arange(1, len(every)), max(int(share * len(every)), 1), replace=False).tolist()):
            replaced(every[k], every[k].read_bytes()[: every[k].stat().st_size // 3])

    return do


def noise(rgb: np.ndarray, _: float, rng: Rng) -> np.ndarray:
    """A room, not a pipe."""
    import cv2

    small = rng.integers(0, 256, (rgb.shape[0] // 16, rgb.shape[1] // 16, 3), dtype=np.uint8)
    return cv2.resize(small, rgb.shape[1::-1], interpolation=cv2.INTER_CUBIC)


GAPS, STILL = ("gaps and jumps",), ("dead wheels", "agreement")
FAULTS: dict[str, Fault] = {
    "gap in the IMU": Fault(lambda f, _: without(f, ("imu0", "orientation0"), 0.4, 0.75), GAPS),
    "gap in the encoders": Fault(lambda f, _: without(f, ("encoders0",), 0.4, 0.7), GAPS),
    "gap in the camera": Fault(lambda f, _: without(f, ("cam0",), 0.4, 0.7), (*GAPS, "dropped frames")),
    "gap in all logs": Fault(lambda f, _: without(f, ALL, 0.4, 0.7), GAPS),
    "clock jumps forward": Fault(lambda f, _: shifted(f, ALL, 0.5, 2.0), GAPS),
    "clock jumps back": Fault(lambda f, _: shifted(f, ALL, 0.5, -0.5), ()),
    "camera's clock jumps forward": Fault(
        lambda f, _: shifted(f, ("cam0",), 0.5, 0.15), ("dropped frames", "uneven stamps")
    ),
    "encoders' clock jumps forward": Fault(lambda f, _: shifted(f, ("encoders0",), 0.5, 0.4), GAPS),
    "stamps in microseconds": Fault(microseconds, ("coverage", "rates")),
    "jittered stamps": Fault(jittered, ("uneven stamps",)),
    "a fifth of the frames dropped": Fault(dropped, ("dropped frames",)),
    "a frame repeated": Fault(repeated(0.5, 0.5), ("repeated frames",)),
    "camera frozen": Fault(repeated(0.5, 1.0), ("repeated frames",)),
    "a frame's file is missing": Fault(missing, ("unreadable frames",)),
    "a garbled line": Fault(garbled, ()),
    "IMU's axes y and z swapped": Fault(imu(lambda _, v: v[:, [0, 2, 1, 3, 5, 4]]), ("axes",)),
    "IMU's axes x and y swapped": Fault(imu(lambda _, v: v[:, [1, 0, 2, 4, 3, 5]]), ("axes",)),
    "forces in g": Fault(imu(lambda _, v: v / [1, 1, 1, 9.80665, 9.80665, 9.80665]), ("gravity",)),
    "rates in degrees/s": Fault(imu(lambda _, v: v * [57.3, 57.3, 57.3, 1, 1, 1]), ("gyroscope",)),
    "IMU stuck": Fault(imu(lambda t, v: np.where((t < 0.5)[:, None], v, v[len(v) // 2])), ("stuck axes",)),
    "accelerometer saturated": Fault(imu(lambda _, v: np.clip(v, -9.7, 9.7)), ("saturation",)),
    "quaternions in the other order": Fault(
        lambda f, _: numbers(f, "orientation0", lambda _, q: q[:, [1, 2, 3, 0]]), ("axes",)
    ),
    "encoder reset": Fault(
        counts(lambda t, n: np.where((t < 0.5)[:, None], n, n - n[len(n) // 2])), ("resets and jumps",)
    ),
    "one encoder reset": Fault(
        counts(lambda t, n: np.where((t < 0.5)[:, None] | [False, True, True], n, n - n[len(n) // 2])),
        ("resets and jumps",),
    ),
    "encoder overflow": Fault(counts(lambda _, n: (n + 2**16 - 9000) % 2**16), ("resets and jumps",)),
    "encoder overflow of 32 bits": Fault(
        counts(lambda t, n: np.where((t < 0.5)[:, None], n, n + 2**32)), ("resets and jumps",)
    ),
    "a dead encoder": Fault(counts(lambda _, n: n * [1, 0, 1]), STILL),
    "an encoder dies halfway": Fault(
        counts(lambda t, n: np.where((t < 0.5)[:, None] | [True, False, True], n, n[len(n) // 2])), STILL
    ),
    "all encoders dead": Fault(counts(lambda _, n: n * 0), ("travel",)),
    "a wheel reversed": Fault(counts(lambda _, n: n * [1, -1, 1]), ("direction",)),
    "all wheels reversed": Fault(counts(lambda _, n: -n), ("way by the wheels",)),
    "a wheel of another diameter": Fault(counts(lambda _, n: n * [1, 1.1, 1]), STILL),
    "all wheels 5 % off": Fault(counts(lambda _, n: n * 1.05), ("way by the wheels",)),
    "pipe told 4 % too wide": Fault(pipe(1.04), ("pipe's diameter",)),
    "rig: slits 0.4 degrees off": Fault(rig(projector=lambda p: wider(p, 0.4)), ("agreement", "pipe's diameter")),
    "rig: apex 2 mm off": Fault(
        rig(projector=lambda p: p.update(apex_mm=[0, 0, -51])), ("agreement", "pipe's diameter")
    ),
    "rig: focal length 1 % off": Fault(
        rig(camera=lambda c: c.update(fx_px=c["fx_px"] * 1.01)), ("agreement", "pipe's diameter", "scatter")
    ),
    "picture truncated": Fault(truncated(0.05), ("unreadable frames",), True),
    "pictures of another size": Fault(painted(lambda p, *_: p[::2, ::2]), ("unreadable frames",), True),
    "red and blue swapped": Fault(painted(lambda p, *_: p[:, :, ::-1]), ("colours",), True),
    "over-exposed": Fault(
        painted(lambda p, *_: np.minimum(p.astype(np.uint16) * 3, 255).astype(np.uint8)), ("exposure",), True
    ),
    "under-exposed": Fault(painted(lambda p, *_: p // 20), ("exposure", "decode yield"), True),
    "flickering lamp": Fault(
        painted(lambda p, _, r: p // 8 if r.random() < 0.3 else p), ("even light", "decode yield"), True
    ),
    "a drop on the lens": Fault(painted(smudge), ("blind sectors", "decode yield"), True),
    "the outer rings dark": Fault(painted(half_dark), ("slits", "decode yield"), True),
    "half of every picture dark": Fault(
        painted(lambda p, *_: np.where((polar(p)[1] > 180)[:, :, None], p // 16, p)), ("blind sectors",), True
    ),
    "a level of water": Fault(painted(water), ("wall standing in", "blind sectors", "decode yield", "scatter"), True),
    "the pipe ends": Fault(
        painted(lambda p, t, _: p // 30 if t > 0.6 else p), ("even light", "decode yield", "registration"), True
    ),
    "no pipe at all": Fault(painted(noise), ("registration", "decode yield"), True),
    "pictures mirrored": Fault(painted(lambda p, *_: p[:, ::-1]), ("agreement", "scatter"), True),
    "pictures upside down": Fault(painted(lambda p, *_: p[::-1, ::-1]), ("blind sectors",), True),
}


def write_base(folder: Path, seed: int, pictures: bool) -> Path:
    """A sound log past one pocket."""
    scenario = load_scenario("paper-gantry", list(PICTURES if pictures else POINTS), seed)
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(seed, "drive"))
    list(sense(truth, scenario.rig, nominal_rig(scenario), nominal_pipe(scenario), scenario.sensing, seed, folder))
    return folder


def replayed(log: Path, work: Path) -> Replay:
    """Measured, without folder or page."""
    work.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir=work)) / "recording"  # a process opens a folder once, so each needs its own
    recording, remarks = read_log(log, Told(), folder, lambda *_: None)
    return measure(recording, method_of(log), remarks, 1, {}, lambda *_: None)


def outcome(fault: Fault, log: Path, sound: Replay, work: Path) -> tuple[str, str]:
    """What became of a faulty log: refused, named, harmless, or silently wrong; and the words."""
    try:
        result = replayed(log, work)
    except BadInput as error:
        return "refused", error.lines[0].split("/")[-1][:110]
    said = [one for one in result.health.findings if one.verdict != "good"]
    words = "; ".join(f"{one.name}: {one.says}" for one in said if one.name in fault.named_by) or "; ".join(
        one.name for one in said
    )
    if any(one.name in fault.named_by for one in said):
        return "named", words[:110]
    why = difference(result, sound)
    if not why:
        return "harmless", words[:110]
    return ("named otherwise" if any(one.verdict == "bad" for one in said) else "SILENTLY WRONG"), f"{why}; {words}"[
        :110
    ]


def difference(result: Replay, sound: Replay) -> str:
    """In what a result differs from the sound log's by more than both state; empty: in nothing."""
    if result.found is None or sound.found is None:
        return "no reconstruction"
    if len(result.found.defects) != len(sound.found.defects):
        return f"{len(result.found.defects)} defects for {len(sound.found.defects)}"
    for one, other in zip(result.found.defects, sound.found.defects, strict=True):
        z_std = np.hypot(*(pose_std(r.found.trajectory, d.distance_mm)[0] for r, d in ((result, one), (sound, other))))
        for name, std in (("length_mm", "length_std_mm"), ("width_mm", "width_std_mm"), ("depth_mm", "depth_std_mm")):
            off, stated = getattr(one, name) - getattr(other, name), np.hypot(getattr(one, std), getattr(other, std))
            if abs(off) > HARMLESS_SIGMAS * stated:
                return f"{name} off by {off:.2f}, stated {stated:.2f}"
        place = np.hypot(z_std, np.hypot(one.length_std_mm, other.length_std_mm) / 2)
        if abs(one.distance_mm - other.distance_mm) > HARMLESS_SIGMAS * place:
            return f"distance off by {one.distance_mm - other.distance_mm:.2f} mm, stated {place:.2f}"
    return ""


def main() -> None:
    """Every kind over some seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", default="", help="kinds that hold this text")
    parser.add_argument("--of", choices=("points", "pictures", "both"), default="both")
    given = parser.parse_args()
    wrong, tally = 0, {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.seeds):
            for pictures in {"points": (False,), "pictures": (True,), "both": (False, True)}[given.of]:
                chosen = {n: f for n, f in FAULTS.items() if f.pictures == pictures and given.only in n}
                if not chosen:
                    continue
                base = write_base(Path(folder) / f"base-{seed}-{pictures}", seed, pictures)
                sound = replayed(base, Path(folder) / "work")
                print(
                    f"seed {seed}, the sound log: {sound.health.verdict}",
                    [o.name for o in sound.health.findings if o.verdict != "good"],
                )
                for k, (name, fault) in enumerate(chosen.items()):
                    log = Path(folder) / "faulty"
                    shutil.rmtree(log, ignore_errors=True)
                    shutil.copytree(base, log)
                    fault.do(log, np.random.default_rng([seed, k]))
                    what, words = outcome(fault, log, sound, Path(folder) / "work")
                    tally.setdefault(name, []).append(what)
                    wrong += what == "SILENTLY WRONG"
                    shutil.rmtree(Path(folder) / "work")
                    print(f"{what:<16} {name:<34} {words}", flush=True)
    print(f"{len(tally)} kinds, {sum(map(len, tally.values()))} logs, {wrong} silently wrong")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
