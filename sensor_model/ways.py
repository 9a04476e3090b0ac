"""The ways that light takes between sensor and wall: straight, through the glass, by its ghosts, and by the water."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit

from sensor_model.glass import ORIGIN, Glass, Tube, check_inside, mirrored, seems_at, through, towards, tube_of
from sensor_model.rig import Rig
from sensor_model.wall_rays import is_free, point_at
from sensor_model.water import (
    Water,
    WaterSurface,
    above_mm,
    change_in_water,
    check_dry,
    crossing,
    into_water,
    mirrored_place,
    mirrored_way,
    mirrors,
    range_to_water,
    water_surface,
)
from twin.pipe import Pipe

WATER_STEPS = 5  # of aiming through the glass at where the light enters the water
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
    surface: WaterSurface


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


def rows_of(matrix: np.ndarray) -> Rows:
    """A matrix as compiled code reads it here."""
    return tuple(tuple(row) for row in matrix.tolist())


def view_of(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, glass: Glass, water: Water) -> View:
    """Camera and projector at a pose.

    Raises:
        ValueError: when one of them lies outside the bore or the glass tube, or in the water.
    """
    check_inside(pipe, T_pipe_camera, rig, glass)
    check_dry(pipe, T_pipe_camera, rig, water, glass)
    T_pipe_projector = T_pipe_camera @ rig.projector.T_camera_projector
    return View(
        rows_of(T_pipe_camera[:3, :3]),
        tuple(T_pipe_camera[:3, 3].tolist()),
        tuple(T_pipe_projector[:3, 3].tolist()),
        rows_of(T_pipe_projector[:3, :3].T),
        pipe.start_mm,
        pipe.end_mm,
        pipe.backed,
        tube_of(glass),
        water_surface(water, pipe),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def sight_along(view, direction):
    """The sight of a pixel whose ray leaves the camera in a direction of the pipe frame."""
    if not view.tube.is_there:
        return Sight(view.eye, direction, 0.0, 1.0)
    return light_along(view, ORIGIN, turned_back(view, direction))


@njit(cache=True, error_model="numpy", forceinline=True)
def light_along(view, place, direction):
    """The same for light that leaves a place in the tube; place and direction in the camera frame."""
    if not view.tube.is_there:
        return Sight(_placed(view, place), _onward(view, direction), 0.0, 1.0)
    start, onward, passed = through(view.tube, place, direction)
    x, y, z = start[0] - place[0], start[1] - place[1], start[2] - place[2]
    return Sight(_placed(view, start), _onward(view, onward), np.sqrt(x * x + y * y + z * z), passed)


@njit(cache=True, error_model="numpy", forceinline=True)
def path_to(view, point):
    """The light's way from the projector to a place, in the water too."""
    if is_under(view, point):
        direction, source, passed = way_under(view, view.apex, point)
        return Path(seems_at(view.apex, point, direction), source, passed, 1.0)
    if not view.tube.is_there:
        return Path(point, view.apex, 1.0, 1.0)
    apex, place = seen_from_camera(view, view.apex), seen_from_camera(view, point)
    direction, start, passed = towards(view.tube, apex, place)
    return Path(_placed(view, seems_at(apex, place, direction)), _placed(view, start), passed, 1.0)


@njit(cache=True, error_model="numpy")
def ghost_to(view, point):
    """The light's way by the far side of the tube."""
    aimed, source, passed = mirrored(view.tube, seen_from_camera(view, view.apex), seen_from_camera(view, point))
    return Path(_placed(view, aimed), _placed(view, source), passed, -1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def is_under(view, point):
    """Whether a place is in the water."""
    return view.surface.is_there and above_mm(view.surface, point) < 0.0


@njit(cache=True, error_model="numpy")
def way_under(view, place, point):
    """The way from a place in the tube to one in the water: first direction, where it enters, share that passes."""
    surface, passed, start = view.surface, 1.0, place
    enters = crossing(surface, place, point)
    direction = _unit(place, enters)
    if view.tube.is_there:
        inside = seen_from_camera(view, place)
        for _ in range(WATER_STEPS):
            aimed, exit_at, passed = towards(view.tube, inside, seen_from_camera(view, enters))
            direction, start = _onward(view, aimed), _placed(view, exit_at)
            enters = crossing(surface, start, point)
    deep = (point[0] - enters[0], point[1] - enters[1], point[2] - enters[2])
    passed *= np.exp(-surface.absorption_per_mm * np.sqrt(dot(deep, deep)))
    return direction, enters, passed * (1.0 - mirrors(surface, _unit(start, enters)))


@njit(cache=True, error_model="numpy")
def path_by_water(view, point):
    """The light's way to a place above the water by its mirror; `aimed` is for the place's mirror image."""
    surface, apex = view.surface, view.apex
    place = mirrored_place(surface, point)
    aimed, start, passed = place, apex, 1.0
    if view.tube.is_there:
        o = seen_from_camera(view, apex)
        direction, start, passed = towards(view.tube, o, seen_from_camera(view, place))
        aimed, start = seems_at(apex, place, _onward(view, direction)), _placed(view, start)
    way = _unit(start, place)
    bounces = point_at(start, way, range_to_water(surface, start, way))
    return Path(aimed, bounces, passed * mirrors(surface, way), 1.0)


@njit(cache=True, error_model="numpy")
def reaches_water(wall, place, enters):
    """Whether the wall lets light from a place in the air pass to a place on the water."""
    x, y, z = enters[0] - place[0], enters[1] - place[1], enters[2] - place[2]
    return is_free(wall, place, _unit(place, enters), np.sqrt(x * x + y * y + z * z))


@njit(cache=True, error_model="numpy", forceinline=True)
def range_to_pool(wall, view, sight):
    """Range of a sight to the water, mm; -1 where it meets the wall first, or there is none."""
    if not view.surface.is_there:
        return -1.0
    range_mm = range_to_water(view.surface, sight.start, sight.direction)
    return range_mm if range_mm > 0.0 and is_free(wall, sight.start, sight.direction, range_mm) else -1.0


@njit(cache=True, error_model="numpy", forceinline=True)
def sight_by_mirror(view, sight, range_mm):
    """What of a sight the water mirrors, from there."""
    surface, direction = view.surface, sight.direction
    start = point_at(sight.start, direction, range_mm)
    share = mirrors(surface, direction)
    return Sight(start, mirrored_way(surface, direction), sight.before_mm + range_mm, share * sight.passed)


@njit(cache=True, error_model="numpy", forceinline=True)
def sight_under(view, sight, range_mm):
    """What of a sight goes on in the water; of the light there, an index-squared part comes out in a direction."""
    surface, direction = view.surface, sight.direction
    start = point_at(sight.start, direction, range_mm)
    share = (1.0 - mirrors(surface, direction)) / surface.refraction**2
    return Sight(start, into_water(surface, direction), sight.before_mm + range_mm, share * sight.passed)


@njit(cache=True, error_model="numpy", forceinline=True)
def weakened(view, sight, range_mm):
    """The same at the end of its way in the water."""
    share = np.exp(-view.surface.absorption_per_mm * range_mm)
    return Sight(sight.start, sight.direction, sight.before_mm, share * sight.passed)


@njit(cache=True, error_model="numpy", forceinline=True)
def change_under(view, sight, under, range_mm, change):
    """How a sight's direction would have to change to move its end in the water as a change in the air does."""
    up, direction = view.surface.up, sight.direction
    air_mm, lost = under.before_mm, dot(up, change) / dot(up, direction)
    bent = change_in_water(view.surface, under.direction, change)
    reach_mm = air_mm + range_mm
    return (
        (air_mm * (change[0] - lost * direction[0]) + range_mm * bent[0]) / reach_mm,
        (air_mm * (change[1] - lost * direction[1]) + range_mm * bent[1]) / reach_mm,
        (air_mm * (change[2] - lost * direction[2]) + range_mm * bent[2]) / reach_mm,
    )


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


@njit(cache=True, error_model="numpy")
def turned_back(view, v):
    """A direction of the pipe frame in the camera's."""
    R = view.R_pipe_camera
    return (
        R[0][0] * v[0] + R[1][0] * v[1] + R[2][0] * v[2],
        R[0][1] * v[0] + R[1][1] * v[1] + R[2][1] * v[2],
        R[0][2] * v[0] + R[1][2] * v[1] + R[2][2] * v[2],
    )


@njit(cache=True, error_model="numpy")
def seen_from_camera(view, point):
    """A place of the pipe frame in the camera's."""
    eye = view.eye
    return turned_back(view, (point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]))


@njit(cache=True, error_model="numpy")
def _onward(view, direction):
    return turned(view.R_pipe_camera, direction[0], direction[1], direction[2])


@njit(cache=True, error_model="numpy")
def _placed(view, point):
    """A place of the camera frame in the pipe's."""
    eye, out = view.eye, _onward(view, point)
    return (eye[0] + out[0], eye[1] + out[1], eye[2] + out[2])


@njit(cache=True, error_model="numpy", forceinline=True)
def _unit(a, b):
    """The direction from one place to another."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = np.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)
