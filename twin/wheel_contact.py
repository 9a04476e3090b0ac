"""Where wheels touch the wall: contacts computed from the exact radius r(theta, z), and handed to MuJoCo."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from twin.bends import Follower, bent_direction, unbent
from twin.features.base import CENTER_THETA, CENTER_Z, FIRST_OWN, HALF_BOX_ARC, HALF_BOX_Z
from twin.joints import TAPER
from twin.pipe import Pipe, Wall, wall_radius_mm
from twin.robot_model import MM, WALL, RobotModel
from twin.surfaces import CREEP_SPEED_MM_S, surface_at, surface_rows

SCAN_RAD = 1.2  # how far around the rim, from its outermost point, a contact is looked for
SCAN_POINTS = 33
STATIONS = 7  # across the wheel's width
RIPPLE, ROLLERS, PHASE = 3, 4, 5  # columns of a wheel's shape, after radius, crown radius and half width
PLAIN_ROUNDS, SCAN_ROUNDS, SHRINK = 2, 8, 0.4
PER_WHEEL = 2  # a wheel can bridge a gap on two points
APART_MM = 3.0  # nearer than this, two points are one contact
SLOPE_MM = 0.01  # half step of the differences that give the wall's normal
NEAR_MM = 50.0  # features are listed anew after so much travel

SOFT_SHARE = 0.02  # creep goes by the load of the last 50 steps: by that of one step, wheels chatter

SOLREF = (0.002, 1.0)
SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)


@njit(cache=True, error_model="numpy")
def wheel_contacts(wall, hub_mm, axle, angle, wheel_shape):
    """Points where wheels press into the wall.

    A wheel is a disc with a rim crowned to a circle, whose rollers make it swell and shrink on its way around. On a
    plain bore it touches in one point; beside a feature the whole rim is searched, and it may touch in two.

    Args:
        wall: `Pipe.wall`.
        hub_mm: (n, 3) wheel centres.
        axle: (n, 3) unit axles; the wheel rolls forward by turning about its axle in the positive sense.
        angle: (n,) how far each wheel has turned, rad.
        wheel_shape: (n, 6), as `robot_model.wheel_shapes` has it.

    Returns:
        Count; wheel of each contact; gap, mm, below zero; point on the rim, mm; and the contact's axes as rows: the
        wall's normal (inward), the rolling direction and the direction of the axle.
    """
    n = hub_mm.shape[0]
    wheel = np.empty(n * PER_WHEEL, dtype=np.int64)
    gap = np.empty(n * PER_WHEEL)
    point = np.empty((n * PER_WHEEL, 3))
    frame = np.empty((n * PER_WHEEL, 3, 3))
    found = np.zeros((PER_WHEEL, 2))
    count = 0
    for i in range(n):
        disc, shape = _disc(wall.axis, hub_mm[i], axle[i]), wheel_shape[i].copy()
        shape[PHASE] += angle[i]
        if _beside_feature(wall, hub_mm[i], shape[0]):
            touching = _scan(wall, disc, shape, found)
        else:
            found[0] = _lowest(wall, disc, shape, 0.0, 0.0, PLAIN_ROUNDS)
            touching = 1
        for k in range(touching):
            point[count] = _rim_point(disc, shape, found[k, 0], found[k, 1])
            raw = _gap(wall, point[count, 0], point[count, 1], point[count, 2])
            if raw >= 0.0:
                continue
            wheel[count] = i
            gap[count] = raw / _frame(wall, point[count], axle[i], frame[count])
            count += 1
    return count, wheel, gap, point, frame


@njit(cache=True, error_model="numpy")
def _disc(axis, hub, axle):
    """Rows: hub, axle, and two unit vectors in the wheel's plane: away from the pipe's axis, and a quarter turn on."""
    disc = np.empty((4, 3))
    disc[0], disc[1] = hub, axle
    x, y, _ = unbent(axis, hub[0], hub[1], hub[2])
    disc[2] = bent_direction(axis, hub, (x, y, 0.0))
    disc[2] -= np.dot(disc[2], axle) * axle
    disc[2] /= np.sqrt(np.dot(disc[2], disc[2]))
    disc[3] = np.cross(axle, disc[2])
    return disc


@njit(cache=True, error_model="numpy", forceinline=True)
def _rim_point(disc, shape, phi, across):
    radius = shape[0] - shape[1] + np.sqrt(shape[1] * shape[1] - across * across)
    radius += shape[RIPPLE] * np.cos(shape[ROLLERS] * (phi - shape[PHASE]))
    out, on = radius * np.cos(phi), radius * np.sin(phi)
    x = disc[0, 0] + across * disc[1, 0] + out * disc[2, 0] + on * disc[3, 0]
    y = disc[0, 1] + across * disc[1, 1] + out * disc[2, 1] + on * disc[3, 1]
    z = disc[0, 2] + across * disc[1, 2] + out * disc[2, 2] + on * disc[3, 2]
    return x, y, z


@njit(cache=True, error_model="numpy", forceinline=True)
def _gap(wall, x, y, z):
    """Radial distance from a point to the wall; below zero inside the material."""
    x, y, z = unbent(wall.axis, x, y, z)
    return wall_radius_mm(wall, np.arctan2(x, -y), z) - np.sqrt(x * x + y * y)


@njit(cache=True, error_model="numpy", forceinline=True)
def _rim_gap(wall, disc, shape, phi, across):
    x, y, z = _rim_point(disc, shape, phi, across)
    return _gap(wall, x, y, z)


@njit(cache=True, error_model="numpy")
def _beside_feature(wall, hub, radius):
    x, y, z = unbent(wall.axis, hub[0], hub[1], hub[2])
    theta = np.arctan2(x, -y)
    for i in range(wall.codes.size):
        middle, half = wall.rows[i, CENTER_Z], wall.rows[i, HALF_BOX_Z]
        if wall.codes[i] == TAPER:  # beyond its slope it is a plain bore again
            sloping = 0.5 * wall.rows[i, FIRST_OWN]
            middle, half = middle - half + sloping, sloping
        if abs(z - middle) > half + radius:
            continue
        turn = theta - wall.rows[i, CENTER_THETA]
        arc = wall.inner_radius * abs(turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi)))
        if arc <= wall.rows[i, HALF_BOX_ARC] + radius:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _lowest(wall, disc, shape, phi, across, rounds):
    """Angle and place across of least gap near given ones, by parabolas in the one and the other in turn."""
    d_phi, d_across = 2.0 * SCAN_RAD / (SCAN_POINTS - 1), 2.0 * shape[2] / (STATIONS - 1)
    for _ in range(rounds):
        left, here, right = (
            _rim_gap(wall, disc, shape, phi - d_phi, across),
            _rim_gap(wall, disc, shape, phi, across),
            _rim_gap(wall, disc, shape, phi + d_phi, across),
        )
        move = d_phi * _parabola(left, here, right)
        # A parabola does not know the kink that the edge of a pocket makes: never go uphill.
        if _rim_gap(wall, disc, shape, phi + move, across) <= min(left, here, right):
            phi += move
        elif min(left, right) < here:
            phi += -d_phi if left < right else d_phi
        # The rim ends at half its width, so the middle of three must stay a step inside it.
        middle = min(max(across, d_across - shape[2]), shape[2] - d_across)
        left, here, right = (
            _rim_gap(wall, disc, shape, phi, middle - d_across),
            _rim_gap(wall, disc, shape, phi, middle),
            _rim_gap(wall, disc, shape, phi, middle + d_across),
        )
        move = d_across * _parabola(left, here, right)
        if _rim_gap(wall, disc, shape, phi, middle + move) <= min(left, here, right):
            across = middle + move
        elif min(left, right) < here:
            across = middle + (-d_across if left < right else d_across)
        d_phi, d_across = SHRINK * d_phi, SHRINK * d_across
    return phi, across


@njit(cache=True, error_model="numpy", forceinline=True)
def _parabola(left, here, right):
    """Where the parabola through three values, one step apart, is least, in steps from the middle; at most one."""
    bend = left - 2.0 * here + right
    if bend <= 1e-12:
        return 0.0
    return min(max(0.5 * (left - right) / bend, -1.0), 1.0)


@njit(cache=True, error_model="numpy")
def _scan(wall, disc, shape, found):
    """The two deepest points of the whole rim (angle, place across) that are not one; returns how many there are."""
    gaps = np.full((STATIONS + 2, SCAN_POINTS + 2), np.inf)
    step, apart = 2.0 * SCAN_RAD / (SCAN_POINTS - 1), 2.0 * shape[2] / (STATIONS - 1)
    for s in range(STATIONS):
        for j in range(SCAN_POINTS):
            gaps[s + 1, j + 1] = _rim_gap(wall, disc, shape, j * step - SCAN_RAD, s * apart - shape[2])
    depth = np.full(PER_WHEEL, np.inf)
    for s in range(STATIONS):
        for j in range(SCAN_POINTS):
            here = gaps[s + 1, j + 1]
            if here > 1.0 or here > gaps[s : s + 3, j : j + 3].min():
                continue
            phi, across = _lowest(wall, disc, shape, j * step - SCAN_RAD, s * apart - shape[2], SCAN_ROUNDS)
            _keep(shape[0], phi, across, _rim_gap(wall, disc, shape, phi, across), depth, found)
    return (depth[0] < np.inf) + (depth[1] < np.inf)


@njit(cache=True, error_model="numpy")
def _keep(radius, phi, across, gap, depth, found):
    """Enter one more point among the two deepest: in place of a neighbour it is deeper than, or of the shallower."""
    near = -1
    for k in range(PER_WHEEL):
        if depth[k] < np.inf and np.hypot(radius * (phi - found[k, 0]), across - found[k, 1]) < APART_MM:
            near = k
    k = near if near >= 0 else int(np.argmax(depth))
    if gap < depth[k]:
        depth[k] = gap
        found[k, 0], found[k, 1] = phi, across


@njit(cache=True, error_model="numpy")
def _frame(wall, p, axle, frame):
    """Fill the contact's axes; returns the slope of the gap along its normal, which turns a gap into a distance."""
    x, y, z, h = p[0], p[1], p[2], SLOPE_MM
    frame[0, 0] = (_gap(wall, x + h, y, z) - _gap(wall, x - h, y, z)) / (2.0 * h)
    frame[0, 1] = (_gap(wall, x, y + h, z) - _gap(wall, x, y - h, z)) / (2.0 * h)
    frame[0, 2] = (_gap(wall, x, y, z + h) - _gap(wall, x, y, z - h)) / (2.0 * h)
    steep = np.sqrt(np.dot(frame[0], frame[0]))
    frame[0] /= steep
    rolling = np.cross(axle, frame[0])
    frame[1] = rolling / np.sqrt(np.dot(rolling, rolling))
    frame[2] = np.cross(frame[0], frame[1])
    return steep


class Found(NamedTuple):
    """Contacts of one moment: whose wheel, how deep, where, which way; as `wheel_contacts` has it but in metres."""

    wheel: np.ndarray
    dist_m: np.ndarray
    point_m: np.ndarray
    frame: np.ndarray


@njit(cache=True, error_model="numpy")
def _found(wall, anchor_m, axle, qpos, joint, angle, wheel_shape, touching):
    """`wheel_contacts` from MuJoCo's own arrays, and into one more: which wheels touch."""
    hub_mm, axles, angles = anchor_m[joint] / MM, axle[joint], qpos[angle]
    count, wheel, gap_mm, point_mm, frame = wheel_contacts(wall, hub_mm, axles, angles, wheel_shape)
    touching[:] = False
    for k in range(count):
        touching[wheel[k]] = True
    return wheel[:count], MM * gap_mm[:count], MM * point_mm[:count], frame[:count].copy().reshape(count, 9)


class WallContacts:
    """The wall as MuJoCo meets it: finds the wheels' contacts and adds them to its list.

    Call `inject` between `mj_collision` and `mj_makeConstraint`, never from `mjcb_contactfilter`.
    """

    def __init__(self, pipe: Pipe, robot: RobotModel, friction: tuple[float, float], start_mm: float = 0.0):
        """`start_mm` is about where along the axis the robot stands."""
        import mujoco

        self.wall, self.robot, self._friction = pipe.wall, robot, friction[0]
        self._way = Follower(pipe.axis, start_mm)
        self._surfaces = surface_rows(pipe.surfaces)
        self._creeps = any(surface.creep_pct > 0 for surface in pipe.surfaces)
        self.touching = np.zeros(robot.wheel_joint.size, dtype=bool)
        self._soft = np.zeros(robot.wheel_joint.size)
        self._near, self._near_z_mm = pipe.wall, np.inf
        self._add = mujoco.mj_addContact
        self._contacts = [self._blank(int(geom), friction) for geom in robot.wheel_geom]
        self._hinge = np.array([int(robot.model.jnt_dofadr[joint]) for joint in robot.wheel_joint])

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
        robot, anchor = self.robot, data.xanchor
        z_mm = self._along_mm(anchor[robot.wheel_joint[0]])
        if not abs(z_mm - self._near_z_mm) < NEAR_MM:
            hubs_mm = [self._along_mm(hub) for hub in anchor[robot.wheel_joint]]
            self._near = _nearby(self.wall, np.array(hubs_mm))._replace(axis=self._way.rows)
            self._near_z_mm = z_mm
        joints, shapes = (robot.wheel_joint, robot.wheel_angle), robot.wheel_shape
        found = self.found = Found(*_found(self._near, anchor, data.xaxis, data.qpos, *joints, shapes, self.touching))
        for wheel in found.wheel.tolist():
            if self._add(robot.model, data, self._contacts[wheel]):
                raise RuntimeError("MuJoCo has no room for another contact")
        # all at once, for one by one takes longer than to find them
        contact = data.contact
        contact.dist[:], contact.pos[:], contact.frame[:] = found.dist_m, found.point_m, found.frame
        if len(self._surfaces):
            spin = data.qvel[self._hinge]
            wheels = robot.wheel_shape, self._soft, self._friction
            grip, slack_s = _footing(self._surfaces, self._near.axis, found, spin, *wheels)
            contact.friction[:, 0], contact.solreffriction[:, 0] = grip, slack_s
            contact.solreffriction[:, 1] = slack_s > 0

    def _along_mm(self, place_m: np.ndarray) -> float:
        """Where along the axis a place of the world lies."""
        return place_m[2] / MM if self._way.is_straight else self._way.place_mm(place_m / MM)[2]

    def remember(self, data: Any) -> None:
        """Keep, for the creep of the next steps, how soft and how hard pressed each wheel's contact was in this one."""
        if self._creeps:
            _remember(self._soft, self.found.wheel, data.contact.efc_address, data.efc_R, data.efc_force)


@njit(cache=True, error_model="numpy")
def _footing(surfaces, axis, found, spin_rad_s, wheel_shape, soft, friction):
    """Friction of each contact on what it stands on, and the time constant of its softness, s; 0 for the wall's own.

    MuJoCo's friction is soft: a pull f makes a contact slide at R f / b, with R its regularisation and b the rate of
    its damping. Creep in proportion to the pull is that softness, set so that f = mu N slides at the stated share of
    the rim's speed. `soft` is R N.
    """
    grip, slack_s = np.empty(found.wheel.size), np.zeros(found.wheel.size)
    for k in range(found.wheel.size):
        wheel = found.wheel[k]
        x, y, z = found.point_m[k, 0] / MM, found.point_m[k, 1] / MM, found.point_m[k, 2] / MM
        share, creep = surface_at(surfaces, unbent(axis, x, y, z)[2])
        grip[k] = share * friction
        if creep > 0.0 and soft[wheel] > 0.0:
            rim_mm_s = abs(spin_rad_s[wheel]) * wheel_shape[wheel, 0]
            damping = grip[k] * soft[wheel] / (MM * creep * max(rim_mm_s, CREEP_SPEED_MM_S))
            # damping is 2 / (dmax * time constant); never stiffer than the wall itself
            slack_s[k] = max(2.0 / (SOLIMP[1] * damping), SOLREF[0])
    return grip, slack_s


@njit(cache=True, error_model="numpy")
def _remember(soft, wheel, address, efc_R, efc_force):
    for k in range(address.size):
        if address[k] >= 0:
            soft[wheel[k]] += SOFT_SHARE * (efc_R[address[k] + 1] * efc_force[address[k]] - soft[wheel[k]])


def _nearby(wall: Wall, hub_z_mm: np.ndarray) -> Wall:
    """The wall with only the features that these wheels can meet before `NEAR_MM` of further travel."""
    reach = NEAR_MM + 50.0
    rows = wall.rows
    near = (rows[:, CENTER_Z] + rows[:, HALF_BOX_Z] > hub_z_mm.min() - reach) & (
        rows[:, CENTER_Z] - rows[:, HALF_BOX_Z] < hub_z_mm.max() + reach
    )
    return wall._replace(rows=rows[near], codes=wall.codes[near])
