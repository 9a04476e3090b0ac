"""The real camera's pictures: what the calibration makes of them beside the published lens."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.calibration.boards import Checkerboard, checkerboard_corners
from algorithms.calibration.camera import board_error_px, calibrate_camera
from scenarios.calibration.pictures import gray, read_picture
from sensor_model.rig import preset_rig

BOARD = Checkerboard()


@pytest.fixture(scope="module")
def corners(shared):
    folder = shared / "real" / "camera"
    if not folder.is_dir():
        pytest.skip("no real pictures of the camera's board")
    found = [checkerboard_corners(gray(read_picture(file)), BOARD) for file in sorted(folder.glob("*.png"))]
    return np.array([pixel for pixel in found if pixel is not None])


def test_every_picture_shows_the_board_and_the_fit_is_no_worse_than_the_published_lens(corners):
    assert len(corners) == 24
    found = calibrate_camera(corners, BOARD, (1664, 1232))
    published = preset_rig().camera.intrinsics
    assert found.flat.rms_px <= min(0.60, board_error_px(published, list(corners), BOARD.corners))
    assert found.flat.intrinsics[:2] == pytest.approx(published[:2], rel=0.005)
    assert found.flat.intrinsics[3:5] == pytest.approx(published[3:5], abs=4)
    assert found.flat_held_out_rms_px < 1.15 * found.flat.rms_px
    # the board is bent: its shape predicts pictures that had no part in it
    assert found.board_is_bent
    assert found.fit.rms_px < 0.2
    assert found.held_out_rms_px < 1.15 * found.fit.rms_px
    assert found.weakness == ""
