"""The camera's calibration recovers the lens that made the corners, and says what it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.calibration.board_pose import rms_px, settled_pose
from algorithms.calibration.boards import Checkerboard, checkerboard_corners
from algorithms.calibration.camera import NAMES, NORMAL_95, board_error_px, calibrate_camera
from algorithms.calibration.failure import CannotCalibrate
from sensor_model import board_pictures
from sensor_model.geometry import apply, fisheye_project, transform
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.rig import preset_rig

BOARD = Checkerboard()
CAMERA = preset_rig().camera
SIZE = (CAMERA.width_px, CAMERA.height_px)
MIDDLE = np.array([2.5, 4.0, 0.0])


def _poses(rng, count, tilt_deg=35.0):
    for _ in range(count):
        turn = Rotation.from_euler("zxy", [rng.uniform(-180, 180), *rng.uniform(-tilt_deg, tilt_deg, 2)], degrees=True)
        place = np.array([*rng.uniform(-5, 5, 2), rng.uniform(7, 14)])
        yield transform(turn.as_matrix(), place - turn.as_matrix() @ MIDDLE)


def _seen(rng, count, noise_px=0.12, bend_squares=0.0, tilt_deg=35.0):
    """Corners of a bent board: a saddle whose corners lie so far out of the plane."""
    x, y, _ = ((BOARD.corners - MIDDLE) / [2.5, 4.0, 1.0]).T
    shape = BOARD.corners + np.stack([0 * x, 0 * x, bend_squares * x * y], axis=1)
    exact = [
        fisheye_project(apply(T_camera_board, shape), CAMERA.intrinsics)
        for T_camera_board in _poses(rng, count, tilt_deg)
    ]
    return np.array(exact) + rng.normal(0, noise_px, (count, len(shape), 2))


@pytest.mark.parametrize("bend_squares", [0.0, 0.04])
def test_the_true_lens_lies_in_the_stated_intervals(bend_squares):
    inside = []
    for seed in range(4):
        found = calibrate_camera(_seen(np.random.default_rng(seed), 16, bend_squares=bend_squares), BOARD, SIZE)
        assert found.board_is_bent == (bend_squares > 0)
        inside.append(np.abs(found.fit.intrinsics - CAMERA.intrinsics) <= NORMAL_95 * found.fit.std)
        assert found.fit.rms_px == pytest.approx(0.12 * np.sqrt(2), rel=0.15)
        assert found.held_out_rms_px < 1.5 * found.fit.rms_px
    assert np.mean(inside) > 0.8


def test_a_bent_board_taken_as_flat_moves_the_lens():
    found = calibrate_camera(_seen(np.random.default_rng(3), 20, bend_squares=0.05), BOARD, SIZE)
    true = CAMERA.intrinsics[0]
    assert abs(found.bent.intrinsics[0] - true) < 0.3 * abs(found.flat.intrinsics[0] - true)
    assert found.bent_held_out_rms_px < 0.6 * found.flat_held_out_rms_px


def test_a_picture_that_disagrees_is_left_out_and_named():
    pixel = _seen(np.random.default_rng(5), 14)
    pixel[4] = pixel[4][:, ::-1][:, ::-1] + np.random.default_rng(0).normal(0, 4.0, pixel[4].shape)
    found = calibrate_camera(pixel, BOARD, SIZE)
    assert found.far_off == (4,)
    assert 4 not in found.used


def test_boards_all_parallel_and_too_few_pictures_are_refused():
    with pytest.raises(CannotCalibrate, match="parallel"):
        calibrate_camera(_seen(np.random.default_rng(1), 10, tilt_deg=0.0), BOARD, SIZE)
    with pytest.raises(CannotCalibrate, match="3 pictures"):
        calibrate_camera(_seen(np.random.default_rng(1), 3), BOARD, SIZE)


def test_noisy_corners_make_a_weak_calibration_that_says_so():
    assert "focal length" in calibrate_camera(_seen(np.random.default_rng(2), 5, noise_px=2.5), BOARD, SIZE).weakness


def test_drawn_boards_give_the_lens_that_drew_them():
    rng, rig = np.random.default_rng(11), preset_rig()
    optics = Optics().model_copy(update={"inter_reflection": 0.0, "exposure": 1.0})
    sheet = board_pictures.checkerboard(BOARD.columns, BOARD.rows, 25.0)
    pixel = []
    for T_camera_board in _poses(rng, 8, tilt_deg=30.0):
        T_mm = T_camera_board.copy()
        T_mm[:3, 3] *= 25.0
        linear = board_pictures.draw_board(sheet, T_mm, rig, optics, rings=False)
        gray = expose(linear, optics, rng, rig.camera)[..., 1]
        corners = checkerboard_corners(np.ascontiguousarray(gray), BOARD)
        if corners is not None:
            pixel.append(corners)
            truth = fisheye_project(apply(T_camera_board, BOARD.corners), CAMERA.intrinsics)
            assert rms_px(min((corners - truth, corners[::-1] - truth), key=rms_px)) < 0.15
    assert len(pixel) >= 6
    found = calibrate_camera(np.array(pixel), BOARD, SIZE)
    off = np.abs(found.flat.intrinsics - CAMERA.intrinsics)
    assert dict(zip(NAMES, off < 2 * NORMAL_95 * found.flat.std, strict=True)) == dict.fromkeys(NAMES, True)
    assert board_error_px(CAMERA.intrinsics, pixel, BOARD.corners) < 0.15


def test_a_pose_is_found_despite_a_few_wild_points():
    rng = np.random.default_rng(0)
    pixel = _seen(rng, 1, noise_px=0.1)[0]
    pixel[[3, 30]] += 25.0
    start = np.array([0.0, 0.0, 0.0, -2.5, -4.0, 10.0])
    robust, residual, _ = settled_pose(CAMERA.intrinsics, BOARD.corners, pixel, start, robust=True)
    assert np.median(np.abs(residual)) < 0.15
    assert np.isfinite(robust).all()
