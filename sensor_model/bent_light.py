"""Many rays at once by way of glass and water: where light ends and seems to be, and what a picture's rays show."""

from __future__ import annotations

import numpy as np
from numba import njit

from sensor_model.glass import ORIGIN, towards
from sensor_model.wall_rays import point_at, point_in_shadow, stretch_mm, wall_range_mm
from sensor_model.ways import (
    is_under,
    light_along,
    path_to,
    range_to_pool,
    reaches_water,
    seen_from_camera,
    sight_under,
    turned_back,
    way_under,
)


@njit(cache=True, error_model="numpy")
def seen_ends(wall, view, origin, rays):
    """Of (n, 3) rays of light from one place, camera frame: where they end, as a camera sees it.

    Returns the points of the wall (pipe frame), NaN for none, the directions in which the camera sees them (camera
    frame), their straight distances from it, and whether nothing hides them.
    """
    n = rays.shape[0]
    ends, seems = np.full((n, 3), np.nan), np.zeros((n, 3))
    ranges, seen = np.ones(n), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        sight = _in_water(wall, view, light_along(view, origin, (rays[i, 0], rays[i, 1], rays[i, 2])))
        first, last = stretch_mm(wall, sight.start, sight.direction)
        if not first >= 0:
            continue
        point = point_at(sight.start, sight.direction, wall_range_mm(wall, sight.start, sight.direction, first, last))
        place = seen_from_camera(view, point)
        if is_under(view, point):
            direction, enters, _ = way_under(view, view.eye, point)
            aim = turned_back(view, direction)
            seen[i] = reaches_water(wall, view.eye, enters) and not point_in_shadow(wall, point, enters)
        else:
            aim = towards(view.tube, ORIGIN, place)[0] if view.tube.is_there else place
            seen[i] = not point_in_shadow(wall, point, view.eye)
        ranges[i] = np.sqrt(place[0] ** 2 + place[1] ** 2 + place[2] ** 2)
        length = np.sqrt(aim[0] ** 2 + aim[1] ** 2 + aim[2] ** 2)
        for k in range(3):
            ends[i, k], seems[i, k] = point[k], aim[k] / length
    return ends, seems, ranges, seen


@njit(cache=True, error_model="numpy")
def shown_places(wall, view, rays):
    """What (n, 3) rays of the camera show, through the surface where they meet water.

    Returns the places to which a straight line from the projector would have to go to light them (camera frame),
    how far along the pipe they are (mm from the camera), and the length of the way.
    """
    n = rays.shape[0]
    aimed, along, ways_mm = np.full((n, 3), np.nan), np.full(n, np.nan), np.full(n, np.nan)
    for i in range(n):
        sight = _in_water(wall, view, light_along(view, ORIGIN, (rays[i, 0], rays[i, 1], rays[i, 2])))
        first, last = stretch_mm(wall, sight.start, sight.direction)
        if not first >= 0:
            continue
        range_mm = wall_range_mm(wall, sight.start, sight.direction, first, last)
        point = point_at(sight.start, sight.direction, range_mm)
        place = seen_from_camera(view, path_to(view, point).aimed)
        along[i], ways_mm[i] = point[2] - view.eye[2], sight.before_mm + range_mm
        for k in range(3):
            aimed[i, k] = place[k]
    return aimed, along, ways_mm


@njit(cache=True, error_model="numpy", forceinline=True)
def _in_water(wall, view, sight):
    pool_mm = range_to_pool(wall, view, sight)
    return sight if pool_mm < 0 else sight_under(view, sight, pool_mm)
