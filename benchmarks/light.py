"""What each thing that light goes through or falls on does to a short scan of one pocket: a table, a contact sheet."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from algorithms.calibration.pipe_view import fit_cylinder, radial_mm
from algorithms.reconstruct import ReconstructionFailed, finish, see
from algorithms.triangulate import triangulate
from algorithms.types import WallMap
from scenarios.bench.behind_glass import calibrate_behind_glass
from scenarios.bench.calibrated import BoardSession
from scenarios.load import load_scenario
from scenarios.run import fold, sensed
from scenarios.scenario import Scenario
from scenarios.score import score
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import open_recording
from sensor_model.rig import preset_rig
from sensor_model.sense import write_frame
from sensor_model.streams import stream
from twin.pipe import Pipe
from twin.simulate import simulate

SCAN = (
    "pipe.end_mm=500",
    "pipe.features=[{kind: pocket, distance_mm: 205, clock_deg: '4:00', length_mm: 70, width_mm: 35, depth_mm: 5}]",
    "drive.stages=[{to_mm: 175}]",
    "sensing.frame_rate_hz=6",
)
TUBE = "sensing.optics.glass={thickness_mm: 1.5}"
LEANING = "sensing.optics.glass={thickness_mm: 1.5, offset_mm: [0.5, 0], tilt_deg: [0.5, 0]}"
SLANTED = "sensing.optics.glass={thickness_mm: 1.5, offset_mm: [0.5, -0.3], tilt_deg: [0.5, 0.3]}"
FAR_OFF, OFF = "drive.offset_mm=[14, -10]", "drive.offset_mm=[8, -6]"
FOCUS_MM = "107.8"  # of the bore at 45 degrees
SEEN_FROM_MM = 62.0
CROP, BELOW = (slice(480, 880), slice(780, 1180)), (slice(532, 1232), slice(480, 1180))  # about the pocket, the water
TILE_PX, COLUMNS = 176, 7
BESIDE_MM, BESIDE_RAD = 15.0, 0.4  # of the pocket, which the radius of the bare wall leaves out


class Case(NamedTuple):
    """A row of the table: what is set, whether the rig is calibrated through the glass first, and what is shown."""

    name: str
    changes: tuple[str, ...] = ()
    calibrated: bool = False
    crop: tuple[slice, slice] = CROP


def optics(**values: str) -> tuple[str, ...]:
    """Settings of the optics, dots written as double underscores."""
    return tuple(f"sensing.optics.{name.replace('__', '.')}={value}" for name, value in values.items())


CASES = (
    Case("as it is"),
    Case("glass tube 1.5 mm, ignored", (TUBE,)),
    Case("glass tube without its ghosts", (TUBE, *optics(glass__ghost="0"))),
    Case("glass tube 0.5 mm off, 0.5 deg tilted", (LEANING,)),
    Case("glass tube 1.5 mm, calibrated", (TUBE,), calibrated=True),
    Case("white PVC", optics(wall="white-pvc")),
    Case("yellow PE", optics(wall="yellow-pe")),
    Case("yellow PE, exposed 3 x longer", optics(wall="yellow-pe", exposure="4.2")),
    Case("tan PE", optics(wall="tan-pe")),
    Case("black PE", optics(wall="black-pe")),
    Case("black PE, exposed 10 x longer", optics(wall="black-pe", exposure="14")),
    Case("gloss 0.04 alone", optics(wall="{gloss: 0.04}")),
    Case("translucency 0.5 over 1 mm alone", optics(wall="{translucency: 0.5, translucency_mm: 1}")),
    Case("dust film, a fifth", optics(dirt__film="0.2")),
    Case("dust film, half", optics(dirt__film="0.5")),
    Case("smudge over the pocket", optics(dirt__smudge="0.9")),
    Case("condensation, a third", optics(dirt__drops="0.33")),
    Case("lamp at a third", optics(lamp_level="0.33")),
    Case("exposed 3 x longer", optics(exposure="4.2")),
    Case("17 mm off centre", (FAR_OFF,)),
    Case("17 mm off centre, 1/r2", (FAR_OFF, *optics(distance_power="2"))),
    Case("10 mm off centre", (OFF,)),
    Case("10 mm off centre, 1/r2", (OFF, *optics(distance_power="2"))),
    Case("10 mm off, defocus 3 px", (OFF, *optics(defocus_px="3"))),
    Case("10 mm off, by true distance", (OFF, *optics(defocus_px="3", focus_mm=FOCUS_MM))),
    Case("defocus 3 px", optics(defocus_px="3")),
    Case("water 5 mm deep", optics(water__depth_mm="5"), crop=BELOW),
    Case("water 15 mm deep", optics(water__depth_mm="15"), crop=BELOW),
    Case("water 30 mm, over half the pocket", optics(water__depth_mm="30"), crop=BELOW),
    Case("daylight at 420 mm", ("pipe.end_mm=420", *optics(daylight__level="1"))),
    Case("daylight at 420 mm, flickering", ("pipe.end_mm=420", *optics(daylight="{level: 1, flicker: 0.8}"))),
    Case("colour filter", optics(processing__color_filter="true")),
    Case("filter, denoised, sharpened", optics(processing="{color_filter: true, denoise_levels: 20, sharpen: 1}")),
    Case("JPEG 75", optics(processing__jpeg_quality="75")),
    Case("JPEG 30", optics(processing__jpeg_quality="30")),
)  # fmt: skip
SESSIONS = {
    "without the tube": None,
    "through it, one apex": BoardSession(),
    "through it, an apex a slit": BoardSession(own_apex=True),
}
COLUMNS_OF_TABLE = "| setting | yield | wrong words % | pocket | depth mm | length mm | radius bias mm | map RMS mm |"


def scenario_of(case: Case, fidelity: str, seed: int = 0) -> Scenario:
    """The scan with a case's settings."""
    scenario = load_scenario("paper-gantry", [*SCAN, f"sensing.fidelity={fidelity}", *case.changes], seed)
    if not case.calibrated:
        return scenario
    session = SESSIONS["through it, an apex a slit"]
    rig = calibrate_behind_glass(scenario.rig, scenario.sensing.optics.glass, seed, session).rig
    return scenario.model_copy(update={"rig": rig, "true_rig": scenario.rig})


def row_of(case: Case, fidelity: str) -> str:
    """One line of the table: the scan driven, drawn, decoded, mapped, sized and scored."""
    scenario = scenario_of(case, fidelity)
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(0, "drive"))
    with tempfile.TemporaryDirectory() as folder:
        sensed(scenario, truth, Path(folder), 1, {}, lambda *_: None)
        recording = open_recording(Path(folder))
        try:
            slits = (see(recording[i], recording.rig, scenario.method) for i in range(len(recording)))
            state, tally = fold(scenario, truth, recording, slits)
            reconstruction = finish(state)
        except ReconstructionFailed as error:
            return f"| {case.name} | no result: {error} | | | | | | |"
    found, bias = asdict(score(reconstruction, truth, tally)), radius_bias_mm(scenario, reconstruction.wall)
    return (
        f"| {case.name} | {found['decode_yield']:.3f} | {100 * found['wrong_words']:.2f} | "
        f"{'found' if found['defects_found'] else 'missed'}{more(found['false_calls'])} | "
        f"{signed(found['depth_bias_mm'])} | {signed(found['length_error_mm_max'])} | {signed(bias)} | "
        f"{signed(found['map_rms_mm']).lstrip('+')} |"
    )


def more(false_calls: int) -> str:
    """The false calls, if any."""
    return f", {false_calls} false" if false_calls else ""


def signed(value: float | None) -> str:
    """A figure, or a dash for none."""
    return "-" if value is None else f"{value:+.3f}"


def radius_bias_mm(scenario: Scenario, wall: WallMap) -> float | None:
    """How far the map of the bare wall lies off its radius, on average; None for no map."""
    radius, theta, z = wall.radius_mm, wall.theta_rad, wall.z_mm
    (pocket,) = scenario.pipe.features
    turn = np.abs(np.mod(theta - np.radians(pocket.clock_deg) + np.pi, 2 * np.pi) - np.pi)
    beside = (turn[:, None] > BESIDE_RAD) | (np.abs(z - pocket.distance_mm) > pocket.length_mm / 2 + BESIDE_MM)[None, :]
    seen = radius[beside][np.isfinite(radius[beside])]
    return float(seen.mean() - scenario.pipe.bore_radius_mm) if seen.size else None


def tile(case: Case, fidelity: str) -> np.ndarray:
    """A crop of one picture, with its name."""
    scenario = scenario_of(case._replace(calibrated=False), fidelity)
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, np.random.default_rng(0))
    stamp_s = SEEN_FROM_MM / scenario.drive.speed_mm_s
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frame.png"
        write_frame(scenario.pipe, truth.pose_at(np.array([stamp_s])), scenario.rig, scenario.sensing, 0, 0, file)
        picture = cv2.imread(str(file))
    crop = cv2.resize(picture[case.crop], (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA)
    label = np.full((30, TILE_PX, 3), 255, dtype=np.uint8)
    words, lines = (
        case.name.replace("the same", "glass" if "ghost" in case.name or "tilted" in case.name else "light"),
        [],
    )
    for word in words.split():
        if lines and len(lines[-1]) + len(word) < 27:
            lines[-1] += " " + word
        else:
            lines.append(word)
    for k, line in enumerate(lines[:2]):
        cv2.putText(label, line, (3, 12 + 14 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.37, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([label, crop])


def sheet(cases: list[Case], fidelity: str) -> np.ndarray:
    """All crops side by side; a rig's calibration cannot be seen, and has none."""
    tiles = [tile(case, fidelity) for case in cases if not case.calibrated]
    while len(tiles) % COLUMNS:
        tiles.append(np.full_like(tiles[0], 255))
    padded = [cv2.copyMakeBorder(one, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255)) for one in tiles]
    return np.vstack([np.hstack(padded[k : k + COLUMNS]) for k in range(0, len(padded), COLUMNS)])


def glass_table() -> str:
    """Error of the radius that slit pixels without noise give behind 1.5 mm of glass, by calibration."""
    pipe, rig = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5), preset_rig()
    exact = PointNoise(pixel_noise_px=0, drop_out_share=0)
    lines = ["| tube | calibrated | radius mm | " + " | ".join(slit.name for slit in rig.projector.slits) + " |"]
    lines.append("| --- | --- | --- |" + " --- |" * len(rig.projector.slits))
    for tube, change in (("straight", TUBE), ("0.6 mm off, 0.6 deg tilted", SLANTED)):
        glass = load_scenario("paper-gantry", [change]).sensing.optics.glass
        seen = see_slits(pipe, np.eye(4), rig, exact, np.random.default_rng(0), glass)
        for name, session in SESSIONS.items():
            used = rig if session is None else calibrate_behind_glass(rig, glass, 0, session).rig
            points = triangulate(seen, used)
            found = fit_cylinder(points)
            off = radial_mm(points.xyz_mm, found) + found.radius_mm - pipe.bore_radius_mm
            by_slit = [f"{off[points.ring == slit].mean():+.3f}" for slit in range(len(rig.projector.slits))]
            lines.append(f"| {tube} | {name} | {found.radius_mm - pipe.bore_radius_mm:+.3f} | {' | '.join(by_slit)} |")
    return "\n".join(lines)


def main() -> None:
    """Print a table, or write the contact sheet."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--fidelity", choices=("picture", "raycast", "points"), default="picture")
    words.add_argument("--only", default="", help="rows whose name holds this word")
    words.add_argument("--glass", action="store_true", help="the radius behind glass, by how the rig is calibrated")
    words.add_argument("--sheet", type=Path, help="write the contact sheet (JPEG) here instead")
    asked = words.parse_args()
    cases = [case for case in CASES if asked.only in case.name]
    if asked.sheet is not None:
        cv2.imwrite(str(asked.sheet), sheet(cases, asked.fidelity), [cv2.IMWRITE_JPEG_QUALITY, 72])
        return
    if asked.glass:
        print(glass_table())
        return
    print(COLUMNS_OF_TABLE, "| --- | --- | --- | --- | --- | --- | --- | --- |", sep="\n")
    for case in cases:
        print(row_of(case, asked.fidelity), flush=True)


if __name__ == "__main__":
    main()
