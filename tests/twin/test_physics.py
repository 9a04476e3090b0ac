"""What drives the robot, and what stops it, against closed forms: Coulomb, creep, rolling, energy, and each cause."""

from __future__ import annotations

import numpy as np
import pytest

from sensor_model.geometry import rotation_from_wxyz, twist_about_z_rad
from twin.drives.base import DriveFailed
from twin.drives.motors import MotorFault, RollTo, Via, torque_limits_n_m, torque_share
from twin.drives.robot import RobotDrive, _place, _settle, simulate_motion, step
from twin.joints import Debris, Joint, Taper
from twin.pipe import Pipe
from twin.robot import SIZES, Robot, draw_build
from twin.robot_model import MM, STEP_S, build_model, wheel_names
from twin.simulate import simulate
from twin.surfaces import GRIP, Surface
from twin.truth import Truth
from twin.wheel_contact import WallContacts

EXACT = Robot(preload_tolerance_pct=0, wheel_toe_tolerance_deg=0, end_wheel_skew_tolerance_deg=0, roller_ripple_mm=0)


def pipe(**changes) -> Pipe:
    return Pipe(**{"inner_radius_mm": 76.2, "wall_thickness_mm": 7.5, **changes})


def all_over(state: str, creep_pct: float = 0.0) -> tuple[Surface, ...]:
    return (Surface(from_mm=-400, to_mm=900, state=state, creep_pct=creep_pct),)


def driven(robot: Robot = EXACT, world: Pipe | None = None, **settings) -> Truth:
    return simulate(world or pipe(), robot, RobotDrive(**settings), np.random.default_rng(0))


def roll_deg(truth: Truth) -> np.ndarray:
    return np.degrees(twist_about_z_rad(rotation_from_wxyz(truth.q_pipe_camera_wxyz)))


def at_rest(world: Pipe, robot: Robot = EXACT):
    import mujoco

    model = build_model(world, robot, draw_build(robot, np.random.default_rng(0)))
    contacts = WallContacts(world, model, (robot.wheel_friction, robot.roller_friction))
    data = mujoco.MjData(model.model)
    _place(data, world, robot, 0.0)
    _settle(model, data, contacts)
    return model, data, contacts


# Closed forms.


@pytest.mark.parametrize("state", ["dry", "oily"])
def test_coulomb_holds_just_below_its_limit_and_slides_just_above(state):
    """Motors holding, pulled along the pipe; beyond the limit the rest of the pull accelerates the whole robot."""

    def pulled(share: float) -> tuple[np.ndarray, float]:
        model, data, contacts = at_rest(pipe(surfaces=all_over(state)), EXACT)
        legs = contacts.found.wheel < len(wheel_names(EXACT)) - 2
        limit = GRIP[state] * EXACT.wheel_friction * data.efc_force[data.contact.efc_address[legs]].sum()
        speed_mm_s, rise = np.empty(800), 400
        for i in range(speed_mm_s.size):
            data.xfrc_applied[1, 2] = share * limit * min(i / rise, 1.0)
            step(model.model, data, contacts)
            speed_mm_s[i] = data.qvel[2] / MM
        return speed_mm_s, (share - 1) * limit / model.model.body_mass.sum() / MM

    held, _ = pulled(0.97)
    slid, acceleration = pulled(1.03)
    assert abs(held[-1]) < 0.2  # soft friction creeps
    assert np.polyfit(STEP_S * np.arange(300), slid[-300:], 1)[0] == pytest.approx(acceleration, rel=0.15)
    assert slid[-1] > 10 * abs(held[-1])


def test_a_metre_is_driven_within_a_fifth_of_a_percent():
    truth = driven(Robot(), pipe(end_mm=1400), end_mm=1000)
    assert truth.position_mm[-1, 2] == pytest.approx(1000, abs=2.0)


@pytest.mark.parametrize(("to_deg", "rate_deg_s"), [(8.0, 20), (25.0, 20), (-25.0, 20), (350.0, 120)])
def test_a_roll_is_reached_and_held_within_a_tenth_of_a_degree(to_deg, rate_deg_s):
    """A whole turn, too, as at a launch that calibrates the accelerometer."""
    told = (RollTo(start_s=0.2, to_deg=to_deg, rate_deg_s=rate_deg_s),)
    truth = driven(Robot(), end_mm=60, roll_to=told, dwell_s=1.5)
    last = truth.time_s > truth.time_s[-1] - 0.3
    np.testing.assert_allclose(np.unwrap(roll_deg(truth), period=360)[last], to_deg, atol=0.1)


def test_wheels_creep_by_the_share_of_the_limit_that_they_pull():
    """Five newtons against a limit of mu N: slip is that share of `creep_pct`, for wheels that share the load."""
    truth = driven(EXACT, pipe(surfaces=all_over("wet", 4.0)), end_mm=150, tether_drag_n=5.0)
    cruising = (truth.wheels.time_s > 1.0) & (truth.wheels.time_s < 2.5)
    limit = GRIP["wet"] * EXACT.wheel_friction * truth.wheels.force_n[cruising, :6].sum(axis=1).mean()
    slip_mm_s = truth.wheels.slip_mm_s[cruising, :6].mean()
    assert slip_mm_s / 50.0 == pytest.approx(0.04 * 5.0 / limit, rel=0.15)


def test_energy_is_never_created():
    """At rest it stays what it is, and a push only ever loses it; the wall's own softness holds a few microjoules."""
    import mujoco

    model, data, contacts = at_rest(pipe())
    model.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY

    def energy_j() -> float:
        mujoco.mj_energyPos(model.model, data)
        mujoco.mj_energyVel(model.model, data)
        return float(data.energy.sum())

    def most_j(steps: int) -> float:
        seen = []
        for _ in range(steps):
            step(model.model, data, contacts)
            seen.append(energy_j())
        return max(seen)

    start = energy_j()
    assert most_j(2000) < start + 2e-5
    data.qvel[:2] += 0.05
    pushed = energy_j()
    assert pushed > start + 1e-3
    assert most_j(1000) < pushed + 2e-5
    assert energy_j() == pytest.approx(start, abs=1e-3)


def test_forces_and_slip_in_the_truth_are_those_of_the_drive():
    truth = driven(Robot(), end_mm=120)
    log = truth.wheels
    assert log.force_n.dtype == log.slip_mm_s.dtype == np.float32
    assert log.time_s[-1] == pytest.approx(truth.time_s[-1], abs=0.005)
    preload = 3 * Robot().leg_preload_n
    assert log.force_n[:, :6].sum(axis=1).mean() == pytest.approx(preload, rel=0.15)
    cruising = (log.time_s > 1.0) & (log.time_s < 2.0)
    np.testing.assert_allclose(log.spin_rad_s[cruising, :6].mean(axis=0), 50 / 19, rtol=2e-3)
    slipped_mm = log.slip_mm_s[:, :6].sum(axis=0) * 0.005
    rolled_mm = truth.wheel_angle_rad[-1] * Robot().wheel_radius_mm - np.ptp(truth.position_mm[:, 2])
    assert slipped_mm.reshape(3, 2).mean(axis=1) == pytest.approx(rolled_mm, abs=0.25)


# Each cause has an effect of its own.


def test_a_stalled_motor_holds_its_wheels_and_then_goes_on():
    fault = MotorFault(leg=1, start_s=1.0, duration_s=1.5)
    truth = driven(EXACT, end_mm=200, faults=(fault,))
    stalled = (truth.time_s > 1.15) & (truth.time_s < 2.45)
    angle = truth.wheel_angle_rad
    assert np.ptp(angle[stalled, 1]) * 19 < 0.2
    missed_mm = (np.median(angle[-1, [0, 2]]) - angle[-1, 1]) * 19
    assert missed_mm == pytest.approx(50 * fault.duration_s, abs=2)
    dragged = ((truth.wheels.time_s > 1.15) & (truth.wheels.time_s < 2.45))[:, None] & (truth.wheels.force_n > 0)
    touching = truth.wheels.slip_mm_s[:, 2:4][dragged[:, 2:4]]  # lifted off by the pull, they chatter
    assert touching.mean() == pytest.approx(-50, abs=3)
    assert truth.position_mm[-1, 2] == pytest.approx(200, abs=3)


def test_a_weak_motor_has_less_torque_while_it_lasts():
    weak = MotorFault(leg=2, start_s=0.5, duration_s=1.0, kind="weak", torque_pct=30)
    limits = torque_limits_n_m(EXACT, [weak], 3000)
    assert sorted(limits) == [0, 500, 1500]
    full = EXACT.motor_torque_limit_n_mm * MM
    np.testing.assert_allclose(limits[500], full * np.array([1, 1, 0.3, 1, 1]))
    np.testing.assert_allclose(limits[1500], full)


def test_worn_wheels_go_less_far_than_they_count():
    worn = EXACT.model_copy(update={"wheel_diameter_error_pct": (-2.0, -2.0, -2.0)})
    truth = driven(worn, end_mm=120)
    assert truth.position_mm[-1, 2] == pytest.approx(0.98 * 120, abs=0.3)
    assert truth.wheel_angle_rad[-1] * 19 == pytest.approx(np.full(3, 120.0), abs=0.1)
    assert np.abs(truth.slip_mm_s).max() < 1


def test_wheels_of_unequal_size_work_against_each_other():
    unequal = EXACT.model_copy(update={"wheel_diameter_error_pct": (2.0, 0.0, -2.0)})
    log = driven(unequal, end_mm=120).wheels
    slip = np.where(log.force_n > 0, log.slip_mm_s, np.nan)[200:400]  # some are lifted off
    assert np.nanmean(slip[:, 0:2]) - np.nanmean(slip[:, 4:6]) == pytest.approx(0.04 * 50, rel=0.25)


def test_unequal_springs_press_unequally():
    soft = EXACT.model_copy(update={"leg_preload_error_pct": (0.0, -40.0, 40.0)})
    force = driven(soft, end_mm=20).wheels.force_n[:, :6].mean(axis=0).reshape(3, 2).sum(axis=1)
    even = driven(EXACT, end_mm=20).wheels.force_n[:, :6].mean(axis=0).reshape(3, 2).sum(axis=1)
    assert np.ptp(force - even) > 2
    assert abs(driven(soft, end_mm=20).position_mm[:, 0].mean()) > 1  # pushed aside


def test_a_steered_end_wheel_rolls_the_robot_on_a_helix():
    """By tan(steer) of travel along the wall, about the axis of a robot that stands a little below the pipe's."""
    steered = EXACT.model_copy(update={"end_wheel_steer_deg": 2.0})
    truth = driven(steered, end_mm=150)
    sag_mm = truth.position_mm[:, 1].mean()
    helix_deg = np.degrees(150 * np.tan(np.radians(2.0)) / (76.2 - sag_mm))
    assert abs(roll_deg(truth)[-1]) == pytest.approx(helix_deg, rel=0.06)
    assert abs(roll_deg(driven(EXACT.model_copy(update={"wheel_steer_deg": 2.0}), end_mm=150))[-1]) < helix_deg


def test_a_joint_and_debris_are_in_the_wall_and_under_the_wheels():
    joint = Joint(distance_mm=0, gap_mm=6, gap_depth_mm=1.5, bead_mm=20, bead_height_mm=1.0)
    lump = Debris(distance_mm=-60, clock_deg="6:00", diameter_mm=30, height_mm=3)
    rough = pipe(joints=(joint,), debris=(lump,))
    assert rough.radius(1.0, 0.0) == pytest.approx(76.7)
    assert rough.radius(1.0, 10.0) == pytest.approx(75.7)
    assert rough.radius(np.pi, -60.0) == pytest.approx(73.2)
    assert rough.radius(np.pi, -45.0) == pytest.approx(74.7)
    assert rough.radius(0.0, -60.0) == pipe().radius(0.0, -60.0) == 76.2
    truth = driven(EXACT, rough, start_mm=60, end_mm=200)
    smooth = driven(EXACT, start_mm=60, end_mm=200)
    assert truth.position_mm[-1, 2] == pytest.approx(200, abs=4)
    assert np.ptp(truth.position_mm[:, 1]) > np.ptp(smooth.position_mm[:, 1]) + 0.5
    assert truth.wheels.force_n.max() > 1.5 * smooth.wheels.force_n.max()


@pytest.mark.parametrize(("change_mm", "sign"), [(-4.0, 1), (4.0, -1)])
def test_its_springs_follow_a_change_of_the_bore(change_mm, sign):
    """Each leg gains or loses its stiffness times the change; the wall is where the taper says."""
    tapered = pipe(tapers=(Taper(from_mm=0, to_mm=40, radius_change_mm=change_mm),))
    radius = tapered.radius(1.0, np.array([-10.0, 20.0, 50.0, 800.0]))
    np.testing.assert_allclose(radius, 76.2 + change_mm * np.array([0, 0.5, 1, 1]))
    truth = driven(EXACT, tapered, end_mm=400)
    legs = truth.wheels.force_n[:, :6].sum(axis=1)
    gained = legs[-1] - legs[0]
    assert gained == pytest.approx(sign * 3 * EXACT.leg_stiffness_n_m * abs(change_mm) * MM, rel=0.15)
    assert truth.position_mm[-1, 2] == pytest.approx(400, abs=2)
    with pytest.raises(ValueError, match="at least twice radius_change_mm"):
        Taper(from_mm=0, to_mm=5, radius_change_mm=4)


@pytest.mark.parametrize("size_in", [4, 6, 8])
@pytest.mark.parametrize(("material", "series"), [("PVC", "Sch 40"), ("PE", "SDR 11")])
def test_each_size_of_robot_drives_in_its_pipes(size_in, material, series):
    world = Pipe(standard={"material": material, "series": series, "nominal_size_in": size_in})
    truth = driven(SIZES[f"{size_in}-inch"], world, end_mm=60)
    assert truth.position_mm[-1, 2] == pytest.approx(60, abs=0.3)
    assert (truth.wheels.force_n[-1] > 0).all()


def test_a_motor_is_weaker_the_faster_it_turns_and_the_emptier_its_battery():
    motor = EXACT.model_copy(update={"motor_no_load_turns_s": 0.5, "supply_pct": 80.0})
    share = torque_share(motor, 2 * np.pi * np.array([0.0, 0.2, -0.2, 0.5]))
    np.testing.assert_allclose(share, [0.8, 0.4, 0.4, 0.0])
    assert driven(motor, end_mm=100, speed_mm_s=40).position_mm[-1, 2] == pytest.approx(100, abs=1)
    hurried = driven(motor, end_mm=150, speed_mm_s=60)
    speed_mm_s = np.gradient(hurried.position_mm[:, 2], hurried.time_s)[1000:2000].mean()
    assert 40 < speed_mm_s < 0.4 * 2 * np.pi * 19


def test_a_motor_s_friction_is_overcome_by_the_motor():
    rubbing = EXACT.model_copy(update={"motor_friction_n_mm": 60.0})
    assert driven(rubbing, end_mm=60).position_mm[-1, 2] == pytest.approx(60, abs=0.5)
    seized = EXACT.model_copy(update={"motor_friction_n_mm": 400.0})
    with pytest.raises(DriveFailed, match=r"told to go \d+ mm, its wheels rolled \d mm"):
        driven(seized, end_mm=100)


def test_it_stops_goes_on_and_reverses():
    stops = (Via(to_mm=60, dwell_s=0.4), Via(to_mm=20, dwell_s=0.2))
    truth = driven(EXACT, via=stops, end_mm=50)
    z, move_s = truth.position_mm[:, 2], lambda way_mm: way_mm / 50 + 0.3
    stands = np.cumsum([move_s(60), 0.4, move_s(40), 0.2])
    assert z[np.searchsorted(truth.time_s, stands[1] - 0.02)] == pytest.approx(60, abs=0.2)
    assert z[np.searchsorted(truth.time_s, stands[3] - 0.02)] == pytest.approx(20, abs=0.2)
    assert z[-1] == pytest.approx(50, abs=0.2)
    assert truth.slip_mm_s[(truth.time_s > 2.2) & (truth.time_s < 2.6)].max() < 1


def test_it_climbs_a_vertical_pipe():
    up = pipe(inclination_deg=-90.0)
    strong = EXACT.model_copy(update={"leg_preload_n": 25.0})
    truth = driven(strong, up, end_mm=60)
    assert truth.position_mm[-1, 2] == pytest.approx(60, abs=1)
    # nothing pulls it to one side but its end wheels
    aside_mm = 2 * strong.end_wheel_preload_n / (1.5 * strong.leg_stiffness_n_m + 2 * strong.end_wheel_stiffness_n_m)
    assert truth.position_mm[:, 1].mean() == pytest.approx(-1e3 * aside_mm, abs=0.7)


# What cannot be driven says so.


def test_a_drive_that_cannot_move_says_what_force_is_missing():
    with pytest.raises(
        DriveFailed, match=r"stuck at .*grip 18\.0 N, motors 47\.4 N\) against 60\.0 N .*: 42\.0 N are missing"
    ):
        driven(EXACT, end_mm=200, tether_drag_n=60)
    with pytest.raises(DriveFailed, match=r"grip 3\.6 N.*: 4\.4 N are missing"):
        driven(EXACT, pipe(surfaces=all_over("oily")), end_mm=200, tether_drag_n=8)
    feeble = EXACT.model_copy(update={"motor_torque_limit_n_mm": 40.0})
    with pytest.raises(DriveFailed, match=r"motors 6\.3 N\).*N are missing"):
        driven(feeble, end_mm=200, tether_drag_n=9)


def test_a_simulation_that_diverges_is_caught_with_its_time_and_its_body(monkeypatch):
    import twin.drives.robot as module

    taken = iter(range(10**6))

    def disturbed(model, data, contacts):
        step(model, data, contacts)
        if next(taken) == 1700:
            data.qvel[model.jnt_dofadr[model.joint("leg1_rear").id]] = np.nan

    monkeypatch.setattr(module, "step", disturbed)
    with pytest.raises(DriveFailed, match=r"diverges at 0\.2\d s: body .* moves at nan m/s"):
        driven(EXACT, end_mm=60)


def test_a_robot_of_another_size_does_not_fit():
    with pytest.raises(DriveFailed, match=r"does not fit: its legs reach a bore of 68\.2 to 84\.2 mm"):
        simulate_motion(pipe(inner_radius_mm=50.0), EXACT, RobotDrive(end_mm=60), np.random.default_rng(0))
