"""How far a camera's calibration can be believed: intervals on twin corners, random subsets of real pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from algorithms.calibration.boards import Checkerboard
from algorithms.calibration.camera import NAMES, NORMAL_95, CameraCalibration, calibrate_camera
from scenarios.calibration.camera import find_boards
from scenarios.calibration.draw import SQUARE_MM, checkerboard_pose
from scenarios.calibration.pictures import listed
from sensor_model.geometry import apply, fisheye_project
from sensor_model.rig import preset_rig

BOARD, NOISE_PX = Checkerboard(), 0.12
BENDS_SQUARES = (0.0, 0.05)  # the corners of a saddle lie so far out of the board's plane


def main() -> None:
    """Print coverage, and the scatter of subsets."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--seeds", type=int, default=10)
    words.add_argument("--pictures", type=Path, help="a folder with real pictures of a 6x9 checkerboard")
    words.add_argument("--of", type=int, default=12, help="how many of them a subset has")
    given = words.parse_args()
    for bend in BENDS_SQUARES:
        _coverage(bend, given.seeds)
    if given.pictures:
        _subsets(given.pictures, given.of, given.seeds)


def _coverage(bend: float, seeds: int) -> None:
    true = preset_rig().camera.intrinsics
    found = [_twin(bend, seed) for seed in range(seeds)]
    inside = np.array([np.abs(one.fit.intrinsics - true) < NORMAL_95 * one.fit.std for one in found])
    held_out = np.mean([one.held_out_rms_px / one.fit.rms_px for one in found])
    print(f"twin, 24 pictures, board bent by {bend:g} squares, {seeds} seeds: true lens inside the 95 % intervals in "
          f"{100 * inside.mean():.0f} %; left-out error {100 * (held_out - 1):+.0f} % of the fit's")  # fmt: skip
    print(
        "  " + ", ".join(f"{name} {100 * share:.0f} %" for name, share in zip(NAMES, inside.mean(axis=0), strict=True))
    )


def _twin(bend: float, seed: int) -> CameraCalibration:
    camera, rng = preset_rig().camera, np.random.default_rng(seed)
    middle = np.array([(BOARD.columns - 1) / 2, (BOARD.rows - 1) / 2, 0.0])
    x, y, _ = ((BOARD.corners - middle) / [*middle[:2], 1.0]).T
    shape = SQUARE_MM * (BOARD.corners + np.stack([0 * x, 0 * x, bend * x * y], axis=1))
    pixel = np.array([fisheye_project(apply(checkerboard_pose(rng), shape), camera.intrinsics) for _ in range(24)])
    pixel += NOISE_PX * rng.standard_normal(pixel.shape)
    return calibrate_camera(pixel, BOARD, (camera.width_px, camera.height_px))


def _subsets(folder: Path, count: int, seeds: int) -> None:
    pictures = find_boards(listed([folder]), BOARD)
    whole = calibrate_camera(pictures.pixel, BOARD, pictures.size_px).fit
    print(f"{folder.name}: {seeds} subsets of {count} of {len(pictures.names)} pictures")
    for seed in range(seeds):
        chosen = np.random.default_rng(seed).choice(len(pictures.names), count, replace=False)
        one = calibrate_camera(pictures.pixel[np.sort(chosen)], BOARD, pictures.size_px)
        off = one.fit.intrinsics - whole.intrinsics
        print(f"  {one.fit.rms_px:.3f} px, left out {one.held_out_rms_px:.3f} px; fx {off[0]:+.2f}, fy {off[1]:+.2f}, "
              f"cx {off[3]:+.2f}, cy {off[4]:+.2f} px from all; {'bent' if one.board_is_bent else 'flat'}; "
              f"{one.weakness or 'not weak'}")  # fmt: skip


if __name__ == "__main__":
    main()
