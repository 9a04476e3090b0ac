"""The drawn picture without GL: every pixel's ray followed to the exact wall, and from there to the projector."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit

from sensor_model.geometry import fisheye_rays
from sensor_model.optics import REFERENCE_RANGE_MM, Optics, light
from sensor_model.rig import Camera, Rig
from sensor_model.slide_print import edge_shift
from sensor_model.wall_rays import (
    inward_normal,
    is_hole,
    near_wall,
    point_at,
    point_in_shadow,
    stretch_mm,
    wall_range_mm,
    wrapped,
)
from twin.pipe import Pipe

Triple = tuple[float, ...]
Rows = tuple[Triple, ...]


class View(NamedTuple):
    """Where camera and projector are, in the pipe frame; rows of `R_projector_pipe` are the projector's axes.

    Tuples, as in `optics.Light`.
    """

    R_pipe_camera: Rows
    eye: Triple
    apex: Triple
    R_projector_pipe: Rows
    start: float
    end: float
    backed: bool


def draw(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, optics: Optics) -> Float[np.ndarray, "h w 3"]:
    """The direct picture in linear light, float32 RGB; 1 is a white wall at the reference distance, lit head-on.

    Args:
        pipe: What is looked at.
        T_pipe_camera: Camera pose, mm.
        rig: The true camera and projector.
        optics: The settings that act on the wall; those of lens and chip are left to `expose`.

    Raises:
        ValueError: when the camera or the projector's apex lies outside the bore.
    """
    view = _view(pipe, T_pipe_camera, rig)
    wall = near_wall(pipe, float(view.apex[2]))
    check_inside(pipe, T_pipe_camera, rig)
    rays = camera_rays(rig.camera)
    picture = np.zeros(rays.shape, dtype=np.float32)
    _draw(wall, view, light(rig.projector, optics), rays, picture)
    return picture


def check_inside(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig) -> None:
    """See that camera and projector are in the pipe.

    Raises:
        ValueError: when the camera or the projector's apex lies outside the bore.
    """
    apex = (T_pipe_camera @ rig.projector.T_camera_projector)[:3, 3]
    for name, place in (("camera", T_pipe_camera[:3, 3]), ("projector", apex)):
        offset = np.hypot(place[0], place[1])
        if not offset < pipe.wall.smallest_radius:
            raise ValueError(
                f"the {name} is {offset:.1f} mm off the axis, outside the bore of {pipe.bore_radius_mm:.1f} mm"
            )


@lru_cache(maxsize=2)
def camera_rays(camera: Camera) -> Float[np.ndarray, "h w 3"]:
    """Unit ray of every pixel in the camera frame, float32."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
    return fisheye_rays(np.stack([u, v], axis=-1), camera.intrinsics).astype(np.float32)


def _view(pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig) -> View:
    T_pipe_projector = T_pipe_camera @ rig.projector.T_camera_projector
    return View(
        _rows(T_pipe_camera[:3, :3]),
        tuple(T_pipe_camera[:3, 3].tolist()),
        tuple(T_pipe_projector[:3, 3].tolist()),
        _rows(T_pipe_projector[:3, :3].T),
        pipe.start_mm,
        pipe.end_mm,
        pipe.backed,
    )


def _rows(matrix: np.ndarray) -> Rows:
    return tuple(tuple(row) for row in matrix.tolist())


@njit(cache=True, error_model="numpy")
def _draw(wall, view, beam, rays, picture):
    height, width, _ = rays.shape
    for row in range(height):
        up, below = max(row - 1, 0), min(row + 1, height - 1)
        for col in range(width):
            direction = _turned(view.R_pipe_camera, rays[row, col, 0], rays[row, col, 1], rays[row, col, 2])
            range_mm = _hit(wall, view, beam, direction)
            if range_mm < 0:
                continue
            point = point_at(view.eye, direction, range_mm)
            normal = inward_normal(wall, point)
            right = _ray_change(view, rays, row, max(col - 1, 0), row, min(col + 1, width - 1))
            down = _ray_change(view, rays, up, col, below, col)
            spot = aim(view, beam, range_mm, direction, right, down, point, normal)
            if spot[3] > 0 and not (in_housing(view, beam, point) or point_in_shadow(wall, point, view.apex)):
                light_spot(picture[row, col], beam, spot)


@njit(cache=True, error_model="numpy")
def light_spot(rgb, beam, spot):
    """Add the light that a pixel's piece of a surface throws back: `spot` as `aim` gives it, its level at last."""
    tangent, footprint, azimuth, level = spot
    if beam.jag_rad > 0:
        tangent += _jag(beam, tangent, azimuth) * (1 + tangent * tangent)
    begin, end = tangent - footprint / 2, tangent + footprint / 2
    for band in range(len(beam.lit_from)):
        share = level * (min(end, beam.lit_to[band]) - max(begin, beam.lit_from[band])) / footprint
        if share > 0:
            for channel in range(3):
                rgb[channel] += share * beam.colors[band][channel]


@njit(cache=True, error_model="numpy")
def _turned(R, x, y, z):
    return (
        R[0][0] * x + R[0][1] * y + R[0][2] * z,
        R[1][0] * x + R[1][1] * y + R[1][2] * z,
        R[2][0] * x + R[2][1] * y + R[2][2] * z,
    )


@njit(cache=True, error_model="numpy")
def dot(a, b):
    """Scalar product of two triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy")
def _ray_change(view, rays, row_a, col_a, row_b, col_b):
    """How a ray's direction changes from pixel to pixel."""
    steps = row_b - row_a + col_b - col_a
    x = (rays[row_b, col_b, 0] - rays[row_a, col_a, 0]) / steps
    y = (rays[row_b, col_b, 1] - rays[row_a, col_a, 1]) / steps
    z = (rays[row_b, col_b, 2] - rays[row_a, col_a, 2]) / steps
    return _turned(view.R_pipe_camera, x, y, z)


@njit(cache=True, error_model="numpy")
def _hit(wall, view, beam, direction):
    """Range to the first crossing of the wall, mm; -1 where no light can come from."""
    eye = view.eye
    first, last = stretch_mm(wall, eye, direction)
    if first < 0:
        return -1.0
    t_first = _half_angle_tangent(view, point_at(eye, direction, first))
    t_last = _half_angle_tangent(view, point_at(eye, direction, last))
    if max(t_first, t_last) < beam.lit_from[0] * 0.98 or min(t_first, t_last) > beam.lit_to[-1] * 1.02:
        return -1.0
    range_mm = wall_range_mm(wall, eye, direction, first, last)
    point = point_at(eye, direction, range_mm)
    if point[2] < view.start or point[2] > view.end:
        return -1.0
    if not view.backed and is_hole(wall, point[0], point[1]):
        return -1.0
    return range_mm


@njit(cache=True, error_model="numpy")
def _half_angle_tangent(view, point):
    axis = view.R_projector_pipe[2]
    x, y, z = point[0] - view.apex[0], point[1] - view.apex[1], point[2] - view.apex[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    if along <= 0:
        return 1e9
    return np.sqrt(max(x * x + y * y + z * z - along * along, 0.0)) / along


@njit(cache=True, error_model="numpy")
def aim(view, beam, range_mm, direction, right, down, point, normal):
    """Where a pixel's piece of wall lies on the slide (tangent of its half angle, footprint, azimuth); its light."""
    to = (point[0] - view.apex[0], point[1] - view.apex[1], point[2] - view.apex[2])
    distance = np.sqrt(dot(to, to))
    facing = -dot(normal, to) / distance
    looking = dot(normal, direction)
    if facing <= 0 or looking >= 0:
        return 0.0, 1.0, 0.0, 0.0
    M = view.R_projector_pipe
    x, y, along = _turned(M, to[0], to[1], to[2])
    across = np.sqrt(x * x + y * y)
    tangent = across / along
    # gradient of the tangent on the wall, then per pixel: the footprint of one pixel on the slide
    along_right, along_down = 0.0, 0.0
    n_right, n_down = dot(normal, right) / looking, dot(normal, down) / looking
    for i in range(3):
        gradient = ((M[0][i] * x + M[1][i] * y) / across - tangent * M[2][i]) / along
        along_right += gradient * range_mm * (right[i] - direction[i] * n_right)
        along_down += gradient * range_mm * (down[i] - direction[i] * n_down)
    footprint = max(np.sqrt(along_right**2 + along_down**2), 1e-6)
    azimuth = np.arctan2(x, -y)
    level = _strut(beam, azimuth)
    if level > 0:
        level *= facing**beam.angle_power * (REFERENCE_RANGE_MM / distance) ** beam.distance_power
    return tangent, footprint, azimuth, level


@njit(cache=True, error_model="numpy")
def _strut(beam, azimuth):
    if beam.strut_half_width_rad == 0.0:
        return 1.0
    beyond = abs(wrapped(azimuth - beam.strut_azimuth_rad)) - beam.strut_half_width_rad
    return min(max(beyond / max(beam.strut_softness_rad, 1e-6) + 0.5, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def in_housing(view, beam, point):
    """Whether the light to a point crosses the camera's own plane within the housing."""
    R = view.R_pipe_camera
    apex_z, point_z = 0.0, 0.0
    for i in range(3):
        apex_z += R[i][2] * (view.apex[i] - view.eye[i])
        point_z += R[i][2] * (point[i] - view.eye[i])
    if apex_z >= 0 or point_z <= 0:
        return False
    part = apex_z / (apex_z - point_z)
    radius2 = 0.0
    for axis in range(2):
        offset = 0.0
        for i in range(3):
            offset += R[i][axis] * (view.apex[i] + part * (point[i] - view.apex[i]) - view.eye[i])
        radius2 += offset * offset
    return radius2 < beam.housing_radius_mm**2


@njit(cache=True, error_model="numpy")
def _jag(beam, tangent, azimuth):
    """Shift of the nearest slit edge at one azimuth, rad: fixed noise, joined linearly between cells of the slide."""
    nearest, edge = 1e9, 0
    for band in range(len(beam.lit_from)):
        if abs(tangent - beam.lit_from[band]) < nearest:
            nearest, edge = abs(tangent - beam.lit_from[band]), 2 * band
        if abs(tangent - beam.lit_to[band]) < nearest:
            nearest, edge = abs(tangent - beam.lit_to[band]), 2 * band + 1
    return beam.jag_rad * edge_shift(edge, azimuth, beam.jag_cells)
