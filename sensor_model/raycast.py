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
from twin.features.base import CENTER_THETA, CENTER_Z, HALF_BOX_ARC, HALF_BOX_Z
from twin.pipe import Pipe, Wall, wall_radius_mm

JAG_CELLS = 1024  # around the slide; the shader has the same number
SHORTEST_STEP_MM = 0.1
STEP_PER_GAP = 0.15  # walls rise up to 6 mm per mm, so a ray may go a sixth of its gap before it can touch
HIT_TOLERANCE_MM = 1e-6
SHADOW_LIFT_MM = 0.01
SLOPE_STEP_MM = 0.005


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
    low = pipe.bore_radius_mm * (1 - wall.ovality)
    check_inside(pipe, T_pipe_camera, rig)
    rays = camera_rays(rig.camera)
    picture = np.zeros(rays.shape, dtype=np.float32)
    _draw(wall, low, view, light(rig.projector, optics), rays, picture)
    return picture


def check_inside(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig) -> None:
    """See that camera and projector are in the pipe.

    Raises:
        ValueError: when the camera or the projector's apex lies outside the bore.
    """
    apex = (T_pipe_camera @ rig.projector.T_camera_projector)[:3, 3]
    for name, place in (("camera", T_pipe_camera[:3, 3]), ("projector", apex)):
        offset = np.hypot(place[0], place[1])
        if not offset < pipe.bore_radius_mm * (1 - pipe.wall.ovality):
            raise ValueError(
                f"the {name} is {offset:.1f} mm off the axis, outside the bore of {pipe.bore_radius_mm:.1f} mm"
            )


def near_wall(pipe: Pipe, z_mm: float) -> Wall:
    """The wall with only those features that the sensor can light or see from one place."""
    wall = pipe.wall
    near = np.abs(wall.rows[:, CENTER_Z] - z_mm) <= wall.rows[:, HALF_BOX_Z] + 12 * pipe.bore_radius_mm
    return wall._replace(codes=wall.codes[near], rows=wall.rows[near])


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
def _draw(wall, low, view, beam, rays, picture):
    height, width, _ = rays.shape
    for row in range(height):
        up, below = max(row - 1, 0), min(row + 1, height - 1)
        for col in range(width):
            direction = _turned(view.R_pipe_camera, rays[row, col, 0], rays[row, col, 1], rays[row, col, 2])
            range_mm = _hit(wall, low, view, beam, direction)
            if range_mm < 0:
                continue
            point = _along(view.eye, direction, range_mm)
            normal = _inward_normal(wall, low, point)
            right = _ray_change(view, rays, row, max(col - 1, 0), row, min(col + 1, width - 1))
            down = _ray_change(view, rays, up, col, below, col)
            tangent, footprint, azimuth, level = _aim(view, beam, range_mm, direction, right, down, point, normal)
            if level <= 0 or _in_housing(view, beam, point) or _shadowed(wall, low, view, point, normal):
                continue
            if beam.jag_rad > 0:
                tangent += _jag(beam, tangent, azimuth) * (1 + tangent * tangent)
            begin, end = tangent - footprint / 2, tangent + footprint / 2
            for band in range(len(beam.lit_from)):
                share = level * (min(end, beam.lit_to[band]) - max(begin, beam.lit_from[band])) / footprint
                if share > 0:
                    for channel in range(3):
                        picture[row, col, channel] += share * beam.colors[band][channel]


@njit(cache=True, error_model="numpy")
def _turned(R, x, y, z):
    return (
        R[0][0] * x + R[0][1] * y + R[0][2] * z,
        R[1][0] * x + R[1][1] * y + R[1][2] * z,
        R[2][0] * x + R[2][1] * y + R[2][2] * z,
    )


@njit(cache=True, error_model="numpy")
def _along(origin, direction, s):
    return (origin[0] + s * direction[0], origin[1] + s * direction[1], origin[2] + s * direction[2])


@njit(cache=True, error_model="numpy")
def _dot(a, b):
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
def _hit(wall, low, view, beam, direction):
    """Range to the first crossing of the wall, mm; -1 where no light can come from."""
    eye = view.eye
    radial2 = direction[0] ** 2 + direction[1] ** 2
    if radial2 < 1e-8:
        return -1.0
    first = _leave_cylinder(eye, direction, radial2, low)
    last = _leave_cylinder(eye, direction, radial2, wall.outer_radius)
    t_first = _half_angle_tangent(view, _along(eye, direction, first))
    t_last = _half_angle_tangent(view, _along(eye, direction, last))
    if max(t_first, t_last) < beam.lit_from[0] * 0.98 or min(t_first, t_last) > beam.lit_to[-1] * 1.02:
        return -1.0
    range_mm = first
    if wall.ovality != 0.0 or _near_feature(wall, eye, direction, first, last):
        range_mm = _march(wall, eye, direction, first, last)
    x, y, z = _along(eye, direction, range_mm)
    if z < view.start or z > view.end:
        return -1.0
    if not view.backed and np.sqrt(x * x + y * y) >= wall.outer_radius - 1e-5:
        return -1.0
    return range_mm


@njit(cache=True, error_model="numpy")
def _leave_cylinder(eye, direction, radial2, radius):
    b = eye[0] * direction[0] + eye[1] * direction[1]
    c = eye[0] ** 2 + eye[1] ** 2 - radius**2
    return (-b + np.sqrt(b * b - radial2 * c)) / radial2


@njit(cache=True, error_model="numpy")
def _half_angle_tangent(view, point):
    axis = view.R_projector_pipe[2]
    x, y, z = point[0] - view.apex[0], point[1] - view.apex[1], point[2] - view.apex[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    if along <= 0:
        return 1e9
    return np.sqrt(max(x * x + y * y + z * z - along * along, 0.0)) / along


@njit(cache=True, error_model="numpy")
def _near_feature(wall, eye, direction, first, last):
    """Whether a stretch of a ray passes the box of any feature."""
    z_a, z_b = eye[2] + first * direction[2], eye[2] + last * direction[2]
    low_z, high_z = min(z_a, z_b), max(z_a, z_b)
    for i in range(wall.codes.size):
        center, half = wall.rows[i, CENTER_Z], wall.rows[i, HALF_BOX_Z]
        if high_z < center - half or low_z > center + half:
            continue
        middle = 0.5 * (first + last)
        theta = np.arctan2(eye[0] + middle * direction[0], -(eye[1] + middle * direction[1]))
        begin = np.arctan2(eye[0] + first * direction[0], -(eye[1] + first * direction[1]))
        spread = wall.inner_radius * abs(_wrapped(begin - theta)) * 1.5
        if wall.inner_radius * abs(_wrapped(theta - wall.rows[i, CENTER_THETA])) <= wall.rows[i, HALF_BOX_ARC] + spread:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _wrapped(angle):
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


@njit(cache=True, error_model="numpy")
def _clearance(wall, origin, direction, s):
    """How far a point of a ray is inside the wall, mm; negative beyond it."""
    x, y = origin[0] + s * direction[0], origin[1] + s * direction[1]
    return wall_radius_mm(wall, np.arctan2(x, -y), origin[2] + s * direction[2]) - np.sqrt(x * x + y * y)


@njit(cache=True, error_model="numpy")
def _march(wall, eye, direction, first, last):
    """First crossing between two ranges: steps that the gap allows, then bisection."""
    inside = first
    gap = _clearance(wall, eye, direction, inside)
    if gap <= HIT_TOLERANCE_MM:
        return inside
    outside = inside
    while outside < last:
        outside = min(inside + max(SHORTEST_STEP_MM, STEP_PER_GAP * gap), last)
        gap = _clearance(wall, eye, direction, outside)
        if gap <= 0:
            break
        inside = outside
    while outside - inside > HIT_TOLERANCE_MM:
        middle = 0.5 * (inside + outside)
        if _clearance(wall, eye, direction, middle) > 0:
            inside = middle
        else:
            outside = middle
    return outside


@njit(cache=True, error_model="numpy")
def _inward_normal(wall, low, point):
    """Unit normal of rho = r(theta, z), towards the axis."""
    rho = np.sqrt(point[0] ** 2 + point[1] ** 2)
    if wall.ovality == 0.0 and rho < low + HIT_TOLERANCE_MM:
        return (-point[0] / rho, -point[1] / rho, 0.0)
    theta = np.arctan2(point[0], -point[1])
    turn = SLOPE_STEP_MM / rho
    slope_z = wall_radius_mm(wall, theta, point[2] + SLOPE_STEP_MM) - wall_radius_mm(
        wall, theta, point[2] - SLOPE_STEP_MM
    )
    slope_arc = wall_radius_mm(wall, theta + turn, point[2]) - wall_radius_mm(wall, theta - turn, point[2])
    slope_z, slope_arc = slope_z / (2 * SLOPE_STEP_MM), slope_arc / (2 * SLOPE_STEP_MM)
    length = np.sqrt(1 + slope_z**2 + slope_arc**2)
    sine, cosine = point[0] / rho, point[1] / rho
    return ((-sine - slope_arc * cosine) / length, (-cosine + slope_arc * sine) / length, slope_z / length)


@njit(cache=True, error_model="numpy")
def _aim(view, beam, range_mm, direction, right, down, point, normal):
    """Where a pixel's piece of wall lies on the slide (tangent of its half angle, footprint, azimuth); its light."""
    to = (point[0] - view.apex[0], point[1] - view.apex[1], point[2] - view.apex[2])
    distance = np.sqrt(_dot(to, to))
    facing = -_dot(normal, to) / distance
    looking = _dot(normal, direction)
    if facing <= 0 or looking >= 0:
        return 0.0, 1.0, 0.0, 0.0
    M = view.R_projector_pipe
    x, y, along = _turned(M, to[0], to[1], to[2])
    across = np.sqrt(x * x + y * y)
    tangent = across / along
    # gradient of the tangent on the wall, then per pixel: the footprint of one pixel on the slide
    along_right, along_down = 0.0, 0.0
    n_right, n_down = _dot(normal, right) / looking, _dot(normal, down) / looking
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
    beyond = abs(_wrapped(azimuth - beam.strut_azimuth_rad)) - beam.strut_half_width_rad
    return min(max(beyond / max(beam.strut_softness_rad, 1e-6) + 0.5, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _in_housing(view, beam, point):
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
def _shadowed(wall, low, view, point, normal):
    """Whether the wall stands between a point and the projector; the bore, being convex, shades nothing."""
    if np.sqrt(point[0] ** 2 + point[1] ** 2) <= low + 1e-4:
        return False
    x, y, z = (
        point[0] + SHADOW_LIFT_MM * normal[0],
        point[1] + SHADOW_LIFT_MM * normal[1],
        point[2] + SHADOW_LIFT_MM * normal[2],
    )
    to_x, to_y, to_z = view.apex[0] - x, view.apex[1] - y, view.apex[2] - z
    length = np.sqrt(to_x**2 + to_y**2 + to_z**2)
    origin, towards = (x, y, z), (to_x / length, to_y / length, to_z / length)
    s = 0.0
    while s < length:
        rho = np.sqrt((origin[0] + s * towards[0]) ** 2 + (origin[1] + s * towards[1]) ** 2)
        if rho < low:
            return False
        gap = _clearance(wall, origin, towards, s)
        if gap < 0:
            return True
        s += max(SHORTEST_STEP_MM / 2, STEP_PER_GAP * gap)
    return False


@njit(cache=True, error_model="numpy")
def _jag(beam, tangent, azimuth):
    """Shift of the nearest slit edge at one azimuth, rad: fixed noise, joined linearly between cells of the slide."""
    nearest, edge = 1e9, 0
    for band in range(len(beam.lit_from)):
        if abs(tangent - beam.lit_from[band]) < nearest:
            nearest, edge = abs(tangent - beam.lit_from[band]), 2 * band
        if abs(tangent - beam.lit_to[band]) < nearest:
            nearest, edge = abs(tangent - beam.lit_to[band]), 2 * band + 1
    place = (azimuth / (2 * np.pi) + 0.5) * JAG_CELLS
    cell = int(np.floor(place))
    part = place - cell
    return beam.jag_rad * ((1 - part) * _hashed(edge, cell) + part * _hashed(edge, cell + 1))


@njit(cache=True, error_model="numpy")
def _hashed(edge, cell):
    """A fixed number in [-1, 1) for one edge and cell: 32-bit integer arithmetic, as the shader has it."""
    mask = np.uint64(0xFFFFFFFF)
    h = (np.uint64(edge) * np.uint64(0x9E3779B1) + np.uint64(cell % JAG_CELLS) * np.uint64(0x85EBCA6B)) & mask
    h ^= h >> np.uint64(16)
    h = (h * np.uint64(0x7FEB352D)) & mask
    h ^= h >> np.uint64(15)
    h = (h * np.uint64(0x846CA68B)) & mask
    h ^= h >> np.uint64(16)
    return np.float64(h >> np.uint64(8)) / 8388608.0 - 1.0
