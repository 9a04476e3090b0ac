"""What every wheel really did: how hard it pressed on the wall, how fast it slid there, how fast it turned."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from twin.robot_model import STEP_S, RobotModel
from twin.truth import WheelLog
from twin.wheel_contact import WallContacts

LOG_STEPS = 5  # a row every so many steps, 200 a second: slip changes more slowly than that


class WheelRecorder:
    """Fills a `WheelLog` while the drive goes on: four bytes a number, so that 50 m of pipe take 20 MB."""

    def __init__(self, robot: RobotModel, contacts: WallContacts, steps: int):
        rows, wheels = (steps + LOG_STEPS - 1) // LOG_STEPS, robot.wheel_joint.size
        self._robot, self._contacts = robot, contacts
        self._time_s = STEP_S * LOG_STEPS * np.arange(rows)
        self._force, self._slip, self._spin = (np.zeros((rows, wheels), dtype=np.float32) for _ in range(3))
        self._hinge = np.array([int(robot.model.jnt_dofadr[joint]) for joint in robot.wheel_joint])
        self._root = int(robot.model.body_rootid[robot.wheel_body[0]])

    def record(self, data: Any, i: int) -> None:
        """Take down step i, after its forces are known."""
        if i % LOG_STEPS:
            return
        row, found = i // LOG_STEPS, self._contacts.found
        self._spin[row] = data.qvel[self._hinge]
        _fill(
            self._force[row],
            self._slip[row],
            found.wheel,
            found.point_m,
            found.frame,
            data.cvel[self._robot.wheel_body],
            data.subtree_com[self._root],
            data.efc_force,
            data.contact.efc_address,
        )

    def log(self) -> WheelLog:
        """All that was taken down."""
        return WheelLog(self._time_s, self._force, self._slip, self._spin)


@njit(cache=True, error_model="numpy")
def _fill(force, slip, wheel, point, frame, velocity, center, efc_force, address):
    """Normal force (N) and slip (mm/s) of each wheel; of two contacts the sum, and the slip of the harder pressed."""
    hardest = np.zeros(force.size)
    for k in range(wheel.size):
        if address[k] < 0:
            continue
        normal, w = efc_force[address[k]], wheel[k]
        force[w] += normal
        if normal <= hardest[w]:
            continue
        hardest[w] = normal
        # MuJoCo keeps a body's velocity (angular, linear) as of the point at the whole robot's centre of mass
        surface = velocity[w, 3:] + np.cross(velocity[w, :3], point[k] - center)
        slip[w] = -1000.0 * np.dot(surface, frame[k, 3:6])
