"""Whether the robot is still driving: it tips, rubs, floats, is stuck, or the simulation itself diverges."""

from __future__ import annotations

from typing import Any

import numpy as np

from sensor_model.geometry import GRAVITY_M_S2, rotation_from_wxyz
from twin.bends import Follower
from twin.drives.base import DriveFailed
from twin.pipe import Pipe
from twin.robot import Robot
from twin.robot_model import ATTITUDE, MM, POSITION, STEP_S, WHEEL_ANGLE, RobotModel
from twin.surfaces import GRIP
from twin.truth import gravity_along

FASTEST_M_S = 20.0  # no part of the robot can be so fast; a body that is has left the simulation


class Watch:
    """Looks at the robot every few steps, and raises a `DriveFailed` that says what, when and where."""

    def __init__(
        self,
        pipe: Pipe,
        robot: Robot,
        model: RobotModel,
        way: Follower,
        tipped_deg: float,
        stuck_mm: float,
        tether_drag_n: float,
    ):
        self._pipe, self._robot, self._model, self._way = pipe, robot, model, way
        self._tipped_deg, self._stuck_mm, self._tether_n = tipped_deg, stuck_mm, tether_drag_n
        self._wheels = [model.sensor[WHEEL_ANGLE.format(f"leg{k}_front")].start for k in range(robot.leg_count)]
        self._passed: tuple[float, float, float] | None = None

    def check(self, i: int, readout: np.ndarray, touching: np.ndarray, data: Any) -> None:
        """See that step i leaves a robot that drives.

        Raises:
            DriveFailed: when it does not.
        """
        self._diverged(i, data)
        pipe, robot = self._pipe, self._robot
        position = readout[self._model.sensor[POSITION]] / MM
        axis = rotation_from_wxyz(readout[self._model.sensor[ATTITUDE]])[:, 2]
        chassis = self._way.place_mm(position - robot.camera_ahead_mm * axis)
        travelled = chassis[2] + robot.camera_ahead_mm
        bend = _in_bend(pipe, chassis[2] - robot.chassis_length_mm, travelled)
        where = f"at {i * STEP_S:.2f} s, camera at z = {travelled:.0f} mm{bend}"
        tilt_deg = np.degrees(np.arccos(np.clip(axis @ self._way.heading(chassis[2])[:, 2], -1, 1)))
        if not tilt_deg <= self._tipped_deg:
            raise DriveFailed(f"the robot tips by {tilt_deg:.1f} degrees {where}")
        if np.hypot(*chassis[:2]) > pipe.bore_radius_mm - robot.chassis_radius_mm:
            raise DriveFailed(f"the chassis rubs on the wall {where}")
        if not touching.any():
            raise DriveFailed(f"no wheel touches the wall {where}")
        told = float(np.median(data.ctrl[: robot.leg_count])) * robot.wheel_radius_mm
        rolled = float(np.median(readout[self._wheels] * robot.leg_wheel_radius_mm))
        self._stuck(told, rolled, travelled, where)

    def _diverged(self, i: int, data: Any) -> None:
        speed = np.linalg.norm(data.cvel[:, 3:], axis=1)
        wrong = ~(speed < FASTEST_M_S)  # not a number, too
        if wrong.any():
            name = self._model.model.body(int(np.argmax(wrong))).name
            raise DriveFailed(
                f"the simulation diverges at {i * STEP_S:.2f} s: body {name} moves at {speed[wrong][0]:.3g} m/s"
            )

    def _stuck(self, told: float, rolled: float, travelled: float, where: str) -> None:
        """Motors that are told, or wheels that roll, on and on for the little that the robot goes."""
        if self._passed is None or abs(travelled - self._passed[2]) >= self._stuck_mm:
            self._passed = told, rolled, travelled
        told_mm, rolled_mm, went_mm = told - self._passed[0], rolled - self._passed[1], travelled - self._passed[2]
        if max(abs(told_mm - went_mm), abs(rolled_mm - went_mm)) > self._stuck_mm:
            held = forces(self._pipe, self._robot, self._model, self._tether_n, travelled, np.sign(told_mm))
            raise DriveFailed(
                f"the robot is stuck {where}: told to go {told_mm:.0f} mm, its wheels rolled {rolled_mm:.0f} mm and it "
                f"went {went_mm:.0f} mm; {held}"
            )


def forces(pipe: Pipe, robot: Robot, model: RobotModel, tether_n: float, camera_mm: float, sense: float) -> str:
    """What the wheels can push, what holds the robot back on its way on (sense 1) or back (-1), and what is missing."""
    at_mm = camera_mm - robot.camera_ahead_mm
    states = [s.state for s in pipe.surfaces if s.from_mm <= at_mm < s.to_mm]
    grip = robot.leg_count * robot.leg_preload_n * robot.wheel_friction * GRIP[states[-1] if states else "dry"]
    motors = robot.leg_count * robot.motor_torque_limit_n_mm / robot.wheel_radius_mm
    slope = -sense * model.model.body_mass.sum() * GRAVITY_M_S2 * gravity_along(pipe, np.array([at_mm]))[0, 2] + 0.0
    needed, push = max(tether_n + slope, 0.0), min(grip, motors)
    said = (
        f"its wheels push {push:.1f} N at most (grip {grip:.1f} N, motors {motors:.1f} N) "
        f"against {needed:.1f} N (tether {tether_n:.1f} N, slope {slope:.1f} N)"
    )
    if needed > push:
        return f"{said}: {needed - push:.1f} N are missing"
    return f"{said}: something in its way, or a fault, holds it"


def _in_bend(pipe: Pipe, from_mm: float, to_mm: float) -> str:
    """Which bend a stretch of the pipe touches, in words; nothing where it is straight."""
    for bend in pipe.bends:
        if bend.from_mm < to_mm and bend.to_mm > from_mm:
            return f", in the bend of radius_od {bend.radius_od:g} from {bend.from_mm:g} to {bend.to_mm:g} mm"
    return ""
