"""Mutates files of every kind, and holds each reader to a result or one clear line: no traceback, hang or flood."""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scenarios.document import BadInput
from scenarios.field.export import export
from scenarios.field.live_log import next_due, open_live, read_more
from scenarios.field.read import read_log
from scenarios.field.scan_file import read_scan
from scenarios.field.spool import read_spool
from scenarios.field.told import Told
from scenarios.load import load_scenario
from sensor_model.recording import BadRecording, open_recording, read_frame, write_frame_list

LONGEST_S, MOST_MB = 2.0, 1500
FRAMES, LONGER_S = 3, 0.3  # of the log that is mutated, and how much longer its other tables are
PICTURE_PX = 64, 64
SCENARIO = """name: fuzzed
why: A pit.
pipe:
  standard: {material: PE, series: SDR 11, nominal_size_in: 6}
  features: [{kind: pit, distance_mm: 250, clock_deg: "5:00", diameter_mm: 20, depth_mm: 4, shape: conical}]
drive: {kind: gantry, stages: [{to_mm: 400}]}
"""
SPOOL = """name: fuzzed
inner_radius_mm: 76.2
inner_radius_u95_mm: 0.01
wall_thickness_mm: 7.5
axis_deg: [1.5, 2.0]
defects:
  - {name: A, distance_mm: 50, clock_deg: "3:00", length_mm: 40, length_u95_mm: 0.05, width_mm: 30,
     width_u95_mm: 0.05, depth_mm: 3, depth_u95_mm: 0.02}
"""
Rng = np.random.Generator
SIZE = dict(zip(("height_px", "width_px"), PICTURE_PX, strict=True))
RIG = load_scenario("paper-robot").rig
SMALL_RIG = RIG.model_copy(update={"camera": RIG.camera.model_copy(update=SIZE)})
INTERESTING = (
    b"\x00",
    b"\xff" * 8,
    b"-1",
    b"1e999",
    b"nan",
    b"\n",
    b",",
    b"9" * 30,
    b"\x89PNG",
    b"#",
    b"../",
    b"*a",
    b"&a",
    b"!!python",
)


def mutated(data: bytes, rng: Rng) -> bytes:
    """Some bytes changed, cut out, doubled, swapped or replaced by what often breaks a reader."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(0, max(len(out), 1)))
        length = int(min(rng.geometric(0.05), len(out) - at)) if out else 0
        match int(rng.integers(0, 6)):
            case 0 if out:
                out[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                out[at : at + length] = bytes(rng.integers(0, 256, length, dtype=np.uint8))
            case 4:
                out[at:at] = INTERESTING[int(rng.integers(0, len(INTERESTING)))]
            case 5:
                del out[at:]
    return bytes(out)


def mutate(log: Path, rng: Rng) -> None:
    """Mutate one of a log's files, the small ones as often as the large."""
    files = sorted(file for file in ([log] if log.is_file() else log.rglob("*")) if file.is_file())
    file = files[int(rng.integers(0, len(files)))]
    data = mutated(file.read_bytes(), rng)
    file.unlink()  # the sound log's own is linked here
    file.write_bytes(summed(data) if rng.random() < 0.5 else data)


def summed(data: bytes) -> bytes:
    """A PNG's checksums made right again, so that what was changed is looked at; anything else as it is."""
    if not data.startswith(b"\x89PNG"):
        return data
    out, at = data[:8], 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        body = data[at + 4 : at + 8 + size]
        out += data[at : at + 4] + body + struct.pack(">I", zlib.crc32(body))
        at += 12 + size
    return out


def by_reader(log: Path, work: Path) -> None:
    """The log as a recording, and every frame of it."""
    recording, _ = read_log(log, Told(), work, lambda *_: None)
    for index in range(len(recording)):
        recording[index]


def by_live(log: Path, _: Path) -> None:
    """The log as it is followed."""
    live = open_live(log)
    if live is None:
        raise BadInput(["nothing to follow"])
    while read_more(live):
        pass
    while next_due(live, at_end=True) is not None:
        pass


def by_picture(file: Path, _: Path) -> None:
    """A frame's picture, of a small camera."""
    read_frame(file, SMALL_RIG)


def short(recording: Path, target: Path) -> Path:
    """The first frames of a log, and little more of its other tables."""
    shutil.copytree(recording, target)
    opened = open_recording(recording)
    last_ns = int(opened.frame_stamps_ns[FRAMES - 1] + LONGER_S * 1e9)
    for file in opened.frame_files[FRAMES:]:
        (target / file).unlink()
    write_frame_list(target, opened.frame_stamps_ns[:FRAMES], Path(opened.frame_files[0]).suffix)
    for name in ("imu0", "orientation0", "encoders0"):
        table = target / name / "data.csv"
        header, *lines = table.read_text().splitlines()
        kept = [line for line in lines if int(line.split(",")[0]) <= last_ns]
        table.write_text("\n".join([header, *kept]) + "\n")
    return target


def sound_logs(
    recording: Path, video: Path | None, folder: Path
) -> dict[str, tuple[Path, Callable[[Path, Path], object]]]:
    """One of each kind."""
    recording = short(recording, folder / "short")
    logs = {"recording": (recording, by_reader), "live": (recording, by_live), **sound_files(folder)}
    for to in ("mcap", "rosbag2"):
        logs[to] = (export(recording, to, folder / f"log.{to}")[0], by_reader)
    if video is not None:
        logs["video"] = (export(video, "video", folder / "video")[0], by_reader)
    return logs


def sound_files(folder: Path) -> dict[str, tuple[Path, Callable[[Path, Path], object]]]:
    """A picture, a scan in either form, a scenario and a spool."""
    import cv2

    rng = np.random.default_rng(0)
    picture = folder / "picture.png"
    cv2.imwrite(str(picture), rng.integers(0, 256, (*PICTURE_PX, 3), dtype=np.uint8))
    theta, z = np.arange(0.5, 360) * np.pi / 180, np.arange(0.5, 20)
    radius = 76 + 0.1 * rng.random((theta.size, z.size))
    np.savez(folder / "scan.npz", theta_rad=theta, z_mm=z, radius_mm=radius)
    t, along = np.meshgrid(theta, z, indexing="ij")
    rows = np.stack([radius * np.sin(t), -radius * np.cos(t), along], axis=-1).reshape(-1, 3)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    (folder / "scan.ply").write_bytes(head.encode() + rows.astype("<f4").tobytes())
    (folder / "scenario.yaml").write_text(SCENARIO)
    (folder / "spool.yaml").write_text(SPOOL)
    return {
        "picture": (picture, by_picture),
        "scan.npz": (folder / "scan.npz", lambda file, _: read_scan(file, file.name)),
        "scan.ply": (folder / "scan.ply", lambda file, _: read_scan(file, file.name)),
        "scenario": (folder / "scenario.yaml", lambda file, _: load_scenario(str(file))),
        "spool": (folder / "spool.yaml", lambda file, _: read_spool(file)),
    }


def one_case(log: Path, read: Callable[[Path, Path], object], folder: Path, rng: Rng) -> str:
    """Read one mutated log; what became of it."""
    target = folder / f"case{log.suffix}"
    os.link(log, target) if log.is_file() else shutil.copytree(log, target, copy_function=os.link)
    mutate(target, rng)
    signal.setitimer(signal.ITIMER_REAL, 5 * LONGEST_S)
    began = time.process_time()
    try:
        read(target, folder / "work")
        what = "read"
    except (BadInput, BadRecording) as error:
        what = "refused" if str(error).strip() else "refused without a word"
    except TimeoutError:
        what = "HANGS"
    except Exception:
        traceback.print_exc()
        what = "TRACEBACK"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return "SLOW" if time.process_time() - began > LONGEST_S else what


def fuzz(recording: Path, video: Path | None, cases: int, seed: int, only: str = "") -> dict[str, Counter[str]]:
    """So many cases of every kind of file, or of those whose name holds a text."""

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    tally: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (log, read) in sound_logs(recording, video, Path(folder)).items():
            if only not in name:
                continue
            read(log, Path(folder) / f"sound {name}")  # or nothing would be said of those that are not
            tally[name], began = Counter(), time.process_time()
            for case in range(cases):
                with tempfile.TemporaryDirectory(dir=folder) as own:
                    what = one_case(log, read, Path(own), np.random.default_rng([seed, case, len(name)]))
                tally[name][what] += 1
                if what not in ("read", "refused"):
                    print(f"{what}: {name}, seed {seed}, case {case}", flush=True)
            each_ms = 1e3 * (time.process_time() - began) / cases
            counts = ", ".join(f"{what} {n}" for what, n in sorted(tally[name].items()))
            print(f"{name:<10} {counts}; {each_ms:.1f} ms each", flush=True)
    return tally


def main() -> None:
    """Every kind of log; a bad end is an exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="a recording of slit pixels")
    parser.add_argument("--video", type=Path, help="a short recording of pictures")
    parser.add_argument("--cases", type=int, default=10_000, help="of every kind")
    parser.add_argument("--seed", type=int, default=0, help="another gives other cases")
    parser.add_argument("--only", default="", help="kinds that hold this text")
    given = parser.parse_args()
    open_recording(given.recording)
    tally = fuzz(given.recording, given.video, given.cases, given.seed, given.only)
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{sum(counts.total() for counts in tally.values())} cases, at most {memory_mb:.0f} MB")
    bad = sum(n for counts in tally.values() for what, n in counts.items() if what not in ("read", "refused"))
    sys.exit(bool(bad) or memory_mb > MOST_MB)


if __name__ == "__main__":
    main()
