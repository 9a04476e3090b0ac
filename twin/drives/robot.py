"""The six-wheel robot drives itself through the pipe: MuJoCo's motion is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, model_validator

from sensor_model.geometry import GRAVITY_M_S2, rotation_from_wxyz, twist_about_z_rad, wxyz_from_rotation
from sensor_model.settings import Settings
from twin.bends import Follower, followed, straightened
from twin.drives.base import DriveFailed
from twin.drives.motors import (
    MotorFault,
    RollHold,
    RollStage,
    RollTo,
    Via,
    motor_controls,
    torque_limits_n_m,
    torque_share,
)
from twin.drives.watch import Watch, forces
from twin.pipe import Pipe
from twin.robot import Robot, draw_build
from twin.robot_model import (
    ACCELEROMETER,
    ATTITUDE,
    CHASSIS,
    GYRO,
    MM,
    POSITION,
    STEP_S,
    WHEEL_ANGLE,
    WHEEL_HUB,
    RobotModel,
    build_model,
    wheel_names,
)
from twin.truth import Truth, WheelLog, gravity_along
from twin.wheel_contact import WallContacts
from twin.wheel_log import WheelRecorder

SETTLE_S = 1.5
SETTLE_DAMPING = 8.0  # legs are damped so much more while the robot settles, which is then over sooner
STILL_MM_S = 1.0  # soft friction lets wheels creep a little under load, and nothing else moves any more
CHECK_STEPS = 25
BOTH_WAYS = np.array([-1.0, 1.0])


class RobotDrive(Settings):
    """The robot sent from one place to another: its motors follow a smooth profile, and where it gets is physics.

    Distances are the camera's. It starts at rest exactly at `start_mm`; it stops where its wheels have rolled the
    distance to `end_mm`, which slip and soft contact make a little different, and stands there for `dwell_s`. `via`
    are places to stop at before, in any order: stop and go, and reverse.
    """

    kind: Literal["robot"] = "robot"
    start_mm: float = 0.0
    end_mm: float
    speed_mm_s: Annotated[float, Field(gt=0, le=200)] = 50.0
    ramp_s: Annotated[float, Field(gt=0, le=5)] = 0.3
    dwell_s: Annotated[float, Field(ge=0, le=10)] = 0.2
    via: tuple[Via, ...] = Field(default=(), max_length=1000)
    roll: tuple[RollStage, ...] = Field(default=(), max_length=100)
    roll_to: tuple[RollTo, ...] = Field(default=(), max_length=100)
    faults: tuple[MotorFault, ...] = Field(default=(), max_length=100)
    tether_drag_n: Annotated[float, Field(ge=0)] = 0.0
    tipped_deg: Annotated[float, Field(gt=0, le=45)] = 8.0
    stuck_mm: Annotated[float, Field(gt=0)] = 30.0

    @model_validator(mode="after")
    def _rolls_in_one_way(self) -> RobotDrive:
        if self.roll and self.roll_to:
            raise ValueError("give either roll, which turns the end wheels, or roll_to, which holds a roll by them")
        return self

    @property
    def span_mm(self) -> tuple[float, float]:
        """Lowest and highest place of the camera."""
        places = [self.start_mm, *(via.to_mm for via in self.via), self.end_mm]
        return min(places), max(places)


@dataclass(frozen=True)
class Motion:
    """One drive as MuJoCo had it, a row a step: its read-outs, and which wheels touched the wall; and what they did."""

    robot: RobotModel
    sensor: Float[np.ndarray, "n readouts"]
    touching: Bool[np.ndarray, "n wheels"]
    wheels: WheelLog

    def readout(self, name: str) -> Float[np.ndarray, "n k"]:
        """One sensor's read-out, in MuJoCo's units."""
        return self.sensor[:, self.robot.sensor[name]]


def drive(pipe: Pipe, robot: Robot, settings: RobotDrive, rng: np.random.Generator) -> Truth:
    """Drive through the pipe; the tolerances of this one robot come from `rng`.

    Raises:
        DriveFailed: when the robot tips, gets stuck, loses its grip or does not fit the pipe.
    """
    return truth_of(pipe, robot, simulate_motion(pipe, robot, settings, rng))


def simulate_motion(pipe: Pipe, robot: Robot, settings: RobotDrive, rng: np.random.Generator) -> Motion:
    """Settle under gravity, set the camera to its start, and drive.

    Raises:
        DriveFailed: as `drive`.
    """
    import mujoco

    model = build_model(pipe, robot, draw_build(robot, rng))
    standing_mm = settings.start_mm - robot.camera_ahead_mm
    contacts = WallContacts(pipe, model, (robot.wheel_friction, robot.roller_friction), standing_mm)
    data = mujoco.MjData(model.model)
    _place(data, pipe, robot, settings.start_mm)
    if not _settle(model, data, contacts):
        uphill = -1.0 if pipe.inclination_deg > 0 else 1.0
        held = forces(pipe, robot, model, 0.0, settings.start_mm, uphill)
        raise DriveFailed(f"the robot does not come to rest at the start: {held}, or its springs do not hold it")
    way = Follower(pipe.axis, standing_mm)
    late_mm = settings.start_mm - Follower(pipe.axis, settings.start_mm).place_mm(data.site_xpos[0] / MM)[2]
    data.qpos[:3] += MM * late_mm * _heading(way, data.qpos)[:, 2]

    controls = _controls(pipe, robot, settings, model.feed_forward_s)
    limits = torque_limits_n_m(robot, settings.faults, len(controls))
    sensor = np.empty((len(controls), model.model.nsensordata))
    touching = np.empty((len(controls), len(wheel_names(robot))), dtype=bool)
    recorder = WheelRecorder(model, contacts, len(controls))
    watch = Watch(pipe, robot, model, way, settings.tipped_deg, settings.stuck_mm, settings.tether_drag_n)
    ctrl, qpos, qvel, readout = data.ctrl, data.qpos, data.qvel, data.sensordata
    pull = data.xfrc_applied[model.model.body(CHASSIS).id]
    hinges = model.model.jnt_dofadr[model.model.actuator_trnid[:, 0]]
    fading, limit = robot.motor_no_load_turns_s is not None, limits[0]
    hold = _hold(pipe, robot, settings, len(controls), model.feed_forward_s)
    for i, control in enumerate(controls):
        limit = limits.get(i, limit)
        if fading or i in limits:
            reach = limit * torque_share(robot, qvel[hinges])
            model.model.actuator_forcerange[:] = reach[:, None] * BOTH_WAYS
        ctrl[:] = control
        if hold is not None:
            ctrl[robot.leg_count :] += hold.more_rad(i, _roll_rad(way, qpos))
        if settings.tether_drag_n > 0:
            tangent = _heading(way, qpos)[:, 2]
            pull[:3] = -settings.tether_drag_n * np.tanh(tangent @ qvel[:3] / (1.0 * MM)) * tangent
        step(model.model, data, contacts)
        recorder.record(data, i)
        sensor[i], touching[i] = readout, contacts.touching
        if i % CHECK_STEPS == 0 or i == len(controls) - 1:
            watch.check(i, sensor[i], touching[i], data)
    return Motion(model, sensor, touching, recorder.log())


def _heading(way: Follower, qpos: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """`R_world_pipe` where the chassis is."""
    return np.eye(3) if way.is_straight else way.heading(way.place_mm(qpos[:3] / MM)[2])


def _roll_rad(way: Follower, qpos: np.ndarray) -> float:
    """The chassis's turn about the pipe's axis."""
    if way.is_straight:
        return 2 * atan2(qpos[6], qpos[3])
    return float(twist_about_z_rad(_heading(way, qpos).T @ rotation_from_wxyz(qpos[3:7])))


def step(model: Any, data: Any, contacts: WallContacts) -> None:
    """One step of MuJoCo, as `mj_step` has it, with the wall's contacts added; read-outs are of its beginning."""
    import mujoco

    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_makeM(model, data)
    mujoco.mj_factorM(model, data)
    mujoco.mj_collision(model, data)
    contacts.inject(data)
    mujoco.mj_makeConstraint(model, data)
    mujoco.mj_transmission(model, data)
    mujoco.mj_projectConstraint(model, data)
    mujoco.mj_sensorPos(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_sensorVel(model, data)
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)
    mujoco.mj_fwdConstraint(model, data)
    contacts.remember(data)
    data.flg_rnepost = False  # or the accelerometer would keep an earlier step's value
    mujoco.mj_sensorAcc(model, data)
    mujoco.mj_implicit(model, data)


def _controls(pipe: Pipe, robot: Robot, settings: RobotDrive, feed_forward_s: float) -> Float[np.ndarray, "n motors"]:
    return motor_controls(
        robot,
        pipe.bore_radius_mm,
        [settings.start_mm, *(via.to_mm for via in settings.via), settings.end_mm],
        [*(via.dwell_s for via in settings.via), settings.dwell_s],
        settings.speed_mm_s,
        settings.ramp_s,
        settings.roll or settings.roll_to,
        settings.faults,
        feed_forward_s,
    )


def _hold(pipe: Pipe, robot: Robot, settings: RobotDrive, steps: int, feed_forward_s: float) -> RollHold | None:
    if not settings.roll_to:
        return None
    rim_per_roll = pipe.bore_radius_mm / robot.end_wheel_radius_mm
    return RollHold(settings.roll_to, steps, settings.ramp_s, rim_per_roll, feed_forward_s)


def _place(data: Any, pipe: Pipe, robot: Robot, start_mm: float) -> None:
    """On the axis, legs out to the wall.

    Raises:
        DriveFailed: when a leg cannot reach the wall.
    """
    stretch = pipe.bore_radius_mm - robot.bore_radius_mm
    if abs(stretch) >= robot.leg_travel_mm:
        raise DriveFailed(
            f"the robot does not fit: its legs reach a bore of {robot.bore_radius_mm - robot.leg_travel_mm:g} to "
            f"{robot.bore_radius_mm + robot.leg_travel_mm:g} mm radius, the pipe has {pipe.bore_radius_mm:g} mm; "
            "robot: 4-inch, 6-inch or 8-inch, or set robot.bore_radius_mm"
        )
    T = pipe.axis.frame(start_mm - robot.camera_ahead_mm)
    data.qpos[:] = 0.0
    data.qpos[:3], data.qpos[3:7] = MM * T[:3, 3], wxyz_from_rotation(T[:3, :3])
    for name in [f"leg{k}" for k in range(robot.leg_count)] + ["end_front_arm", "end_rear_arm"]:
        data.joint(name).qpos[0] = MM * stretch


def _settle(robot: RobotModel, data: Any, contacts: WallContacts) -> bool:
    """Let the robot sink into its springs, motors holding; whether it comes to rest."""
    import mujoco

    damping = robot.model.dof_damping.copy()
    robot.model.dof_damping[:] *= SETTLE_DAMPING
    for _ in range(round(SETTLE_S / STEP_S)):
        step(robot.model, data, contacts)
    robot.model.dof_damping[:] = damping
    mujoco.mj_kinematics(robot.model, data)
    return bool(np.abs(data.qvel[:3]).max() < MM * STILL_MM_S)


def _leg_angles(motion: Motion, robot: Robot) -> Float[np.ndarray, "n legs"]:
    """Angle of each leg's motor, whose encoder sits on the front wheel's shaft."""
    names = [f"leg{k}_front" for k in range(robot.leg_count)]
    return np.hstack([motion.readout(WHEEL_ANGLE.format(name)) for name in names])


def _along_mm(pipe: Pipe, place_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Where along the axis something was, step by step."""
    rows = pipe.wall.axis
    return followed(rows, np.ascontiguousarray(place_mm))[:, 2] if len(rows) else place_mm[:, 2]


def truth_of(pipe: Pipe, robot: Robot, motion: Motion) -> Truth:
    """The truth of a motion: in millimetres, its clock at zero, its encoders at zero."""
    time = STEP_S * np.arange(motion.sensor.shape[0])
    q, position_mm = motion.readout(ATTITUDE), motion.readout(POSITION) / MM
    if pipe.bends:
        position_mm, R_pipe_camera = straightened(pipe.axis, position_mm, rotation_from_wxyz(q))
        q = wxyz_from_rotation(R_pipe_camera)
    # The accelerometer feels the wall, not gravity.
    felt = np.einsum("nij,nj->ni", rotation_from_wxyz(q), motion.readout(ACCELEROMETER))
    angle = _leg_angles(motion, robot)
    names = wheel_names(robot)[: 2 * robot.leg_count]
    hub_mm = np.column_stack([_along_mm(pipe, motion.readout(WHEEL_HUB.format(name)) / MM) for name in names])
    pair_mm = hub_mm.reshape(time.size, robot.leg_count, 2).mean(axis=2)
    slip = np.gradient(angle * robot.leg_wheel_radius_mm - pair_mm, STEP_S, axis=0)
    return Truth(
        pipe=pipe,
        time_s=time,
        position_mm=position_mm,
        q_pipe_camera_wxyz=q,
        acceleration_mm_s2=(felt + GRAVITY_M_S2 * gravity_along(pipe, position_mm[:, 2])) / MM,
        angular_velocity_camera_rad_s=motion.readout(GYRO).copy(),
        wheel_angle_rad=angle - angle[0],
        slip_mm_s=slip,
        wheels=motion.wheels,
    )
