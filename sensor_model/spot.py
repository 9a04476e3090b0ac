"""What a pixel's piece of a lit surface throws back to the camera: the projector's bands, by way of any glass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sensor_model.glass import ORIGIN, Tube, mirrored, seems_at, through, towards
from sensor_model.optics import REFERENCE_RANGE_MM
from sensor_model.slide_print import edge_shift
from sensor_model.wall_rays import wrapped

BOX_PER_SIGMA = 3.4641016151377544  # width of a box with a standard deviation of one
GRAZING = 0.05  # cosine below which a surface is taken to be seen no flatter
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
    tube: Tube


class Sight(NamedTuple):
    """A pixel's ray in the pipe frame from where it goes straight: start, direction, mm before, share that passes."""

    start: Triple
    direction: Triple
    before_mm: float
    passed: float


class Path(NamedTuple):
    """How light arrives at a place, pipe frame: where a straight line from the apex would have it, and from where.

    `side` is -1 for light that comes by way of the far side of the tube, else 1.
    """

    aimed: Triple
    source: Triple
    passed: float
    side: float


class Spot(NamedTuple):
    """A pixel's piece of a surface on the slide: tangent of its half angle, how much of it, azimuth; and its light.

    `per_mm` is how much the tangent changes with a millimetre on the surface, `mirrored` the light it throws back as a
    mirror does, in the light's own colour.
    """

    tangent: float
    footprint: float
    azimuth: float
    level: float
    per_mm: float
    mirrored: float


def rows_of(matrix: np.ndarray) -> Rows:
    """A matrix as compiled code reads it here."""
    return tuple(tuple(row) for row in matrix.tolist())


@njit(cache=True, error_model="numpy", forceinline=True)
def sight_along(view, direction):
    """The sight of a pixel whose ray leaves the camera in a direction of the pipe frame."""
    if not view.tube.is_there:
        return Sight(view.eye, direction, 0.0, 1.0)
    start, onward, passed = through(view.tube, ORIGIN, _back(view.R_pipe_camera, direction))
    before_mm = np.sqrt(dot(start, start))
    return Sight(_placed(view, start), _onward(view, onward), before_mm, passed)


@njit(cache=True, error_model="numpy", forceinline=True)
def path_to(view, point):
    """The light's way from the projector to a place."""
    if not view.tube.is_there:
        return Path(point, view.apex, 1.0, 1.0)
    apex, place = _seen(view, view.apex), _seen(view, point)
    direction, start, passed = towards(view.tube, apex, place)
    return Path(_placed(view, seems_at(apex, place, direction)), _placed(view, start), passed, 1.0)


@njit(cache=True, error_model="numpy")
def ghost_to(view, point):
    """The light's way by the far side of the tube."""
    aimed, source, passed = mirrored(view.tube, _seen(view, view.apex), _seen(view, point))
    return Path(_placed(view, aimed), _placed(view, source), passed, -1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def light_spot(rgb, beam, spot):
    """Add the light that a pixel's piece of a surface throws back."""
    tangent, footprint, level = spot.tangent, spot.footprint, spot.level
    if beam.jag_rad > 0:
        tangent += _jag(beam, tangent, spot.azimuth) * (1 + tangent * tangent)
    spread = 0.0
    if beam.translucency > 0:
        spread = np.hypot(footprint, BOX_PER_SIGMA * beam.translucency_mm * spot.per_mm)
    for band in range(len(beam.lit_from)):
        share = _of_band(beam, band, tangent, footprint, level)
        if beam.translucency > 0:
            under = _of_band(beam, band, tangent, spread, level)
            share += beam.translucency * (under - share)
        if share > 0:
            for channel in range(3):
                rgb[channel] += share * beam.colors[band][channel]
        if spot.mirrored > 0:
            share = _of_band(beam, band, tangent, footprint, spot.mirrored)
            for channel in range(3):
                rgb[channel] += share * beam.lights[band][channel]


@njit(cache=True, error_model="numpy", forceinline=True)
def _of_band(beam, band, tangent, footprint, level):
    begin, end = tangent - footprint / 2, tangent + footprint / 2
    return max(level * (min(end, beam.lit_to[band]) - max(begin, beam.lit_from[band])) / footprint, 0.0)


@njit(cache=True, error_model="numpy")
def turned(R, x, y, z):
    """A matrix's rows times a triple."""
    return (
        R[0][0] * x + R[0][1] * y + R[0][2] * z,
        R[1][0] * x + R[1][1] * y + R[1][2] * z,
        R[2][0] * x + R[2][1] * y + R[2][2] * z,
    )


@njit(cache=True, error_model="numpy")
def dot(a, b):
    """Scalar product of two triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def aim(view, beam, path, sight, range_mm, right, down, point, normal):
    """Where a pixel's piece of a surface lies on the slide, and its light."""
    apex, direction = view.apex, sight.direction
    came = (point[0] - path.source[0], point[1] - path.source[1], point[2] - path.source[2])
    facing = -dot(normal, came) / np.sqrt(dot(came, came))
    looking = dot(normal, direction)
    if facing <= 0 or looking >= 0:
        return Spot(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    to = (path.aimed[0] - apex[0], path.aimed[1] - apex[1], path.aimed[2] - apex[2])
    distance = np.sqrt(dot(to, to))
    M = view.R_projector_pipe
    x, y, along = turned(M, to[0], to[1], to[2])
    across = np.sqrt(x * x + y * y)
    tangent = across / along
    # gradient of the tangent on the wall, then per pixel: the footprint of one pixel on the slide
    along_right, along_down, steepness2, along_normal = 0.0, 0.0, 0.0, 0.0
    n_right, n_down = dot(normal, right) / looking, dot(normal, down) / looking
    reach_mm = range_mm + sight.before_mm
    for i in range(3):
        gradient = (path.side * (M[0][i] * x + M[1][i] * y) / across - tangent * M[2][i]) / along
        along_right += gradient * reach_mm * (right[i] - direction[i] * n_right)
        along_down += gradient * reach_mm * (down[i] - direction[i] * n_down)
        steepness2 += gradient * gradient
        along_normal += gradient * normal[i]
    footprint = max(np.sqrt(along_right**2 + along_down**2), 1e-6)
    azimuth = np.arctan2(x, -y)
    level, shine = _strut(beam, azimuth), 0.0
    if level > 0:
        passed, reaches = sight.passed * path.passed, (REFERENCE_RANGE_MM / distance) ** beam.distance_power
        if beam.gloss > 0:
            shine = passed * level * reaches * _mirrored_share(beam, came, direction, normal)
        level *= facing**beam.angle_power * reaches
        level *= passed
    return Spot(tangent, footprint, azimuth, level, np.sqrt(max(steepness2 - along_normal**2, 0.0)), shine)


@njit(cache=True, error_model="numpy")
def dimmed(spot, share):
    """The same on a surface that throws less back."""
    return Spot(spot.tangent, spot.footprint, spot.azimuth, share * spot.level, spot.per_mm, share * spot.mirrored)


@njit(cache=True, error_model="numpy")
def _mirrored_share(beam, came, direction, normal):
    """What a glossy surface throws back towards the eye, a white matt one that faces the light being 1.

    Blinn-Phong's spread of facets, normalised, with Schlick's share of what each of them mirrors.
    """
    length = np.sqrt(dot(came, came))
    half = (
        -came[0] / length - direction[0],
        -came[1] / length - direction[1],
        -came[2] / length - direction[2],
    )
    size = np.sqrt(dot(half, half))
    steep, onto = dot(half, normal) / size, -dot(half, direction) / size
    facets = beam.gloss + (1.0 - beam.gloss) * (1.0 - onto) ** 5
    spread = 0.125 * (beam.gloss_power + 2.0) * max(steep, 0.0) ** beam.gloss_power
    return facets * spread / max(-dot(normal, direction), GRAZING)


@njit(cache=True, error_model="numpy", forceinline=True)
def _strut(beam, azimuth):
    if beam.strut_half_width_rad == 0.0:
        return 1.0
    beyond = abs(wrapped(azimuth - beam.strut_azimuth_rad)) - beam.strut_half_width_rad
    return min(max(beyond / max(beam.strut_softness_rad, 1e-6) + 0.5, 0.0), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy")
def _back(R, v):
    """R transposed times v."""
    return (
        R[0][0] * v[0] + R[1][0] * v[1] + R[2][0] * v[2],
        R[0][1] * v[0] + R[1][1] * v[1] + R[2][1] * v[2],
        R[0][2] * v[0] + R[1][2] * v[1] + R[2][2] * v[2],
    )


@njit(cache=True, error_model="numpy")
def _seen(view, point):
    """A place of the pipe frame in the camera's."""
    eye = view.eye
    return _back(view.R_pipe_camera, (point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]))


@njit(cache=True, error_model="numpy")
def _onward(view, direction):
    return turned(view.R_pipe_camera, direction[0], direction[1], direction[2])


@njit(cache=True, error_model="numpy")
def _placed(view, point):
    """A place of the camera frame in the pipe's."""
    eye, out = view.eye, _onward(view, point)
    return (eye[0] + out[0], eye[1] + out[1], eye[2] + out[2])
