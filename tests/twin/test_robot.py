"""The six-wheel robot: its contacts against plain references, and its drive against what physics says."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from sensor_model.geometry import wall_direction
from twin.drives.motors import RollStage
from twin.drives.robot import (
    STEP_S,
    RobotDrive,
    _place,
    _settle,
    simulate_motion,
    truth_of,
)
from twin.features.pocket import Pocket
from twin.features.scratch import Scratch
from twin.pipe import Pipe
from twin.robot import Robot, draw_build
from twin.robot_model import MM, WALL, build_model, motor_names, robot_spec, wheel_names
from twin.simulate import DriveFailed, simulate
from twin.wheel_contact import SOLIMP, SOLREF, WallContacts, _nearby, wheel_contacts


def pipe(**changes) -> Pipe:
    return Pipe(**{"inner_radius_mm": 76.2, "wall_thickness_mm": 7.5, **changes})


PLAIN = pipe()
EXACT = Robot(preload_tolerance_pct=0, wheel_toe_tolerance_deg=0, end_wheel_skew_tolerance_deg=0, roller_ripple_mm=0)
NO_TURN = np.zeros(1)
WHEEL = np.array([[19.0, 20.0, 5.0, 0.0, 10.0, 0.0]])  # as `wheel_shapes` has it


def carved(clock: str, distance_mm: float = 60.0, length_mm: float = 70.0) -> Pipe:
    pocket = Pocket(distance_mm=distance_mm, clock_deg=clock, depth_mm=7.5, length_mm=length_mm, width_mm=35)
    return pipe(features=(pocket,))


def at_rest(pipe: Pipe, robot: Robot):
    import mujoco

    model = build_model(pipe, robot, draw_build(robot, np.random.default_rng(0)))
    contacts = WallContacts(pipe, model, (robot.wheel_friction, robot.roller_friction))
    data = mujoco.MjData(model.model)
    _place(data, pipe, robot, 0.0)
    _settle(model, data, contacts)
    return model, data, contacts


@pytest.fixture(scope="module")
def motion():
    return simulate_motion(PLAIN, Robot(), RobotDrive(end_mm=200), np.random.default_rng(0))


@pytest.fixture(scope="module")
def truth(motion):
    return truth_of(PLAIN, Robot(), motion)


def tilt_deg(truth):
    axis = Rotation.from_quat(truth.q_pipe_camera_wxyz[:, [1, 2, 3, 0]]).as_matrix()[:, :, 2]
    return np.degrees(np.arccos(np.clip(axis[:, 2], -1, 1)))


# The wheels' contacts.


@pytest.mark.parametrize(
    "wall",
    [
        PLAIN,
        pipe(ovality_pct=4.0, ovality_clock_deg=25.0),
        carved("2:00", 0.0),
        pipe(
            features=(Scratch(distance_mm=0, clock_deg=60, depth_mm=2, path_length_mm=60, width_mm=4, heading_deg=30),)
        ),
    ],
    ids=["plain", "oval", "pocket", "scratch"],
)
def test_contact_is_the_deepest_point_of_the_rim(wall):
    rng = np.random.default_rng(1)
    phi, across = np.meshgrid(np.linspace(-1.2, 1.2, 801), np.linspace(-5, 5, 81))
    rim = 19 - 20 + np.sqrt(400 - across**2)
    for _ in range(25):
        theta, z = np.radians(60 + rng.uniform(-20, 20)), rng.uniform(-60, 60)
        outward = wall_direction(theta)
        axle = Rotation.from_rotvec(rng.normal(0, 0.02, 3)).apply(np.cross([0, 0, 1.0], outward))
        hub = (wall.bore_radius_mm - 19 + rng.uniform(0.05, 2)) * outward + [0, 0, z]
        radial = outward - outward @ axle * axle
        radial /= np.linalg.norm(radial)
        points = (
            hub
            + across[..., None] * axle
            + rim[..., None] * (np.cos(phi)[..., None] * radial + np.sin(phi)[..., None] * np.cross(axle, radial))
        )
        x, y, along = np.moveaxis(points, -1, 0)
        least = (wall.radius(np.arctan2(x, -y), along) - np.hypot(x, y)).min()

        count, wheel, gap, point, frame = wheel_contacts(wall.wall, hub[None], axle[None], NO_TURN, WHEEL)
        if least >= 0:
            assert count == 0
            continue
        at = point[:count]
        raw = wall.radius(np.arctan2(at[:, 0], -at[:, 1]), at[:, 2]) - np.hypot(at[:, 0], at[:, 1])
        assert raw.min() == pytest.approx(least, abs=0.01 + 0.03 * abs(least))
        assert (wheel[:count] == 0).all()
        assert (gap[:count] < 0).all()
        np.testing.assert_allclose(frame[:count] @ np.swapaxes(frame[:count], 1, 2), [np.eye(3)] * count, atol=1e-9)


def test_on_the_plain_bore_the_normal_is_inward_and_rolling_is_forward():
    for theta in np.radians([60, 180, 300]):
        outward = wall_direction(theta)
        axle = np.cross([0, 0, 1.0], outward)
        count, _, gap, point, frame = wheel_contacts(PLAIN.wall, (57.3 * outward)[None], axle[None], NO_TURN, WHEEL)
        assert count == 1
        assert gap[0] == pytest.approx(-0.1, abs=1e-6)
        np.testing.assert_allclose(point[0], 76.3 * outward, atol=1e-4)
        np.testing.assert_allclose(frame[0, 0], -outward, atol=1e-6)
        assert abs(frame[0, 1, 2]) == pytest.approx(1, abs=1e-6)


def test_rollers_make_the_wheel_swell_and_shrink_as_it_turns():
    outward = wall_direction(np.radians(60))
    axle, wheel, turns = np.cross([0, 0, 1.0], outward)[None], WHEEL.copy(), np.linspace(0, 2 * np.pi / 10, 9)
    wheel[0, 3] = 0.02
    gaps = [wheel_contacts(PLAIN.wall, 57.3 * outward[None], axle, np.array([turn]), wheel)[2][0] for turn in turns]
    np.testing.assert_allclose(gaps, -0.1 - 0.02 * np.cos(10 * turns), atol=5e-3)


def test_a_step_looks_at_the_features_nearby_however_long_the_pipe():
    pockets = [
        Pocket(distance_mm=250 * k + 200, clock_deg="4:00", depth_mm=4, length_mm=40, width_mm=30) for k in range(200)
    ]
    hub_z_mm = np.array([100.0, 180.0])
    few, many = (pipe(end_mm=50_000, features=tuple(pockets[:n])).wall for n in (4, 200))
    assert many.codes.size == 200
    np.testing.assert_array_equal(_nearby(many, hub_z_mm).rows, _nearby(few, hub_z_mm).rows)
    assert _nearby(many, hub_z_mm + 25_000).codes.size <= 2


def test_a_wheel_bridges_a_short_pocket_on_both_its_edges():
    wall = carved("2:00", 0.0, length_mm=20.0).wall
    outward = wall_direction(np.radians(60))
    count, _, _, point, _ = wheel_contacts(
        wall,
        (76.2 - 19 + 3.6) * outward[None],
        np.cross([0, 0, 1.0], outward)[None],
        NO_TURN,
        WHEEL,
    )
    assert count == 2
    assert sorted(np.sign(point[:2, 2])) == [-1, 1]


def test_rest_agrees_with_a_ring_of_boxes():
    """Ball-shaped wheels, nearly free of friction, in MuJoCo's own collision with flats that touch the same bore.

    A ring of 48 is too coarse: on one flat nothing centres a wheel, and the robot sags 6 % more.
    """
    import mujoco

    robot = EXACT.model_copy(update={"wheel_friction": 0.001, "wheel_crown_radius_mm": 19.0})
    _, data, _ = at_rest(PLAIN, robot)

    spec = robot_spec(PLAIN, robot, draw_build(robot, np.random.default_rng(0)))
    for geom in spec.geoms:
        if geom.name in wheel_names(robot):
            radius = geom.size[0]
            geom.type, geom.size, geom.fromto = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0], np.full(6, np.nan)
            geom.contype = geom.conaffinity = 1
            geom.friction, geom.solref, geom.solimp = [0.001, 0, 0], SOLREF, SOLIMP
    for theta in 2 * np.pi * np.arange(480) / 480:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.6 * MM, 5 * MM, 0.5],
            pos=(PLAIN.bore_radius_mm + 5) * MM * wall_direction(theta),
            quat=[np.cos(theta / 2), 0, 0, np.sin(theta / 2)],
            friction=[0.001, 0, 0],
            solref=SOLREF,
            solimp=SOLIMP,
        )
    model = spec.compile()
    boxes = mujoco.MjData(model)
    boxes.qpos[:] = 0
    boxes.qpos[2:4] = -MM * robot.camera_ahead_mm, 1
    model.dof_damping[:] *= 8
    for _ in range(1500):
        mujoco.mj_step(model, boxes)

    assert boxes.ncon >= data.ncon == len(wheel_names(robot))
    np.testing.assert_allclose(data.qpos[:2] / MM, boxes.qpos[:2] / MM, atol=0.05)
    np.testing.assert_allclose(data.qpos[4:7], boxes.qpos[4:7], atol=2e-4)


def test_forces_at_rest_carry_the_weight():
    import mujoco

    model, data, _ = at_rest(PLAIN, EXACT)
    total, force = np.zeros(3), np.zeros(6)
    for i in range(data.ncon):
        assert data.contact.geom1[i] == model.model.geom(WALL).id
        mujoco.mj_contactForce(model.model, data, i, force)
        total += np.array(data.contact.frame[i]).reshape(3, 3).T @ force[:3]
    weight = model.model.body_mass.sum() * 9.80665
    np.testing.assert_allclose(total, [0, -weight, 0], atol=0.02)


# The drive.


def test_gravity_sags_it_by_what_its_springs_say(truth):
    """Stiffness across is that of the legs (1 + 1/4 + 1/4) and of the end wheels, which carry their preload."""
    robot = Robot()
    stiffness = 1.5 * robot.leg_stiffness_n_m + 2 * robot.end_wheel_stiffness_n_m
    sprung = robot.chassis_mass_kg + robot.batteries_mass_kg + robot.sensor_mass_kg
    sag_mm = (sprung * 9.80665 - 2 * robot.end_wheel_preload_n) / stiffness * 1e3
    assert truth.position_mm[0, 1] == pytest.approx(sag_mm, abs=0.6)


def test_on_a_clean_pipe_it_keeps_its_offset_tilt_and_grip(motion, truth):
    assert motion.touching.all()
    assert np.ptp(truth.position_mm[:, :2], axis=0).max() < 0.08
    assert tilt_deg(truth).max() < 0.1
    assert np.abs(truth.slip_mm_s).max() < 0.2


def test_encoders_are_within_a_fifth_of_a_percent(truth):
    travel = truth.position_mm[-1, 2] - truth.position_mm[0, 2]
    rolled = np.median(truth.wheel_angle_rad[-1]) * Robot().wheel_radius_mm
    assert rolled == pytest.approx(travel, rel=0.002)


def test_it_cruises_at_the_commanded_speed(truth):
    speed = np.gradient(truth.position_mm[:, 2], STEP_S)
    np.testing.assert_allclose(speed[1000:3000], 50.0, rtol=0.005)


def test_a_skewed_end_wheel_makes_it_drift_in_roll_and_an_exact_robot_does_not(truth):
    drift = np.degrees(2 * truth.q_pipe_camera_wxyz[-1, 3])
    assert 0.01 < abs(drift) < 2
    exact = simulate(PLAIN, EXACT, RobotDrive(end_mm=60), np.random.default_rng(0))
    assert abs(np.degrees(2 * exact.q_pipe_camera_wxyz[-1, 3])) < 1e-3
    assert np.abs(exact.position_mm[:, 0]).max() < 1e-3


def test_a_pocket_between_the_legs_leaves_it_unmoved():
    truth = simulate(carved("4:00"), Robot(), RobotDrive(start_mm=150, end_mm=350), np.random.default_rng(0))
    assert np.ptp(truth.position_mm[:, :2], axis=0).max() < 0.08


@pytest.mark.parametrize("clock", ["4:00", "2:00", "6:00"])
def test_it_survives_a_pocket_under_its_wheels(clock):
    """At 4 o'clock the robot has rolled until a leg and the end wheels stand there."""
    start = RobotDrive(start_mm=160, end_mm=500, speed_mm_s=100)
    roll = (RollStage(start_s=0.0, duration_s=1.0, rate_deg_s=-60.0),) if clock == "4:00" else ()
    drive = start.model_copy(update={"roll": roll})
    motion = simulate_motion(carved(clock, 170.0), Robot(), drive, np.random.default_rng(0))
    truth = truth_of(PLAIN, Robot(), motion)
    assert not motion.touching.all()
    assert motion.touching[-1].sum() >= 7  # rolled, a wheel may stand off by its rollers' ripple
    assert tilt_deg(truth).max() < 6
    assert truth.position_mm[-1, 2] == pytest.approx(500, abs=8)


def test_drag_makes_it_slip():
    def distance(drag_n: float) -> float:
        drive = RobotDrive(end_mm=60, tether_drag_n=drag_n)
        return float(simulate(PLAIN, EXACT, drive, np.random.default_rng(0)).position_mm[-1, 2])

    assert distance(0) - distance(8) > 0.05


def test_failures_say_why():
    rng = np.random.default_rng(0)
    with pytest.raises(DriveFailed, match=r"stuck at .* s, camera at z = "):
        simulate(PLAIN, EXACT, RobotDrive(end_mm=200, tether_drag_n=60), rng)
    with pytest.raises(DriveFailed, match=r"legs reach a bore of 68\.2 to 84\.2 mm"):
        simulate(pipe(inner_radius_mm=60.0), EXACT, RobotDrive(end_mm=100), rng)
    with pytest.raises(DriveFailed, match="tips by"):
        simulate(carved("6:00", 170.0), EXACT, RobotDrive(start_mm=160, end_mm=330, tipped_deg=0.5), rng)


def test_it_climbs_and_slips_a_little_more_there():
    up = pipe(inclination_deg=-30.0)
    truth = simulate(up, Robot(), RobotDrive(end_mm=60), np.random.default_rng(0))
    assert truth.position_mm[-1, 2] == pytest.approx(60, abs=0.5)


def test_settings_that_cannot_be_built_are_refused():
    with pytest.raises(ValidationError, match="room for a wheel"):
        Robot(chassis_radius_mm=55)
    with pytest.raises(ValidationError, match="roller_friction"):
        Robot(roller_friction=0.1)
    assert len(motor_names(Robot())) == 5
