"""Virtual artefacts, as optical metrology tests its instruments (VDI/VDE 2634, ISO 10360-13): gauges of known size."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from algorithms.reconstruct import begin, finish, step
from algorithms.registration.cylinder_map import CylinderMapSettings
from algorithms.types import Reconstruction
from scenarios.bench.calibrated import as_drawn, calibrate
from scenarios.bench.contenders import contenders
from scenarios.bench.scans import Scan, registered, take_scan, triangulated
from scenarios.load import load_scenario
from scenarios.matching import match
from scenarios.report.plain_rows import text_table, write_rows
from scenarios.run import provenance
from scenarios.run_folder import run_folder
from scenarios.scenario import Scenario
from sensor_model.geometry import apply, wall_angle_rad, wall_direction, wrap_rad
from sensor_model.rig import Rig
from twin.pipe import Pipe

Report = Callable[[str, int, int], None]
Row = dict[str, Any]

DIAMETER_LIMIT_MM = 0.05
STEPS_MM = (0.5, 1.0, 2.0, 4.0, 7.0)
FLOOR_SHARE = 0.5  # of a step's length and width, its middle: there is no edge, and the light gets there
# caps of balls, wide and flat enough for light and camera to see most of them; a hemisphere would hide its own floor
BALL_MOUTH_MM, BALL_DEPTH_MM = 30.0, 7.0
BALL_MM = (BALL_MOUTH_MM**2 / 4 + BALL_DEPTH_MM**2) / (2 * BALL_DEPTH_MM)  # its radius
BALL_PITS = ((220.0, 120.0), (420.0, 180.0))  # place along the pipe, and around it in degrees
BALL_DEEPER_MM, BALL_POINTS, BALL_SCALE_MM = 1.0, 30, 0.2
CENTER_MM = np.array([0.0, 0.0, BALL_DEPTH_MM - BALL_MM])  # on the unrolled wall: along, around, outward
RING = ["pipe.features=[]", "drive.stages=[{to_mm: 60, roll_to_deg: 30}]", "sensing.frame_rate_hz=10"]
STEP = ["drive.start_mm=60", "drive.stages=[{to_mm: 640}]"]
BALL = ["drive.start_mm=60", "drive.stages=[{to_mm: 400}]"]
COLUMNS = {
    "artefact": "artefact",
    "what": "what",
    "by": "by",
    "true_mm": "true mm",
    "error_mm": "error mm",
    "worst_mm": "worst mm",
    "scans": "scans",
    "missing": "not measured",
    "limit_mm": "limit mm",
}


def _steps() -> str:
    plan = "kind: pocket, clock_deg: 120, length_mm: 50, width_mm: 40"
    pockets = [f"{{{plan}, distance_mm: {250 + 110 * k}, depth_mm: {depth}}}" for k, depth in enumerate(STEPS_MM)]
    return f"pipe.features=[{', '.join(pockets)}]"


def _balls() -> str:
    pits = [
        f"{{kind: pit, distance_mm: {z}, clock_deg: {deg}, diameter_mm: {BALL_MOUTH_MM}, depth_mm: {BALL_DEPTH_MM}}}"
        for z, deg in BALL_PITS
    ]
    return f"pipe.features=[{', '.join(pits)}]"


def artefact_scenarios(fidelity: str, seed: int) -> dict[str, Scenario]:
    """Ring gauge, step gauge and ball-bar in the gantry's pipe, seen off centre and tilted."""
    every = {"ring gauge": RING, "step gauge": [_steps(), *STEP], "ball-bar": [_balls(), *BALL]}
    return {
        name: load_scenario("paper-gantry", [*changes, f"sensing.fidelity={fidelity}"], seed)
        for name, changes in every.items()
    }


def measure_artefacts(fidelity: str, seeds: int, workers: int, progress: Report) -> list[Row]:
    """A row for each thing measured: its mean error over scans with other noise, and the worst."""
    errors: dict[tuple[str, str, str], list[float]] = {}
    true_mm: dict[tuple[str, str, str], float] = {}
    for seed in range(seeds):
        for name, scenario in artefact_scenarios(fidelity, seed).items():
            scan = take_scan(scenario, workers, progress)
            for (what, by), (true, error) in MEASURES[name](scan, progress).items():
                errors.setdefault((name, what, by), []).append(error)
                true_mm[name, what, by] = true
    return [_row(key, true_mm[key], np.array(found)) for key, found in errors.items()]


def _row(key: tuple[str, str, str], true: float, errors: np.ndarray) -> Row:
    artefact, what, by = key
    seen = errors[np.isfinite(errors)]
    limit = DIAMETER_LIMIT_MM if (artefact, by) == ("ring gauge", CALIBRATED_RIG) else None
    return {
        "artefact": artefact,
        "what": what,
        "by": by,
        "true_mm": true,
        "error_mm": float(seen.mean()) if seen.size else None,
        "worst_mm": float(np.abs(seen).max()) if seen.size else None,
        "scans": errors.size,
        "missing": int(errors.size - seen.size),
        "limit_mm": limit,
    }


Measured = dict[tuple[str, str], tuple[float, float]]
"""What was measured and by what: the true length, and the error."""

TRUE_RIG, CALIBRATED_RIG, DRAWN_RIG = "rig as it is", "rig calibrated on boards", "rig as drawn, not calibrated"


def _rigs(scan: Scan) -> dict[str, Rig]:
    true_rig = scan.scenario.true_rig or scan.scenario.rig
    return {
        TRUE_RIG: true_rig,
        CALIBRATED_RIG: calibrate(true_rig, scan.scenario.seed).rig,
        DRAWN_RIG: as_drawn(true_rig),
    }


def ring_gauge(scan: Scan, progress: Report) -> Measured:
    """A plain bore: the mean diameter of the frames' cylinders, their radius free."""
    diameter_mm, free = 2 * scan.truth.pipe.bore_radius_mm, CylinderMapSettings(radius_std_pct=None)
    found: Measured = {}
    for number, (label, rig) in enumerate(_rigs(scan).items()):
        frames = registered(scan, triangulated(scan, rig), free, rig)
        radii = [frame.alignment.radius_mm for frame in frames if frame.alignment.converged]
        error = 2 * float(np.mean(radii)) - diameter_mm if radii else float("nan")
        found["diameter", label] = diameter_mm, error
        progress("ring gauge", number + 1, 3)
    return found


def step_gauge(scan: Scan, progress: Report) -> Measured:
    """Pockets of growing depth through the whole chain: sized blind, and read from the wall map at the known place."""
    state = begin(scan.recording.rig, scan.recording.pipe, scan.scenario.method)
    for index, seen in enumerate(scan.seen):
        step(state, scan.recording.frame(index), seen)
        progress("step gauge", index + 1, len(scan.seen))
    reconstruction, pipe = finish(state), scan.truth.pipe
    blind = {i: reconstruction.defects[j].depth_mm for i, j in match(pipe, reconstruction.defects)}
    found: Measured = {}
    for number, feature in enumerate(pipe.features):
        depth = feature.depth_mm
        known = floor_depth_mm(reconstruction, pipe, number)
        found[f"step of {depth:g} mm", "wall map, place known"] = depth, known - depth
        found[f"step of {depth:g} mm", "sized blind"] = depth, blind.get(number, float("nan")) - depth
    return found


def floor_depth_mm(found: Reconstruction, pipe: Pipe, number: int) -> float:
    """Median of the wall map over the middle of one feature's floor; NaN where nothing was seen."""
    feature, wall = pipe.features[number], found.wall
    size = feature.size(pipe.bore_radius_mm)
    along = np.abs(wall.z_mm - feature.distance_mm) < FLOOR_SHARE * size.length_mm / 2
    around = np.abs(feature.arc_mm(wall.theta_rad, pipe.bore_radius_mm)) < FLOOR_SHARE * size.width_mm / 2
    floor = found.deviation_mm[np.ix_(around, along)]
    floor = floor[np.isfinite(floor)]
    return float(np.median(floor)) if floor.size else float("nan")


def ball_bar(scan: Scan, progress: Report) -> Measured:
    """Two pits that are caps of balls, seen in different frames: from centre to centre, by every registration."""
    points, pipe = triangulated(scan), scan.truth.pipe
    true_mm = float(np.linalg.norm(np.subtract(*_true_centers_mm(pipe))))
    found: Measured = {}
    for label, settings in contenders().items():
        parts = []
        for frame in registered(scan, points, settings):
            progress(f"ball-bar, {label}", frame.number + 1, len(points))
            if frame.alignment.converged:
                parts.append(apply(frame.alignment.T_pipe_camera, frame.points.xyz_mm))
        cloud = np.concatenate(parts) if parts else np.zeros((0, 3))
        centers = [ball_center_mm(cloud, pipe, number) for number in range(2)]
        found["centre to centre", label] = true_mm, float(np.linalg.norm(centers[1] - centers[0])) - true_mm
    return found


def _true_centers_mm(pipe: Pipe) -> list[np.ndarray]:
    return [_rolled_up(CENTER_MM, pipe, number) for number in range(2)]


def ball_center_mm(xyz_pipe_mm: Float[np.ndarray, "n 3"], pipe: Pipe, number: int) -> Float[np.ndarray, "3"]:
    """Centre of the ball of known radius through the points of a pit, NaN where too few were seen.

    The pit is a true ball on the unrolled wall (along, around, outward), and is fitted there.
    """
    feature, bore = pipe.features[number], pipe.bore_radius_mm
    x, y, z = xyz_pipe_mm.T
    around = feature.arc_mm(wall_angle_rad(x, y), bore)
    flat = np.column_stack([z - feature.distance_mm, around, np.hypot(x, y) - bore])
    near = np.hypot(flat[:, 0], flat[:, 1]) < BALL_MOUTH_MM / 2
    inside = near & (flat[:, 2] > BALL_DEEPER_MM) & (flat[:, 2] < BALL_DEPTH_MM + BALL_DEEPER_MM)
    if np.count_nonzero(inside) < BALL_POINTS:
        return np.full(3, np.nan)
    fit = least_squares(
        lambda c: np.linalg.norm(flat[inside] - c, axis=1) - BALL_MM, CENTER_MM, loss="cauchy", f_scale=BALL_SCALE_MM
    )
    return _rolled_up(fit.x, pipe, number)


def _rolled_up(flat: Float[np.ndarray, "3"], pipe: Pipe, number: int) -> Float[np.ndarray, "3"]:
    """A place on the unrolled wall about a feature, in the pipe frame."""
    feature, bore = pipe.features[number], pipe.bore_radius_mm
    theta = float(wrap_rad(np.radians(feature.clock_deg) + flat[1] / bore))
    return wall_direction(theta) * (bore + flat[2]) + [0.0, 0.0, feature.distance_mm + flat[0]]


MEASURES: Mapping[str, Callable[[Scan, Report], Measured]] = {
    "ring gauge": ring_gauge,
    "step gauge": step_gauge,
    "ball-bar": ball_bar,
}


def words(rows: list[Row]) -> str:
    """The table for a terminal, and whether limits hold."""
    judged = [
        f"{row['artefact']}, {row['by']}: worst {row['worst_mm']:.4f} mm, at most {row['limit_mm']:g} mm: "
        f"{'holds' if row['worst_mm'] <= row['limit_mm'] else 'MISSED'}"
        for row in rows
        if row["limit_mm"] is not None and row["worst_mm"] is not None
    ]
    return "\n".join([text_table(rows, COLUMNS), *judged])


def run_artefacts(fidelity: str, seeds: int, out: Path, workers: int, progress: Report) -> list[Row]:
    """Measure all artefacts and write the rows into a folder.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: when a scan fails.
    """
    with run_folder(out) as folder:
        start = time.perf_counter()
        rows = measure_artefacts(fidelity, seeds, workers, progress)
        write_rows(rows, folder / "artefacts")
        seconds = {"artefacts": round(time.perf_counter() - start, 3)}
        first = artefact_scenarios(fidelity, 0)["ring gauge"]
        (folder / "run.json").write_text(json.dumps(provenance(first, seconds, {}), indent=1) + "\n")
    return rows
