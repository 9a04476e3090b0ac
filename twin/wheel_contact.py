"""Where wheels touch the wall: contacts computed from the exact radius r(theta, z), and handed to MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from twin.features.base import CENTER_THETA, CENTER_Z, HALF_BOX_ARC, HALF_BOX_Z
from twin.pipe import Wall, wall_radius_mm
from twin.robot_model import MM, WALL, RobotModel

SCAN_RAD = 1.2  # how far around the rim, from its outermost point, a contact is looked for
SCAN_POINTS = 49
STATIONS = 5  # across the wheel's width
PER_WHEEL = 2  # a wheel can bridge a gap on two points
APART_MM = 3.0  # nearer than this, two points are one contact
SLOPE_MM = 0.01  # half step of the differences that give the wall's normal
NEAR_MM = 50.0  # features are listed anew after so much travel

SOLREF = (0.002, 1.0)
SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)


@njit(cache=True)
def wheel_contacts(wall, hub_mm, axle, shape_mm):
    """Points where wheels press into the wall.

    A wheel is a disc with a crowned rim (`shape_mm`: radius, crown radius, half width). On a plain bore its one contact
    is the rim's middle; beside a feature the whole rim is searched, and a wheel may touch in two places.

    Args:
        wall: `Pipe.wall`.
        hub_mm: (n, 3) wheel centres.
        axle: (n, 3) unit axles; the wheel rolls forward by turning about its axle in the positive sense.
        shape_mm: (n, 3).

    Returns:
        Count; wheel of each contact; gap, mm, below zero; point on the rim, mm; and the contact's axes as rows: the
        wall's normal (inward), the rolling direction and the direction of the axle.
    """
    n = hub_mm.shape[0]
    wheel = np.empty(n * PER_WHEEL, dtype=np.int64)
    gap = np.empty(n * PER_WHEEL)
    point = np.empty((n * PER_WHEEL, 3))
    frame = np.empty((n * PER_WHEEL, 3, 3))
    found = np.empty((PER_WHEEL, 2))
    count = 0
    for i in range(n):
        outward, forward = _rim_axes(hub_mm[i], axle[i])
        if _beside_feature(wall, hub_mm[i], shape_mm[i, 0]):
            touching = _scan(wall, hub_mm[i], axle[i], outward, forward, shape_mm[i], found)
        else:
            found[0, 0] = _lowest(wall, hub_mm[i], axle[i], outward, forward, shape_mm[i], 0.0, 0.0)
            found[0, 1] = 0.0
            touching = 1
        for k in range(touching):
            p = _rim_point(hub_mm[i], axle[i], outward, forward, shape_mm[i], found[k, 0], found[k, 1])
            raw = _gap(wall, p)
            if raw >= 0.0:
                continue
            steep = _frame(wall, p, axle[i], frame[count])
            wheel[count], gap[count] = i, raw / steep
            point[count] = p
            count += 1
    return count, wheel, gap, point, frame


@njit(cache=True)
def _rim_axes(hub, axle):
    """Unit vectors in the wheel's plane: away from the pipe's axis, and the one that sin(phi) belongs to."""
    outward = np.array([hub[0], hub[1], 0.0])
    outward = outward - np.dot(outward, axle) * axle
    outward = outward / np.sqrt(np.dot(outward, outward))
    return outward, np.cross(axle, outward)


@njit(cache=True)
def _rim_point(hub, axle, outward, forward, shape, phi, across):
    radius = shape[0] - across * across / (2.0 * shape[1])
    return hub + radius * (np.cos(phi) * outward + np.sin(phi) * forward) + across * axle


@njit(cache=True)
def _gap(wall, p):
    """Radial distance from a point to the wall; below zero inside the material."""
    return wall_radius_mm(wall, np.arctan2(p[0], -p[1]), p[2]) - np.hypot(p[0], p[1])


@njit(cache=True)
def _rim_gap(wall, hub, axle, outward, forward, shape, phi, across):
    return _gap(wall, _rim_point(hub, axle, outward, forward, shape, phi, across))


@njit(cache=True)
def _beside_feature(wall, hub, radius):
    theta = np.arctan2(hub[0], -hub[1])
    for i in range(wall.codes.size):
        row = wall.rows[i]
        if abs(hub[2] - row[CENTER_Z]) > row[HALF_BOX_Z] + radius:
            continue
        turn = theta - row[CENTER_THETA]
        if abs(turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))) * wall.inner_radius <= row[HALF_BOX_ARC] + radius:
            return True
    return False


@njit(cache=True)
def _lowest(wall, hub, axle, outward, forward, shape, phi, across):
    """The angle of least gap near a given one, by parabolas through three points."""
    d = SCAN_RAD / (SCAN_POINTS - 1)
    for _ in range(3):
        left = _rim_gap(wall, hub, axle, outward, forward, shape, phi - d, across)
        here = _rim_gap(wall, hub, axle, outward, forward, shape, phi, across)
        right = _rim_gap(wall, hub, axle, outward, forward, shape, phi + d, across)
        bend = left - 2.0 * here + right
        if bend <= 0.0:
            break
        phi += min(max(0.5 * d * (left - right) / bend, -d), d)
        d *= 0.2
    return phi


@njit(cache=True)
def _scan(wall, hub, axle, outward, forward, shape, found):
    """The two deepest points of the whole rim (angle, place across) that are not one; returns how many there are."""
    depth = np.full(PER_WHEEL, np.inf)
    step = 2.0 * SCAN_RAD / (SCAN_POINTS - 1)
    gaps = np.empty(SCAN_POINTS)
    # Twice over the stations: the deepest point of all, then the deepest that stands apart from it.
    for k in range(PER_WHEEL):
        for s in range(STATIONS):
            across = shape[2] * (2.0 * s / (STATIONS - 1) - 1.0)
            for j in range(SCAN_POINTS):
                gaps[j] = _rim_gap(wall, hub, axle, outward, forward, shape, j * step - SCAN_RAD, across)
            for j in range(1, SCAN_POINTS - 1):
                if gaps[j] > gaps[j - 1] or gaps[j] > gaps[j + 1] or gaps[j] > 0.1:
                    continue
                phi = _lowest(wall, hub, axle, outward, forward, shape, j * step - SCAN_RAD, across)
                if k > 0 and np.hypot(shape[0] * (phi - found[0, 0]), across - found[0, 1]) < APART_MM:
                    continue
                gap = _rim_gap(wall, hub, axle, outward, forward, shape, phi, across)
                if gap < depth[k]:
                    depth[k] = gap
                    found[k, 0], found[k, 1] = phi, across
        if depth[k] == np.inf:
            return k
    return PER_WHEEL


@njit(cache=True)
def _frame(wall, p, axle, frame):
    """Fill the contact's axes; returns the slope of the gap along its normal, which turns a gap into a distance."""
    for j in range(3):
        step = np.zeros(3)
        step[j] = SLOPE_MM
        frame[0, j] = (_gap(wall, p + step) - _gap(wall, p - step)) / (2.0 * SLOPE_MM)
    steep = np.sqrt(np.dot(frame[0], frame[0]))
    frame[0] /= steep
    rolling = np.cross(axle, frame[0])
    frame[1] = rolling / np.sqrt(np.dot(rolling, rolling))
    frame[2] = np.cross(frame[0], frame[1])
    return steep


class WallContacts:
    """The wall as MuJoCo meets it: finds the wheels' contacts and adds them to its list.

    Call `inject` between `mj_collision` and `mj_makeConstraint`, never from `mjcb_contactfilter`.
    """

    def __init__(self, wall: Wall, robot: RobotModel, friction: tuple[float, float]):
        import mujoco

        self.wall, self.robot = wall, robot
        self.touching = np.zeros(robot.wheel_joint.size, dtype=bool)
        self._near, self._near_z_mm = wall, np.inf
        self._add = mujoco.mj_addContact
        self._contacts = [self._blank(int(geom), friction) for geom in robot.wheel_geom for _ in range(PER_WHEEL)]

    def _blank(self, geom: int, friction: tuple[float, float]) -> Any:
        import mujoco

        contact = mujoco.MjContact()
        contact.geom[:] = self.robot.model.geom(WALL).id, geom
        contact.geom1, contact.geom2 = contact.geom
        contact.dim = 3
        # Along the rolling direction and across it; the rest (twist, rolling) belongs to larger dimensions.
        contact.friction[:] = *friction, 1e-5, 1e-5, 1e-5
        contact.solref[:] = SOLREF
        contact.solimp[:] = SOLIMP
        contact.flex[:] = contact.elem[:] = contact.vert[:] = -1
        return contact

    def inject(self, data: Any) -> None:
        """Add this moment's contacts.

        Raises:
            RuntimeError: when MuJoCo's memory for contacts is full.
        """
        hub_mm = data.xanchor[self.robot.wheel_joint] / MM
        axle = data.xaxis[self.robot.wheel_joint]
        if not abs(hub_mm[0, 2] - self._near_z_mm) < NEAR_MM:
            self._near, self._near_z_mm = _nearby(self.wall, hub_mm[:, 2]), hub_mm[0, 2]
        count, wheel, gap_mm, point_mm, frame = wheel_contacts(self._near, hub_mm, axle, self.robot.wheel_shape_mm)
        self.touching[:] = False
        self.touching[wheel[:count]] = True
        dist, point = MM * gap_mm, MM * point_mm
        for k in range(count):
            contact = self._contacts[PER_WHEEL * wheel[k]]
            contact.dist, contact.pos, contact.frame = dist[k], point[k], frame[k].ravel()
            if self._add(self.robot.model, data, contact):
                raise RuntimeError("MuJoCo has no room for another contact")


def _nearby(wall: Wall, hub_z_mm: np.ndarray) -> Wall:
    """The wall with only the features that these wheels can meet before `NEAR_MM` of further travel."""
    reach = NEAR_MM + 50.0
    rows = wall.rows
    near = (rows[:, CENTER_Z] + rows[:, HALF_BOX_Z] > hub_z_mm.min() - reach) & (
        rows[:, CENTER_Z] - rows[:, HALF_BOX_Z] < hub_z_mm.max() + reach
    )
    return wall._replace(rows=rows[near], codes=wall.codes[near])
