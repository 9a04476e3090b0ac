"""What a scan of clean pipe adds to a projector that boards have calibrated: errors before and after, seed by seed."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.calibration.clean_pipe import calibrate_in_pipe
from algorithms.calibration.poses_needed import Off, off_from
from scenarios.bench.calibrated import BoardSession, calibrate
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig, preset_rig
from sensor_model.streams import stream
from twin.pipe import Pipe

RADIUS_MM, FRAMES, STEP_MM = 76.2, 40, 12.0
ASIDE_STD_MM, TILT_STD_DEG = 3.0, 1.0  # of a robot's way along the pipe
PITS = [
    {"kind": "pit", "distance_mm": 200.0 + 60 * k, "clock_deg": 60.0 * k, "diameter_mm": 18, "depth_mm": 4}
    for k in range(6)
]
SESSIONS = {
    "a good session": BoardSession(),
    "a quick one": BoardSession(boards=8, board_distance_std_mm=0.1, board_tilt_std_deg=0.1),
}


def main() -> None:
    """Print the tables."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--seeds", type=int, default=10)
    seeds = words.parse_args().seeds
    for name, session in SESSIONS.items():
        rows = [list(_errors(session, seed)) for seed in range(seeds)]
        print(f"{name}: RMS over {seeds} seeds")
        print(f"  {'':<34}" + "".join(f"{figure:>16}" for figure in Off._fields))
        for k, what in enumerate(("boards", "and clean pipe of free radius", "and clean pipe of known radius")):
            rms = np.sqrt(np.mean(np.square([row[k][0] for row in rows]), axis=0))
            kept = sum(row[k][1] for row in rows)
            inside = np.mean([row[k][2] for row in rows])
            print(
                f"  {what:<34}" + "".join(f"{value:>16.5f}" for value in rms),
                f"  kept {kept}/{seeds}, inside 95 %: {inside:.2f}",
            )


def _errors(session: BoardSession, seed: int) -> Iterator[tuple[Off, bool, float]]:
    true = _true_rig(np.random.default_rng([seed, 1]))
    boards = calibrate(true, seed, session)
    covariance = boards.fit.covariance
    yield off_from(boards.rig, true), True, _inside(boards.rig, true, covariance)
    frames = list(_frames(true, seed))
    for radius_mm in (None, RADIUS_MM):
        found = calibrate_in_pipe(frames, boards.rig, covariance, radius_mm)
        rig = found.rig if found.helps else boards.rig
        yield off_from(rig, true), found.helps, _inside(found.rig, true, found.covariance)


def _inside(rig: Rig, true: Rig, covariance: np.ndarray) -> float:
    """Share of apex and half angles whose error lies within 1.96 of their standard deviations."""
    one, other = rig.projector, true.projector
    off = np.concatenate(
        [np.subtract(one.apex_mm, other.apex_mm), one.slit_half_angles_rad - other.slit_half_angles_rad]
    )
    std = np.sqrt(np.diag(covariance))[[0, 1, 2, *range(5, len(covariance))]]
    return float(np.mean(np.abs(off) < 1.96 * std))


def _true_rig(rng: np.random.Generator) -> Rig:
    rig = preset_rig()
    apex = np.array([0.0, 0.0, -53.0]) + rng.normal(0, [0.7, 0.7, 0.5])
    axis = (*rng.normal(0, 0.012, 2), 1.0)
    return rig.model_copy(update={"projector": rig.projector.model_copy(update={"apex_mm": tuple(apex), "axis": axis})})


def _frames(true: Rig, seed: int) -> Iterator[SlitPixels]:
    pipe = Pipe(inner_radius_mm=RADIUS_MM, wall_thickness_mm=7.5, start_mm=-400, end_mm=1200, features=PITS)
    way, noise = stream(seed, "drive"), stream(seed, "points")
    for k in range(FRAMES):
        T_pipe_camera = np.eye(4)
        T_pipe_camera[:3, :3] = Rotation.from_euler("xy", way.normal(0, TILT_STD_DEG, 2), degrees=True).as_matrix()
        T_pipe_camera[:3, 3] = [*way.normal(0, ASIDE_STD_MM, 2), STEP_MM * k]
        yield see_slits(pipe, T_pipe_camera, true, PointNoise(), noise, frame_index=k)


if __name__ == "__main__":
    main()
