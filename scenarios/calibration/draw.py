"""`pipetwin calibrate draw`: the twin's pictures of a calibration board, for calibrations in closed loop."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from algorithms.calibration.boards import ArucoGrid, Checkerboard
from scenarios.calibration.in_pipe import optics_called, write_png
from scenarios.calibration.projector import RINGS, WHITE
from scenarios.calibration.rig_file import write_rig
from scenarios.document import BadInput
from sensor_model.board_pictures import Board, aruco_sheet, checkerboard, draw_board
from sensor_model.geometry import transform
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.rig import Rig
from sensor_model.streams import stream

Kind = Literal["checkerboard", "markers"]
SQUARE_MM = 25.0
CHECKER_TILT_DEG, CHECKER_NEAR_MM, CHECKER_FAR_MM, CHECKER_ASIDE_MM = 30.0, 175.0, 350.0, 40.0
MARKER_TILT_DEG, MARKER_NEAR_MM, MARKER_FAR_MM = 25.0, 110.0, 300.0
MARKER_ASIDE_MM = (10.0, 50.0)  # from the optical axis to the printed grid, which lies beside it
WHITE_EXPOSURE = 1.0


def draw_boards(folder: Path, kind: Kind, rig: Rig, look: str, poses: int, seed: int) -> list[str]:
    """Draw a session's pictures into a folder, and the rig that drew them; give their names.

    A pose has its own stream of noise, so that a longer session begins like a shorter one.

    Raises:
        BadInput: for a folder that cannot be made, and for a look that there is not.
    """
    optics = optics_called(look, "--look").model_copy(update={"inter_reflection": 0.0})  # a flat board lights nothing
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput([f"{folder}: cannot be made: {error.strerror}"]) from error
    grid, board = ArucoGrid(), Checkerboard()
    sheet = (
        checkerboard(board.columns, board.rows, SQUARE_MM)
        if kind == "checkerboard"
        else aruco_sheet(grid.columns, grid.rows, grid.marker_mm, grid.gap_mm)
    )
    write_rig(rig, folder / "rig.yaml")
    names = []
    for number in range(poses):
        rng = stream(seed, "boards", number + 1)
        T_camera_board = checkerboard_pose(rng) if kind == "checkerboard" else markers_pose(rng)
        for name, rings in ((WHITE, False), (RINGS, True))[: 1 if kind == "checkerboard" else 2]:
            names.append(f"{name}{number + 1:02d}.png")
            write_png(_picture(sheet, T_camera_board, rig, optics, rings, rng), folder / names[-1])
    return names


def _picture(
    sheet: Board, T_camera_board: np.ndarray, rig: Rig, optics: Optics, rings: bool, rng: np.random.Generator
) -> np.ndarray:
    exposed = optics if rings else optics.model_copy(update={"exposure": WHITE_EXPOSURE})
    return expose(draw_board(sheet, T_camera_board, rig, exposed, rings), exposed, rng, rig.camera)


def checkerboard_pose(rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """A checkerboard before the camera, turned and tilted in any direction."""
    turn, tilt = rng.uniform(-180, 180), rng.uniform(-CHECKER_TILT_DEG, CHECKER_TILT_DEG, 2)
    R = Rotation.from_euler("zxy", [turn, *tilt], degrees=True).as_matrix()
    aside = rng.uniform(-CHECKER_ASIDE_MM, CHECKER_ASIDE_MM, 2)
    board = Checkerboard()
    middle = SQUARE_MM * np.array([(board.columns - 1) / 2, (board.rows - 1) / 2, 0.0])
    return transform(R, np.array([*aside, rng.uniform(CHECKER_NEAR_MM, CHECKER_FAR_MM)]) - R @ middle)


def markers_pose(rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """A marked board whose print covers one side of the picture, and whose white part the rings."""
    turn, tilt = rng.uniform(-180, 180), rng.uniform(-MARKER_TILT_DEG, MARKER_TILT_DEG, 2)
    R = Rotation.from_euler("zxy", [turn, *tilt], degrees=True).as_matrix()
    aside = np.array([*rng.uniform(*MARKER_ASIDE_MM, 2), 0.0])
    return transform(R, np.array([0.0, 0.0, rng.uniform(MARKER_NEAR_MM, MARKER_FAR_MM)]) + R @ aside)
