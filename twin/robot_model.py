"""The six-wheel robot as a MuJoCo model: bodies, springs, motors and sensors in the pipe's axes, in metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sensor_model.geometry import GRAVITY_M_S2, wall_direction
from twin.pipe import Pipe
from twin.robot import Build, Robot
from twin.truth import gravity_direction

MM = 1e-3  # the one border between this project's millimetres and MuJoCo's metres
STEP_S = 1e-3
CHASSIS, CAMERA, WALL = "chassis", "camera", "wall"
POSITION, ATTITUDE, ACCELEROMETER, GYRO = "camera_position", "camera_attitude", "accelerometer", "gyro"
WHEEL_ANGLE, WHEEL_HUB = "{}_angle", "{}_hub"
END_WHEELS = ("end_front", "end_rear")
Z = np.array([0.0, 0.0, 1.0])


def wheel_names(robot: Robot) -> list[str]:
    """Every wheel, in the order that all arrays of wheels keep: front and rear of each leg, then the end wheels."""
    return [f"leg{k}_{end}" for k in range(robot.leg_count) for end in ("front", "rear")] + list(END_WHEELS)


def motor_names(robot: Robot) -> list[str]:
    """Every motor, in the order of MuJoCo's controls: one a leg, one an end wheel."""
    return [f"leg{k}_motor" for k in range(robot.leg_count)] + [f"{name}_motor" for name in END_WHEELS]


@dataclass(frozen=True)
class RobotModel:
    """A compiled robot, where its wheels are in MuJoCo's arrays, and their shapes as `wheel_contacts` takes them."""

    model: Any
    wheel_body: Int[np.ndarray, "wheels"]
    wheel_joint: Int[np.ndarray, "wheels"]
    wheel_angle: Int[np.ndarray, "wheels"]
    wheel_geom: Int[np.ndarray, "wheels"]
    wheel_shape: Float[np.ndarray, "wheels 6"]
    sensor: dict[str, slice]
    feed_forward_s: float


def build_model(pipe: Pipe, robot: Robot, build: Build) -> RobotModel:
    """Compile the robot under the pipe's gravity; its chassis frame has the camera's axes."""
    model = robot_spec(pipe, robot, build).compile()
    names = wheel_names(robot)
    sensors = [model.sensor(i) for i in range(model.nsensor)]
    return RobotModel(
        model=model,
        wheel_body=np.array([model.body(name).id for name in names]),
        wheel_joint=np.array([model.joint(name).id for name in names]),
        wheel_angle=np.array([int(model.joint(name).qposadr[0]) for name in names]),
        wheel_geom=np.array([model.geom(name).id for name in names]),
        wheel_shape=wheel_shapes(robot, build),
        sensor={s.name: slice(int(s.adr[0]), int(s.adr[0] + s.dim[0])) for s in sensors},
        feed_forward_s=2 / (2 * np.pi * robot.motor_servo_hz),
    )


def wheel_shapes(robot: Robot, build: Build) -> Float[np.ndarray, "wheels 6"]:
    """Radius, crown radius, half width, roller ripple (mm), roller count and the rollers' position of every wheel."""
    rim = (robot.wheel_crown_radius_mm, robot.wheel_width_mm / 2, robot.roller_ripple_mm, robot.roller_count)
    radii = np.repeat(robot.leg_wheel_radius_mm, 2)
    rollers = [(radius, *rim, phase) for radius, phase in zip(radii, build.roller_phase_rad, strict=True)]
    # Hemispheres (section 3.3), so that they climb an edge that runs across their path.
    end = (robot.end_wheel_radius_mm, robot.end_wheel_radius_mm, 0.9 * robot.end_wheel_radius_mm, 0.0, 1.0, 0.0)
    return np.array([*rollers, end, end])


def robot_spec(pipe: Pipe, robot: Robot, build: Build) -> Any:
    """The robot as an `MjSpec`, before it is compiled."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = "six_wheel_robot"
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.option.gravity = GRAVITY_M_S2 * gravity_direction(pipe)
    # MuJoCo takes a hollow mesh as its hull: this point only stands for the wall, whose contacts are injected.
    spec.worldbody.add_geom(name=WALL, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[MM, 0, 0], contype=0, conaffinity=0)

    chassis = _add_chassis(spec, robot)
    for k, theta in enumerate(robot.leg_clock_rad):
        _add_leg(spec, chassis, robot, build, k, float(theta))
    for i, side in enumerate((1, -1)):
        _add_end_wheel(spec, chassis, robot, build, i, side * robot.end_wheel_ahead_mm)
    _add_sensors(spec, robot)
    return spec


def _add_chassis(spec: Any, robot: Robot) -> Any:
    chassis = spec.worldbody.add_body(name=CHASSIS)
    chassis.add_freejoint()
    _add_cylinder(chassis, CHASSIS, robot.chassis_radius_mm, robot.chassis_length_mm, robot.chassis_mass_kg, Z)
    _add_mass(chassis, robot.batteries_mass_kg, -robot.batteries_behind_mm)
    sensor_z = robot.camera_ahead_mm - robot.sensor_length_mm / 2
    _add_cylinder(chassis, "sensor", robot.sensor_radius_mm, robot.sensor_length_mm, robot.sensor_mass_kg, Z, sensor_z)
    chassis.add_site(name=CAMERA, pos=MM * robot.camera_ahead_mm * Z)
    return chassis


def _add_leg(spec: Any, chassis: Any, robot: Robot, build: Build, k: int, theta: float) -> None:
    """One leg: a radial slide that carries two wheels in tandem, coupled, on one motor."""
    import mujoco

    outward = wall_direction(theta)
    hub_mm = robot.bore_radius_mm - robot.wheel_radius_mm
    leg = _add_slide(chassis, f"leg{k}", outward, hub_mm, 0.0, robot.leg_travel_mm)
    leg.joints[0].stiffness = [robot.leg_stiffness_n_m, 0, 0]
    leg.joints[0].springref = build.preload_n[k] / robot.leg_stiffness_n_m
    leg.joints[0].damping = [robot.leg_damping_n_s_m, 0, 0]
    _add_mass(leg, robot.leg_mass_kg)

    # Turning about it in the positive sense rolls the robot towards +z.
    axle = np.cross(Z, outward)
    names = [f"leg{k}_front", f"leg{k}_rear"]
    for i, (name, side) in enumerate(zip(names, (0.5, -0.5), strict=True)):
        askew = build.askew_rad[2 * k + i]
        wheel = leg.add_body(name=name, pos=MM * side * robot.wheel_spacing_mm * Z)
        wheel.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=np.cos(askew) * axle + np.sin(askew) * Z)
        _add_cylinder(wheel, name, robot.wheel_radius_mm, robot.wheel_width_mm, robot.wheel_mass_kg, axle)
    leg.bodies[0].joints[0].armature = MM**2 * robot.motor_inertia_kg_mm2
    if robot.motor_friction_n_mm > 0:
        joint = leg.bodies[0].joints[0]
        joint.frictionloss = MM * robot.motor_friction_n_mm
        joint.solref_friction, joint.solimp_friction = [2 * STEP_S, 1], [0.995, 0.999, 0.001, 0.5, 2]  # or it creeps
    belt = spec.add_equality(
        name=f"leg{k}_belt", type=mujoco.mjtEq.mjEQ_JOINT, name1=names[1], name2=names[0], data=[0, 1] + [0] * 10
    )
    belt.solref[0] = 1e-3 * robot.belt_ms
    _add_motor(spec, robot, f"leg{k}_motor", names[0], robot.wheel_radius_mm)


def _add_end_wheel(spec: Any, chassis: Any, robot: Robot, build: Build, i: int, z_mm: float) -> None:
    """One end wheel: its axle lies along the pipe, so it rolls around the wall and slides freely along it."""
    import mujoco

    name = END_WHEELS[i]
    outward = wall_direction(np.radians(robot.end_wheel_clock_deg))
    hub_mm = robot.bore_radius_mm - robot.end_wheel_radius_mm
    arm = _add_slide(chassis, f"{name}_arm", outward, hub_mm, z_mm, robot.leg_travel_mm)
    arm.joints[0].stiffness = [robot.end_wheel_stiffness_n_m, 0, 0]
    arm.joints[0].springref = robot.end_wheel_preload_n / robot.end_wheel_stiffness_n_m
    arm.joints[0].damping = [robot.leg_damping_n_s_m, 0, 0]
    _add_mass(arm, robot.leg_mass_kg / 2)

    askew = build.askew_rad[2 * robot.leg_count + i]
    wheel = arm.add_body(name=name)
    # Turning about it in the positive sense rolls the robot clockwise, seen along +z.
    axle = -np.cos(askew) * Z + np.sin(askew) * np.cross(Z, outward)
    wheel.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axle)
    wheel.joints[0].armature = MM**2 * robot.motor_inertia_kg_mm2
    _add_cylinder(wheel, name, robot.end_wheel_radius_mm, robot.wheel_width_mm, robot.wheel_mass_kg, Z)
    _add_motor(spec, robot, f"{name}_motor", name, robot.end_wheel_radius_mm)


def _add_slide(chassis: Any, name: str, outward: np.ndarray, hub_mm: float, z_mm: float, travel_mm: float) -> Any:
    import mujoco

    body = chassis.add_body(name=name, pos=MM * (hub_mm * outward + z_mm * Z))
    travel = [-MM * travel_mm, MM * travel_mm]
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=outward, limited=True, range=travel)
    return body


def _add_motor(spec: Any, robot: Robot, name: str, joint: str, radius_mm: float) -> None:
    """A geared motor under a critically damped servo that follows an angle and its rate, up to its torque limit.

    Its control is the angle plus `feed_forward_s` times the rate, which makes one input of the two.
    """
    import mujoco

    carried = (robot.chassis_mass_kg + robot.batteries_mass_kg + robot.sensor_mass_kg) / robot.leg_count
    inertia = MM**2 * (robot.motor_inertia_kg_mm2 + carried * radius_mm**2)
    pulse = 2 * np.pi * robot.motor_servo_hz
    stiffness, damping = inertia * pulse**2, 2 * inertia * pulse
    limit = MM * robot.motor_torque_limit_n_mm
    spec.add_actuator(
        name=name,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        gainprm=[stiffness] + [0] * 9,
        biasprm=[0, -stiffness, -damping] + [0] * 7,
        forcelimited=True,
        forcerange=[-limit, limit],
    )


def _add_mass(body: Any, mass_kg: float, z_mm: float = 0.0) -> None:
    """A lump (a small ball, so that its inertia is not zero)."""
    import mujoco

    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[10 * MM, 0, 0],
        pos=MM * z_mm * Z,
        mass=mass_kg,
        contype=0,
        conaffinity=0,
    )


def _add_cylinder(
    body: Any, name: str, radius_mm: float, length_mm: float, mass_kg: float, axis: np.ndarray, middle_mm: float = 0.0
) -> None:
    """A cylinder about an axis through the body's origin, its middle so far along it."""
    import mujoco

    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[MM * radius_mm, 0, 0],
        fromto=MM * np.concatenate([(middle_mm - length_mm / 2) * axis, (middle_mm + length_mm / 2) * axis]),
        mass=mass_kg,
        contype=0,
        conaffinity=0,
    )


def _add_sensors(spec: Any, robot: Robot) -> None:
    """Noise-free read-outs: the motion of the camera, every wheel's angle and where its hub is."""
    import mujoco

    site, joint, body = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_XBODY
    kinds = mujoco.mjtSensor
    spec.add_sensor(name=POSITION, type=kinds.mjSENS_FRAMEPOS, objtype=site, objname=CAMERA)
    spec.add_sensor(name=ATTITUDE, type=kinds.mjSENS_FRAMEQUAT, objtype=site, objname=CAMERA)
    spec.add_sensor(name=ACCELEROMETER, type=kinds.mjSENS_ACCELEROMETER, objtype=site, objname=CAMERA)
    spec.add_sensor(name=GYRO, type=kinds.mjSENS_GYRO, objtype=site, objname=CAMERA)
    for name in wheel_names(robot):
        spec.add_sensor(name=WHEEL_ANGLE.format(name), type=kinds.mjSENS_JOINTPOS, objtype=joint, objname=name)
        spec.add_sensor(name=WHEEL_HUB.format(name), type=kinds.mjSENS_FRAMEPOS, objtype=body, objname=name)
