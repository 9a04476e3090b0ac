"""Calibration boards in a picture: the inner corners of a checkerboard, the markers of an ArUco grid."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from pydantic import Field

from sensor_model.settings import Settings

SUBPIXEL_SHARE = 0.3  # of the distance to the next corner is looked at around each
LEAST_WINDOW_PX, MOST_WINDOW_PX = 3, 9
SUBPIXEL_STOP = (3, 60, 1e-4)  # cv2: by count and by step


class Checkerboard(Settings):
    """Inner corners of a checkerboard; its square is the unit of length."""

    columns: Annotated[int, Field(ge=3, le=40)] = 6
    rows: Annotated[int, Field(ge=3, le=40)] = 9

    @property
    def corners(self) -> Float[np.ndarray, "corners 3"]:
        """Corners of the flat board, in squares, row by row."""
        row, column = np.mgrid[: self.rows, : self.columns]
        flat = np.stack([column, row, np.zeros_like(row)], axis=-1).reshape(-1, 3)
        return flat.astype(float)


class ArucoGrid(Settings):
    """A grid of ArUco markers, ids row by row from 0 (DICT_4X4_50), as `cv2.aruco.GridBoard` has it."""

    columns: Annotated[int, Field(ge=1, le=10)] = 4
    rows: Annotated[int, Field(ge=1, le=10)] = 6
    marker_mm: Annotated[float, Field(gt=0)] = 36.2143
    gap_mm: Annotated[float, Field(gt=0)] = 36.2143 / 5


class MarkerCorners(NamedTuple):
    """Corners of the markers found in one picture: on the board (mm) and in the picture; `ids` one a marker."""

    board_mm: Float[np.ndarray, "n 3"]
    pixel: Float[np.ndarray, "n 2"]
    ids: Int[np.ndarray, "markers"]


def checkerboard_corners(
    gray: UInt8[np.ndarray, "height width"], board: Checkerboard
) -> Float[np.ndarray, "corners 2"] | None:
    """Pixels of all inner corners in the board's order, or None where the board is not seen whole."""
    import cv2

    size = (board.columns, board.rows)
    # half the size first: a board that is not there takes half a minute to be missed at full size
    half = cv2.resize(gray, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    found, corners = cv2.findChessboardCorners(half, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH)
    if found:
        corners = 2.0 * corners + 0.5
    else:
        found, corners = cv2.findChessboardCorners(gray, size, flags=0)
    if not found:
        return None
    grid = corners.reshape(board.rows, board.columns, 2)
    nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    reach = int(np.clip(SUBPIXEL_SHARE * nearest, LEAST_WINDOW_PX, MOST_WINDOW_PX))
    fine = cv2.cornerSubPix(gray, corners.astype(np.float32), (reach, reach), (-1, -1), SUBPIXEL_STOP)
    return fine.reshape(-1, 2).astype(float)


def marker_corners(gray: UInt8[np.ndarray, "height width"], board: ArucoGrid) -> MarkerCorners:
    """Corners of the markers that can be read."""
    import cv2

    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    grid = cv2.aruco.GridBoard((board.columns, board.rows), board.marker_mm, board.gap_mm, markers)
    how = cv2.aruco.DetectorParameters()
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    how.cornerRefinementWinSize = 4
    found, ids, _ = cv2.aruco.ArucoDetector(markers, how).detectMarkers(gray)
    known = [k for k, name in enumerate(() if ids is None else ids.ravel()) if name < board.columns * board.rows]
    if not known:
        return MarkerCorners(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0, dtype=np.int64))
    numbers = ids.ravel()[known].astype(np.int64)
    on_board = np.concatenate([grid.getObjPoints()[number] for number in numbers]).astype(float)
    pixel = np.concatenate([found[k].reshape(4, 2) for k in known]).astype(float)
    return MarkerCorners(on_board, pixel, numbers)
