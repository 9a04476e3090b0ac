"""Laws that every drive obeys, whatever moves the camera."""

from dataclasses import fields

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from twin.drives import DRIVES, AnyDrive
from twin.drives.gantry import GantryDrive, Stage
from twin.drives.motors import RollStage
from twin.drives.recorded import RecordedDrive, VibrationBand
from twin.drives.robot import RobotDrive
from twin.pipe import Pipe
from twin.robot import Robot
from twin.simulate import simulate
from twin.truth import ARRAYS, Truth, WheelLog

PIPE = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
ROBOT = Robot()
EXAMPLES = {
    "robot": RobotDrive(
        start_mm=12.5, end_mm=90.0, roll=(RollStage(start_s=0.4, duration_s=0.6, rate_deg_s=15.0),), dwell_s=0.1
    ),
    "gantry": GantryDrive(
        start_mm=12.5,
        stages=(Stage(to_mm=60.0, roll_to_deg=20.0), Stage(to_mm=40.0)),
        offset_mm=(4.0, -3.0),
        tilt_deg=(2.0, -1.5),
    ),
    "recorded": RecordedDrive(
        rows=tuple(
            (0.2 * i, 12.5 + 50 * share, 4.0, -3.0, 20.0 * share, 2.0, -1.5)
            for i, share in enumerate((0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 16))).tolist())
        )
    ),
}


@pytest.fixture(scope="module", params=sorted(DRIVES))
def truth(request: pytest.FixtureRequest) -> Truth:
    return simulate(PIPE, ROBOT, EXAMPLES[request.param], np.random.default_rng(3))


@pytest.fixture
def settings(truth: Truth, request: pytest.FixtureRequest) -> AnyDrive:
    return EXAMPLES[request.node.callspec.params["truth"]]


def test_every_kind_is_in_the_registry_and_has_an_example():
    assert set(EXAMPLES) == set(DRIVES)
    for kind, entry in DRIVES.items():
        read = TypeAdapter(AnyDrive).validate_python(EXAMPLES[kind].model_dump())
        assert type(read) is entry.settings
        assert read == EXAMPLES[kind]


def test_every_array_is_finite_and_a_row_a_time(truth):
    for name in ARRAYS:
        array = getattr(truth, name)
        assert np.isfinite(array).all()
        assert array.shape[0] == truth.time_s.size
    assert truth.wheel_angle_rad.shape == truth.slip_mm_s.shape == (truth.time_s.size, ROBOT.leg_count)


def test_the_clock_starts_at_zero_and_runs_at_500_hz_or_more(truth):
    assert truth.time_s[0] == 0
    assert (np.diff(truth.time_s) > 0).all()
    assert np.diff(truth.time_s).max() <= 1 / 500 + 1e-12


def test_it_starts_exactly_where_it_says_and_ends_near_there(truth, settings):
    assert truth.position_mm[0, 2] == pytest.approx(settings.start_mm, abs=1e-9)
    assert truth.position_mm[-1, 2] == pytest.approx(settings.end_mm, abs=0.5)
    assert settings.span_mm[0] - 0.5 < truth.position_mm[:, 2].min()
    assert truth.position_mm[:, 2].max() < settings.span_mm[1] + 0.5


def test_it_starts_and_ends_at_rest(truth):
    last = truth.time_s >= truth.time_s[-1] - 0.005
    for part in (truth.position_mm[:4], truth.position_mm[last]):
        assert np.ptp(part, axis=0).max() < 0.03


def test_quaternions_are_unit(truth):
    np.testing.assert_allclose(np.linalg.norm(truth.q_pipe_camera_wxyz, axis=1), 1.0, atol=1e-12)


def test_acceleration_integrates_to_velocity_and_velocity_to_position(truth):
    velocity = cumulative_trapezoid(truth.acceleration_mm_s2, truth.time_s, axis=0, initial=0)
    np.testing.assert_allclose(velocity, np.gradient(truth.position_mm, truth.time_s, axis=0), atol=0.5)
    position = cumulative_trapezoid(velocity, truth.time_s, axis=0, initial=0)
    np.testing.assert_allclose(position, truth.position_mm - truth.position_mm[0], atol=0.3)


def test_gyro_is_the_attitude_s_rate_in_the_camera_frame(truth):
    attitude = Rotation.from_quat(truth.q_pipe_camera_wxyz[:, [1, 2, 3, 0]])
    rate = (attitude[:-2].inv() * attitude[2:]).as_rotvec() / (truth.time_s[2:] - truth.time_s[:-2])[:, None]
    np.testing.assert_allclose(truth.angular_velocity_camera_rad_s[1:-1], rate, atol=2e-3)


def test_roll_goes_where_it_is_told(truth, settings):
    roll_deg = np.degrees(2 * np.arctan2(truth.q_pipe_camera_wxyz[-1, 3], truth.q_pipe_camera_wxyz[-1, 0]))
    told = 9.0 if settings.kind == "robot" else 20.0
    assert roll_deg == pytest.approx(told, rel=0.1)


def test_encoders_turn_forward_with_travel(truth):
    travel = truth.position_mm[:, 2] - truth.position_mm[0, 2]
    rolled = np.median(truth.wheel_angle_rad, axis=1) * ROBOT.wheel_radius_mm
    assert (truth.wheel_angle_rad[0] == 0).all()
    np.testing.assert_allclose(rolled, travel, atol=0.002 * np.ptp(travel))


def test_same_seed_same_bytes(truth, settings):
    again = simulate(PIPE, ROBOT, settings, np.random.default_rng(3))
    for name in ARRAYS:
        assert getattr(again, name).tobytes() == getattr(truth, name).tobytes()
    assert (truth.wheels is None) == (again.wheels is None) == (settings.kind != "robot")
    if truth.wheels is not None:
        for field in fields(WheelLog):
            assert getattr(again.wheels, field.name).tobytes() == getattr(truth.wheels, field.name).tobytes()


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        (RobotDrive(end_mm=800), "sees 229 mm ahead, to 1029 mm, and the pipe ends at 900 mm"),
        (RobotDrive(start_mm=-200, end_mm=0), "reaches 295 mm behind"),
        (GantryDrive(start_mm=0, stages=(Stage(to_mm=-390),)), "the pipe starts at -400 mm"),
    ],
)
def test_a_drive_that_leaves_the_pipe_is_refused(drive, words):
    with pytest.raises(ValueError, match=words):
        simulate(PIPE, ROBOT, drive, np.random.default_rng(0))


def recorded(**changes) -> Truth:
    return simulate(PIPE, ROBOT, EXAMPLES["recorded"].model_copy(update=changes), np.random.default_rng(3))


def test_a_recorded_path_passes_its_rows_and_its_wheels_slip_as_told():
    rows = EXAMPLES["recorded"].rows
    slip = tuple((0.0, 0.0, 0.1 * i) for i in range(len(rows)))
    truth, at = recorded(slip_mm=slip), np.searchsorted(recorded().time_s, [row[0] - 1e-9 for row in rows])
    np.testing.assert_allclose(truth.position_mm[at, 2], [row[1] for row in rows], atol=1e-6)
    rim = truth.wheel_angle_rad[at] * ROBOT.wheel_radius_mm
    np.testing.assert_allclose(rim[:, 2] - rim[:, 0], [row[2] for row in slip], atol=1e-6)
    assert truth.slip_mm_s[:, 2].mean() == pytest.approx(0.5, rel=0.01)


def test_a_recorded_path_shakes_in_its_band_by_as_much_as_told_and_not_at_rest():
    rows = tuple((float(t), 40.0 * min(t, 15), 0.0, 0.0, 0.0, 0.0, 0.0) for t in range(20))
    band = VibrationBand(from_hz=10, to_hz=20, acceleration_m_s2=(0.2, 0.0, 0.0), rate_deg_s=(0.0, 3.0, 0.0))
    pipe = PIPE.model_copy(update={"end_mm": 1000.0})
    truth, still = (
        simulate(pipe, ROBOT, RecordedDrive(rows=rows, vibration=bands), np.random.default_rng(5))
        for bands in ((band,), ())
    )
    on = slice(1000, 14_000)
    shaking = (truth.acceleration_mm_s2 - still.acceleration_mm_s2)[on] / 1e3
    np.testing.assert_allclose(shaking.std(axis=0), [0.2, 0.0, 0.0], atol=0.02)
    rate = np.degrees(truth.angular_velocity_camera_rad_s[on])
    np.testing.assert_allclose(rate.std(axis=0), [0.0, 3.0, 0.0], atol=0.2)
    power = np.abs(np.fft.rfft(shaking[:, 0])) ** 2
    hz = np.fft.rfftfreq(shaking.shape[0], 1e-3)
    assert power[(hz > 9.5) & (hz < 20.5)].sum() > 0.98 * power.sum()
    assert np.ptp(truth.position_mm[-1000:, 0]) < 1e-3
    for name in ARRAYS:
        assert (
            getattr(still, name).tobytes()
            == getattr(simulate(pipe, ROBOT, RecordedDrive(rows=rows), np.random.default_rng(6)), name).tobytes()
        )


def test_a_recorded_path_that_cannot_be_is_refused():
    rows = EXAMPLES["recorded"].rows
    with pytest.raises(ValueError, match="must begin with 0, rise"):
        RecordedDrive(rows=rows[1:])
    with pytest.raises(ValueError, match="slip_mm must have 16 rows"):
        RecordedDrive(rows=rows, slip_mm=((0.0,),))
    with pytest.raises(ValueError, match="speaks of 2 wheels; the robot has 3"):
        recorded(slip_mm=((0.0, 0.0),) * 16)
