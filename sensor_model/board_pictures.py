"""Calibration boards as the camera sees them, under white light or under the projected rings, flat or bent."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float
from numba import njit

from sensor_model.camera_rays import camera_rays
from sensor_model.geometry import inverse
from sensor_model.glass import tube_of
from sensor_model.optics import Optics, light
from sensor_model.rig import Rig
from sensor_model.spot import aim, dimmed, light_spot
from sensor_model.wall_rays import point_at
from sensor_model.water import DRY
from sensor_model.ways import View, dot, in_housing, path_to, rows_of, sight_along

TEXEL_MM = 0.25
SUBSAMPLES = 4  # to a side of each pixel
BEND_STEPS = 4
WHITE_LIGHT = 0.5  # on a board that faces the camera, in the units of the projector's
GRAZING = 0.05  # cosine below which a sheet is taken to be seen edge-on


class Board(NamedTuple):
    """A printed sheet: reflectance by place, where its first texel lies (mm), and how it is bent.

    It lies at z = bend . (x^2, x y, y^2) / 1000, in mm of its own frame, whose z points away from the camera.
    """

    reflectance: Float[np.ndarray, "rows columns"]
    corner_mm: tuple[float, float]
    bend_per_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def height_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """How far the sheet lies out of its plane."""
        a, b, c = self.bend_per_m
        return (a * x_mm**2 + b * x_mm * y_mm + c * y_mm**2) / 1000.0


def checkerboard(columns: int, rows: int, square_mm: float, margin_mm: float = 10.0) -> Board:
    """A board with so many inner corners; the first of them is the origin."""
    sheet = np.ones((_texels((rows + 1) * square_mm), _texels((columns + 1) * square_mm)))
    row, column = np.indices(sheet.shape)
    per = square_mm / TEXEL_MM
    dark = ((row + 0.5) // per + (column + 0.5) // per) % 2 == 0
    sheet[dark] = 0.04
    edge = _texels(margin_mm)
    whole = np.pad(sheet, edge, constant_values=1.0)
    return Board(whole, (-square_mm - edge * TEXEL_MM, -square_mm - edge * TEXEL_MM))


def aruco_sheet(
    columns: int,
    rows: int,
    marker_mm: float,
    gap_mm: float,
    sheet_mm: tuple[float, float, float, float] = (-500.0, -600.0, 250.0, 330.0),
) -> Board:
    """A grid of markers on a large white board that reaches from (left, top) to (right, bottom), mm."""
    left, top, right, bottom = sheet_mm
    sheet = np.ones((_texels(bottom - top), _texels(right - left)))
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        first = [_texels(row * (marker_mm + gap_mm) - top), _texels(column * (marker_mm + gap_mm) - left)]
        # places between texels: the marker is drawn large and averaged down to where it lies
        bits = cv2.aruco.generateImageMarker(markers, number, 6).astype(float) / 255.0
        y = ((np.arange(first[0], first[0] + _texels(marker_mm) + 2) + 0.5) * TEXEL_MM + top) - row * (
            marker_mm + gap_mm
        )
        x = ((np.arange(first[1], first[1] + _texels(marker_mm) + 2) + 0.5) * TEXEL_MM + left) - column * (
            marker_mm + gap_mm
        )
        inside_y, inside_x = (y >= 0) & (y < marker_mm), (x >= 0) & (x < marker_mm)
        cells = np.ix_(
            (y[inside_y] / marker_mm * 6).astype(int).clip(0, 5), (x[inside_x] / marker_mm * 6).astype(int).clip(0, 5)
        )
        place = np.ix_(first[0] + np.flatnonzero(inside_y), first[1] + np.flatnonzero(inside_x))
        sheet[place] = 0.04 + 0.96 * bits[cells]
    return Board(sheet, (left, top))


def _texels(length_mm: float) -> int:
    return int(np.floor(length_mm / TEXEL_MM + 0.5))


def draw_board(
    board: Board, T_camera_board: Float[np.ndarray, "4 4"], rig: Rig, optics: Optics, rings: bool
) -> Float[np.ndarray, "h w 3"]:
    """The direct picture in linear light, float32 RGB: under the rings, or under the white light at the camera."""
    rays = camera_rays(rig.camera)
    T_projector_camera = inverse(rig.projector.T_camera_projector)
    view = View(
        rows_of(np.eye(3)),
        (0.0, 0.0, 0.0),
        rig.projector.apex_mm,
        rows_of(T_projector_camera[:3, :3]),
        -1e9,
        1e9,
        True,
        tube_of(optics.glass),
        DRY,
    )
    picture = np.zeros(rays.shape, dtype=np.float32)
    # cached compiled code takes a plain array, whatever the sheet was made from
    sheet = np.ascontiguousarray(board.reflectance)
    _draw_board(sheet, board.corner_mm, board.bend_per_m, inverse(T_camera_board), view, light(rig.projector, optics),
                rig.projector.printed_jag_rad, np.array(optics.wall_reflectance), rays, rings, picture)  # fmt: skip
    return picture


@njit(cache=True, error_model="numpy")
def _draw_board(sheet, corner, bend, T_board_camera, view, beam, jag_table_rad, white, rays, rings, picture):
    height, width, _ = rays.shape
    R, eye, straight = T_board_camera[:3, :3], T_board_camera[:3, 3].copy(), T_board_camera[:3, 3]
    for row in range(height):
        up, below = max(row - 1, 0), min(row + 1, height - 1)
        for col in range(width):
            before, after = max(col - 1, 0), min(col + 1, width - 1)
            direction = (np.float64(rays[row, col, 0]), np.float64(rays[row, col, 1]), np.float64(rays[row, col, 2]))
            sight = sight_along(view, direction)
            if view.tube.is_there:
                direction = sight.direction
                for k in range(3):
                    eye[k] = straight[k] + dot((R[k, 0], R[k, 1], R[k, 2]), sight.start)
            range_mm, x, y, facing = _on_sheet(R, eye, bend, direction)
            if not range_mm > 0.0 or facing < GRAZING or not _near(sheet, corner, x, y):
                continue
            right, down = _change(rays, row, before, row, after), _change(rays, up, col, below, col)
            reflectance = _covered(sheet, corner, bend, R, eye, direction, right, down)
            if reflectance <= 0.0:
                continue
            point = point_at(sight.start, direction, range_mm)
            normal = _normal(R, bend, x, y)
            if rings:
                path = path_to(view, point)
                spot = aim(view, beam, path, sight, range_mm, right, down, point, normal)
                if spot.level > 0 and not in_housing(view, beam, path.aimed):
                    light_spot(picture[row, col], beam, jag_table_rad, dimmed(spot, reflectance))
            else:
                level = WHITE_LIGHT * reflectance * max(-dot(normal, direction), 0.0) * sight.passed
                for c in range(3):
                    picture[row, col, c] = level * white[c]


@njit(cache=True, error_model="numpy")
def _on_sheet(R, eye, bend, d):
    """Range along a camera ray to the sheet, and where it meets it (board frame, mm)."""
    dx = R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2]
    dy = R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2]
    dz = R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2]
    t, x, y = -eye[2] / dz, 0.0, 0.0
    for _ in range(BEND_STEPS):
        x, y = eye[0] + t * dx, eye[1] + t * dy
        z = (bend[0] * x * x + bend[1] * x * y + bend[2] * y * y) / 1000.0
        t = (z - eye[2]) / dz
    return t, eye[0] + t * dx, eye[1] + t * dy, dz


@njit(cache=True, error_model="numpy")
def _near(sheet, corner, x, y):
    return (
        corner[0] - 5.0 < x < corner[0] + sheet.shape[1] * TEXEL_MM + 5.0
        and corner[1] - 5.0 < y < corner[1] + sheet.shape[0] * TEXEL_MM + 5.0
    )


@njit(cache=True, error_model="numpy")
def _covered(sheet, corner, bend, R, eye, direction, right, down):
    """Mean reflectance over a pixel."""
    total = 0.0
    for a in range(SUBSAMPLES):
        for b in range(SUBSAMPLES):
            s, t = (a + 0.5) / SUBSAMPLES - 0.5, (b + 0.5) / SUBSAMPLES - 0.5
            d = (
                direction[0] + s * right[0] + t * down[0],
                direction[1] + s * right[1] + t * down[1],
                direction[2] + s * right[2] + t * down[2],
            )
            _, x, y, _ = _on_sheet(R, eye, bend, d)
            column, row = int(np.floor((x - corner[0]) / TEXEL_MM)), int(np.floor((y - corner[1]) / TEXEL_MM))
            if 0 <= row < sheet.shape[0] and 0 <= column < sheet.shape[1]:
                total += sheet[row, column]
    return total / SUBSAMPLES**2


@njit(cache=True, error_model="numpy")
def _normal(R, bend, x, y):
    """Unit normal of the sheet towards the camera, in the camera frame."""
    nx = (2.0 * bend[0] * x + bend[1] * y) / 1000.0
    ny = (bend[1] * x + 2.0 * bend[2] * y) / 1000.0
    length = np.sqrt(nx * nx + ny * ny + 1.0)
    nx, ny, nz = nx / length, ny / length, -1.0 / length
    return (
        R[0, 0] * nx + R[1, 0] * ny + R[2, 0] * nz,
        R[0, 1] * nx + R[1, 1] * ny + R[2, 1] * nz,
        R[0, 2] * nx + R[1, 2] * ny + R[2, 2] * nz,
    )


@njit(cache=True, error_model="numpy")
def _change(rays, row_a, col_a, row_b, col_b):
    """How a ray's direction changes from pixel to pixel."""
    steps = row_b - row_a + col_b - col_a
    return (
        (rays[row_b, col_b, 0] - rays[row_a, col_a, 0]) / np.float64(steps),
        (rays[row_b, col_b, 1] - rays[row_a, col_a, 1]) / np.float64(steps),
        (rays[row_b, col_b, 2] - rays[row_a, col_a, 2]) / np.float64(steps),
    )
