"""Straight lines in the pipe: where a ray meets the wall, and whether the wall stands between it and a place.

For whoever follows rays: pictures, one pixel at a time; slit pixels and scoring, a frame at a time. Points and
directions are triples in the pipe frame, directions of length 1; every ray begins within the bore. In a bend that frame
is the pipe's at the sensor, and the wall bends away from its z axis.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from sensor_model.geometry import fast_arctan2
from twin.bends import CURVATURE, bent_direction, crowding, rows_about, unbent
from twin.features.base import CENTER_THETA, CENTER_Z, HALF_BOX_ARC, HALF_BOX_Z
from twin.pipe import Pipe, Wall, wall_radius_mm

ALONG_AXIS = 1e-8  # square of the share across the axis below which a ray never meets the wall
SHORTEST_STEP_MM = 0.1
STEP_PER_GAP = 0.15  # walls rise up to 6 mm per mm, so a ray may go a sixth of its gap before it can touch
LONG_STEPS = 1.8  # it may go further when the gaps at both ends, together, leave no room for a wall between
HIT_TOLERANCE_MM = 1e-6
SHADOW_LIFT_MM = 0.01
SHADOW_BEYOND_MM = 1e-4  # what lies less beyond the smallest radius is in nothing's shadow
SLOPE_STEP_MM = 0.005
HOLE_MM = 1e-5  # a wall this near to its outer radius is gone
REACH_RADII = 12.0  # what is further away along the pipe is neither lit nor seen
BENT_REACH_RADII = 60.0  # where a ray in a bend has met the wall at last
NEAR_BORE_MM = 0.1


def near_wall(pipe: Pipe, z_mm: float) -> Wall:
    """The wall with only those features that the camera can light or see from one place, its bends as seen there."""
    wall, reach = pipe.wall, REACH_RADII * pipe.bore_radius_mm
    near = np.abs(wall.rows[:, CENTER_Z] - z_mm) <= wall.rows[:, HALF_BOX_Z] + reach
    return wall._replace(codes=wall.codes[near], rows=wall.rows[near], axis=rows_about(pipe.axis, z_mm, reach))


@njit(cache=True, error_model="numpy", forceinline=True)
def point_at(origin, direction, s):
    """The point of a ray at a range."""
    return (origin[0] + s * direction[0], origin[1] + s * direction[1], origin[2] + s * direction[2])


@njit(cache=True, error_model="numpy")
def wall_ranges_mm(wall, origin, rays):
    """Range of each of (n, 3) rays to the wall, NaN for one along the axis; all have one origin."""
    ranges, uneven = _plain_ranges_mm(wall, origin, rays)
    which = np.flatnonzero(uneven)
    origins, directions = np.empty((which.size, 3)), rays[which]
    first, last = np.empty(which.size), np.empty(which.size)
    for k in range(which.size):
        origins[k, 0], origins[k, 1], origins[k, 2] = origin
        first[k], last[k] = stretch_mm(wall, origin, _row(directions, k))
    inside, gap, outside, beyond = _march_together(wall, origins, directions, first, last, SHORTEST_STEP_MM)
    for k, i in enumerate(which):
        ranges[i] = _closed_in(wall, origin, _row(directions, k), inside[k], gap[k], outside[k], beyond[k])
    return ranges


@njit(cache=True, error_model="numpy")
def _plain_ranges_mm(wall, origin, rays):
    """Ranges to the round bore, and which rays may meet anything else.

    No compiled function is called in here that is not put inline: a call counts references to the wall's arrays, at
    several times the cost of a ray.
    """
    n = rays.shape[0]
    ranges, uneven = np.full(n, np.nan), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        direction = (rays[i, 0], rays[i, 1], rays[i, 2])
        first, last = stretch_mm(wall, origin, direction)
        if first >= 0:
            ranges[i] = _plain_range_mm(wall, origin, direction, first)
            uneven[i] = _near_feature(wall, origin, direction, first, last)
    if wall.ovality != 0.0 or is_bent(wall):
        uneven[:] = ranges >= 0
    return ranges, uneven


@njit(cache=True, error_model="numpy")
def in_shadow(wall, points, place):
    """Whether the wall stands between each of its (n, 3) points and a place."""
    shaded = points[:, 0] ** 2 + points[:, 1] ** 2 > (wall.smallest_radius + SHADOW_BEYOND_MM) ** 2
    if is_bent(wall):
        for row in range(shaded.size):
            shaded[row] = _can_be_shaded(wall, _row(points, row), place)
    which = np.flatnonzero(shaded)
    origins, towards, reach = np.empty((which.size, 3)), np.empty((which.size, 3)), np.empty(which.size)
    for k, i in enumerate(which):
        start, direction, reach[k] = _sight_line(wall, _row(points, i), place)
        origins[k, 0], origins[k, 1], origins[k, 2] = start
        towards[k, 0], towards[k, 1], towards[k, 2] = direction
    _, _, _, beyond = _march_together(wall, origins, towards, np.zeros(which.size), reach, SHORTEST_STEP_MM / 2)
    shaded[which] = beyond < 0
    return shaded


@njit(cache=True, error_model="numpy", forceinline=True)
def _row(points, i):
    return (points[i, 0], points[i, 1], points[i, 2])


@njit(cache=True, error_model="numpy")
def _march_together(wall, origins, directions, first, last, shortest):
    """The bracket of each ray's first crossing, and the clearance at its two ends: as `_bracket`, of many rays.

    One stride of each in turn: the processor begins on the next ray while it waits for the last one.
    """
    n = first.size
    inside, gap = first.copy(), np.empty(n)
    for k in range(n):
        gap[k] = _clearance(wall, _row(origins, k), _row(directions, k), first[k])
    outside, beyond = inside.copy(), gap.copy()
    going = np.flatnonzero(gap > HIT_TOLERANCE_MM)
    count = going.size
    while count > 0:
        still = 0
        for k in going[:count]:
            origin, direction = _row(origins, k), _row(directions, k)
            outside[k], beyond[k] = _stride(wall, origin, direction, inside[k], gap[k], shortest, last[k])
            if beyond[k] > HIT_TOLERANCE_MM and outside[k] < last[k]:
                inside[k], gap[k] = outside[k], beyond[k]
                going[still] = k
                still += 1
        count = still
    return inside, gap, outside, beyond


@njit(cache=True, error_model="numpy", forceinline=True)
def is_bent(wall):
    """Whether the wall is about an axis that is no straight line."""
    return wall.axis.shape[0] > 0


@njit(cache=True, error_model="numpy", forceinline=True)
def stretch_mm(wall, origin, direction):
    """Ranges between which a ray can meet the wall: smallest radius to outer; -1 and -1 for one along the axis."""
    if is_bent(wall):
        return _bent_stretch_mm(wall, origin, direction)
    radial2 = direction[0] ** 2 + direction[1] ** 2
    if radial2 < ALONG_AXIS:
        return -1.0, -1.0
    last = _leave_cylinder(origin, direction, radial2, wall.outer_radius)
    if origin[0] ** 2 + origin[1] ** 2 >= wall.smallest_radius**2:
        return 0.0, last
    return _leave_cylinder(origin, direction, radial2, wall.smallest_radius), last


@njit(cache=True, error_model="numpy", forceinline=True)
def _bent_stretch_mm(wall, origin, direction):
    """As `stretch_mm` in a bend: no place is nearer to the smallest radius than that lies further from the axis."""
    s, farthest = 0.0, BENT_REACH_RADII * wall.inner_radius
    while s < farthest:
        x, y, z = point_at(origin, direction, s)
        x, y, z = unbent(wall.axis, x, y, z)
        gap = wall.smallest_radius - np.sqrt(x * x + y * y)
        if gap < NEAR_BORE_MM:
            return s, s + farthest
        s += gap
    return -1.0, -1.0


@njit(cache=True, error_model="numpy", forceinline=True)
def wall_range_mm(wall, origin, direction, first, last):
    """Range to the first crossing of the wall within a ray's stretch."""
    if _is_uneven(wall, origin, direction, first, last):
        return _march(wall, origin, direction, first, last)
    return _plain_range_mm(wall, origin, direction, first)


@njit(cache=True, error_model="numpy", forceinline=True)
def _is_uneven(wall, origin, direction, first, last):
    """Whether a ray may meet anything but the round bore, so that its range has no closed form."""
    return wall.ovality != 0.0 or is_bent(wall) or _near_feature(wall, origin, direction, first, last)


@njit(cache=True, error_model="numpy", forceinline=True)
def _plain_range_mm(wall, origin, direction, first):
    """Range to the round bore; `first` is that to the wall's smallest radius."""
    if wall.smallest_radius == wall.inner_radius or is_bent(wall):
        return first
    radial2 = direction[0] ** 2 + direction[1] ** 2
    return _leave_cylinder(origin, direction, radial2, wall.inner_radius)


@njit(cache=True, error_model="numpy")
def is_free(wall, origin, direction, range_mm):
    """Whether a ray reaches a range before it meets the wall."""
    x, y, _ = point_at(origin, direction, range_mm)
    if x * x + y * y < wall.smallest_radius**2:
        return True
    first, last = stretch_mm(wall, origin, direction)
    return first >= 0 and wall_range_mm(wall, origin, direction, first, last) > range_mm


@njit(cache=True, error_model="numpy", forceinline=True)
def is_hole(wall, x, y):
    """Whether the wall is gone at points of it; with a backing, they show that instead."""
    return np.sqrt(x**2 + y**2) >= wall.outer_radius - HOLE_MM


@njit(cache=True, error_model="numpy", forceinline=True)
def _leave_cylinder(origin, direction, radial2, radius):
    b = origin[0] * direction[0] + origin[1] * direction[1]
    c = origin[0] ** 2 + origin[1] ** 2 - radius**2
    return (-b + np.sqrt(b * b - radial2 * c)) / radial2


@njit(cache=True, error_model="numpy", forceinline=True)
def _near_feature(wall, origin, direction, first, last):
    """Whether a stretch of a ray passes the box of any feature."""
    z_a, z_b = origin[2] + first * direction[2], origin[2] + last * direction[2]
    low_z, high_z = min(z_a, z_b), max(z_a, z_b)
    for i in range(wall.codes.size):
        center, half = wall.rows[i, CENTER_Z], wall.rows[i, HALF_BOX_Z]
        if high_z < center - half or low_z > center + half:
            continue
        middle = 0.5 * (first + last)
        theta = np.arctan2(origin[0] + middle * direction[0], -(origin[1] + middle * direction[1]))
        begin = np.arctan2(origin[0] + first * direction[0], -(origin[1] + first * direction[1]))
        spread = wall.inner_radius * abs(wrapped(begin - theta)) * 1.5
        if wall.inner_radius * abs(wrapped(theta - wall.rows[i, CENTER_THETA])) <= wall.rows[i, HALF_BOX_ARC] + spread:
            return True
    return False


@njit(cache=True, error_model="numpy", forceinline=True)
def wrapped(angle):
    """`geometry.wrap_rad` for compiled code."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


@njit(cache=True, error_model="numpy", forceinline=True)
def _clearance(wall, origin, direction, s):
    """How far a point of a ray is inside the wall, mm; negative beyond it."""
    x, y = origin[0] + s * direction[0], origin[1] + s * direction[1]
    x, y, z = unbent(wall.axis, x, y, origin[2] + s * direction[2])
    return wall_radius_mm(wall, fast_arctan2(x, -y), z) - np.sqrt(x * x + y * y)


@njit(cache=True, error_model="numpy")
def _march(wall, origin, direction, first, last):
    """First crossing between two ranges: steps that the gap allows, then false position."""
    inside, gap, outside, beyond = _bracket(wall, origin, direction, first, last, SHORTEST_STEP_MM)
    return _closed_in(wall, origin, direction, inside, gap, outside, beyond)


@njit(cache=True, error_model="numpy", forceinline=True)
def _bracket(wall, origin, direction, first, last, shortest):
    """Ranges just before and just beyond the first crossing, each with its clearance; both `first` when on the wall."""
    inside, gap = first, _clearance(wall, origin, direction, first)
    outside, beyond = inside, gap
    while beyond > HIT_TOLERANCE_MM and outside < last:
        inside, gap = outside, beyond
        outside, beyond = _stride(wall, origin, direction, inside, gap, shortest, last)
    return inside, gap, outside, beyond


@njit(cache=True, error_model="numpy", forceinline=True)
def _stride(wall, origin, direction, s, gap, shortest, last):
    """The next place of a ray that no wall can hide before, and the clearance there."""
    for share in (LONG_STEPS * STEP_PER_GAP, STEP_PER_GAP):
        step = max(shortest, share * gap)
        there = min(s + step, last)
        clearance = _clearance(wall, origin, direction, there)
        if step == shortest or STEP_PER_GAP * (gap + clearance) >= step:
            break
    return there, clearance


@njit(cache=True, error_model="numpy")
def _closed_in(wall, origin, direction, inside, gap, outside, beyond):
    """The crossing between a place inside the wall and one beyond it: false position, the Illinois way."""
    last = 0
    while outside - inside > HIT_TOLERANCE_MM and beyond < 0:
        middle = inside + (outside - inside) * gap / (gap - beyond)
        here = _clearance(wall, origin, direction, middle)
        if abs(here) < HIT_TOLERANCE_MM:
            return middle
        # an end that stays twice counts half, so that it moves as well
        if here > 0:
            beyond *= 0.5 if last > 0 else 1.0
            inside, gap, last = middle, here, 1
        else:
            gap *= 0.5 if last < 0 else 1.0
            outside, beyond, last = middle, here, -1
    return outside


@njit(cache=True, error_model="numpy")
def inward_normal(wall, point):
    """Unit normal of rho = r(theta, z), towards the axis."""
    x, y, z = unbent(wall.axis, point[0], point[1], point[2])
    normal = _inward_normal(wall, x, y, z, crowding(wall.axis, point[0], point[1], point[2]))
    return bent_direction(wall.axis, point, normal)


@njit(cache=True, error_model="numpy", forceinline=True)
def _inward_normal(wall, x, y, z, crowded):
    """`inward_normal` in the pipe's own axes at a place of it, where so much way of the world is 1 mm of the axis."""
    rho = np.sqrt(x**2 + y**2)
    if wall.ovality == 0.0 and rho < wall.smallest_radius + HIT_TOLERANCE_MM:
        return (-x / rho, -y / rho, 0.0)
    theta = fast_arctan2(x, -y)
    turn = SLOPE_STEP_MM / rho
    slope_z = wall_radius_mm(wall, theta, z + SLOPE_STEP_MM) - wall_radius_mm(wall, theta, z - SLOPE_STEP_MM)
    slope_arc = wall_radius_mm(wall, theta + turn, z) - wall_radius_mm(wall, theta - turn, z)
    slope_z, slope_arc = slope_z / (2 * SLOPE_STEP_MM * crowded), slope_arc / (2 * SLOPE_STEP_MM)
    length = np.sqrt(1 + slope_z**2 + slope_arc**2)
    sine, cosine = x / rho, y / rho
    return ((-sine - slope_arc * cosine) / length, (-cosine + slope_arc * sine) / length, slope_z / length)


@njit(cache=True, error_model="numpy", forceinline=True)
def point_in_shadow(wall, point, place):
    """Whether the wall stands between one of its points and a place."""
    return _can_be_shaded(wall, point, place) and _blocked(wall, point, place)


@njit(cache=True, error_model="numpy", forceinline=True)
def _can_be_shaded(wall, point, place):
    """Whether a point of the wall can lie in a shadow; those of a round bore, being convex, cannot.

    In a bend a sight line of length d strays by up to half its curvature times d^2 from what it were in a straight
    pipe, and the bore can shade where that is more than the place's own clearance.
    """
    x, y, _ = unbent(wall.axis, point[0], point[1], point[2])
    if is_bent(wall):
        u, v, _ = unbent(wall.axis, place[0], place[1], place[2])
        d2 = (point[0] - place[0]) ** 2 + (point[1] - place[1]) ** 2 + (point[2] - place[2]) ** 2
        if 0.5 * wall.axis[:, CURVATURE].max() * d2 >= wall.smallest_radius - np.sqrt(u * u + v * v):
            return True
    return np.sqrt(x**2 + y**2) > wall.smallest_radius + SHADOW_BEYOND_MM


@njit(cache=True, error_model="numpy")
def _blocked(wall, point, place):
    """Whether the sight line from a point of the wall to a place leaves the bore on its way."""
    origin, towards, reach = _sight_line(wall, point, place)
    _, _, _, beyond = _bracket(wall, origin, towards, 0.0, reach, SHORTEST_STEP_MM / 2)
    return beyond < 0


@njit(cache=True, error_model="numpy")
def _sight_line(wall, point, place):
    """Origin just above a point of the wall, direction to a place, and the range within which the wall can shade it."""
    origin = point_at(point, inward_normal(wall, point), SHADOW_LIFT_MM)
    x, y, z = place[0] - origin[0], place[1] - origin[1], place[2] - origin[2]
    length = np.sqrt(x * x + y * y + z * z)
    towards = (x / length, y / length, z / length)
    if is_bent(wall):
        return origin, towards, length
    # nearer to the axis than the wall's smallest radius nothing can shade any more
    a = towards[0] ** 2 + towards[1] ** 2
    b = origin[0] * towards[0] + origin[1] * towards[1]
    root = b * b - a * (origin[0] ** 2 + origin[1] ** 2 - wall.smallest_radius**2)
    if b < 0.0 and root > 0.0:
        return origin, towards, min((-b - np.sqrt(root)) / a, length)
    return origin, towards, length
