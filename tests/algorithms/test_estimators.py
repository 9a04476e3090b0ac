"""Estimators of distance and roll on drives in closed form: laws over all, then slip, rest, silence and honesty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from algorithms.localisation import ESTIMATORS
from algorithms.localisation.fused import FusedSettings
from algorithms.localisation.fused_model import InertialSettings, WheelSettings
from algorithms.localisation.gaps import log_gaps
from algorithms.localisation.slip import SlipSettings, fit_line
from algorithms.localisation.voting import VotingSettings, hypotheses, slipping
from algorithms.localisation.wheels import calibrate_wheels
from scenarios.bench.drive_logs import Drive, DriveLog, SlipEpisode, estimate, make_log, nees
from sensor_model.recording import NominalPipe, Recording
from sensor_model.rig import preset_rig

RIG = preset_rig()
FUSED = FusedSettings()
TINY = 1e-9
EXACT_IMU = InertialSettings(**{name: TINY for name in InertialSettings.model_fields if name != "slope_deg"})
EXACT_WHEELS = WheelSettings(
    common_scale_std_pct=0, scale_std_pct=TINY, slip_std_pct=0, noise_mm=TINY, noise_mm_per_sqrt_m=TINY
)
CHI2_2_95 = 5.991


def _log(seed: int = 0, inertial=FUSED.inertial, wheels=FUSED.wheels, **drive) -> DriveLog:
    return make_log(Drive(**drive), RIG, inertial, wheels, np.random.default_rng(seed))


@pytest.mark.parametrize("kind", list(ESTIMATORS))
def test_exact_sensors_give_exact_distance_and_roll(kind):
    log = _log(inertial=EXACT_IMU, wheels=EXACT_WHEELS, seconds=6.0)
    found = estimate(log, RIG, ESTIMATORS[kind].settings())
    assert np.abs(found.error[:, 0]).max() < (3.0 if kind == "accel" else 0.05)
    assert np.degrees(np.abs(found.error[:, 1])).max() < 0.1


@pytest.mark.parametrize("kind", list(ESTIMATORS))
def test_an_estimate_says_what_it_is_worth_and_never_claims_more_as_it_goes_blind(kind):
    found = estimate(_log(seconds=6.0), RIG, ESTIMATORS[kind].settings())
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    distance_std = np.sqrt(found.covariance[:, 0, 0])
    assert (np.diff(distance_std) >= -1e-9).all()


def test_integrating_the_accelerometer_is_no_odometry():
    log = _log(seconds=12.0)
    paper, accel = (estimate(log, RIG, ESTIMATORS[kind].settings()) for kind in ("paper", "accel"))
    assert abs(accel.error[-1, 0]) > 20 * abs(paper.error[-1, 0])
    assert abs(accel.error[-1, 0]) < 4 * np.sqrt(accel.covariance[-1, 0, 0])


def test_fused_errors_are_as_large_as_stated():
    inside, back = [], []
    for seed in range(6):
        found = estimate(_log(seed, seconds=6.0, frame_rate_hz=10.0), RIG, FUSED)
        inside.append(nees(found.error, found.covariance)[5::10] < CHI2_2_95)
        back.append(nees(found.back_error, found.back_covariance)[5:-1:10] < CHI2_2_95)
    assert np.mean(inside) > 0.85
    assert np.mean(back) > 0.85


def test_looking_back_knows_more():
    found = estimate(_log(seconds=10.0), RIG, FUSED)
    middle = found.error.shape[0] // 2
    assert found.back_covariance[middle, 1, 1] < found.covariance[middle, 1, 1]
    assert np.allclose(found.back_error[-1], found.error[-1], atol=1e-6)


@pytest.mark.parametrize("speed", [-50.0, 40.0, 4.0])
def test_a_wheel_that_slips_is_outvoted_and_named_in_time(speed):
    slip = SlipEpisode(1, 1.5, 12.0 / abs(speed), speed)
    clean, found = (estimate(_log(2, seconds=6.0, slips=slips), RIG, FUSED) for slips in ((), (slip,)))
    assert not clean.episodes
    (episode,) = found.episodes
    assert (episode.kind, episode.who) == ("slip", "wheel 2")
    assert episode.start_ns / 1e9 < 1.5 + 5.0 / abs(speed) + 0.5
    assert episode.amount == pytest.approx(np.sign(speed) * 12, abs=2)
    assert abs(found.error[-1, 0] - clean.error[-1, 0]) < 0.6


def test_all_wheels_that_spin_at_once_are_noticed_by_the_accelerometer():
    slip = SlipEpisode(None, 2.5, 0.5, 80.0)
    clean, found = (estimate(_log(3, seconds=6.0, slips=slips), RIG, FUSED) for slips in ((), (slip,)))
    assert [episode.who for episode in found.episodes] == ["all wheels"]
    assert abs(found.error[-1, 0] - clean.error[-1, 0]) < 20  # of 40 mm


def test_rolling_once_at_the_launch_finds_an_uncalibrated_accelerometer():
    biased = FUSED.inertial.model_copy(update={"accelerometer_bias_m_s2": 0.3})
    settings = FusedSettings(inertial=biased)
    still, rolled = (
        estimate(
            _log(1, inertial=biased, seconds=8.0, frame_rate_hz=8.0, roll_deg=deg, roll_period_s=7.0), RIG, settings
        )
        for deg in (0.0, 90.0)
    )
    stds = [np.degrees(np.sqrt(found.back_covariance[-1, 1, 1])) for found in (still, rolled)]
    assert stds[0] > 1.5
    assert stds[1] < 0.5
    assert np.degrees(abs(rolled.back_error[-1, 1])) < 1.0


def test_in_a_vertical_pipe_roll_is_worth_as_much_as_the_gyroscope():
    found = estimate(_log(5, seconds=10.0, upright=True), RIG, FUSED)
    std_deg = np.degrees(np.sqrt(found.covariance[:, 1, 1]))
    assert std_deg[-1] == pytest.approx(FUSED.inertial.gyroscope_bias_deg_s * 10, rel=0.1)
    assert abs(np.degrees(found.error[-1, 1])) < 3 * std_deg[-1]


def test_a_silent_imu_is_named_and_roll_is_worth_less_meanwhile():
    log = _log(0, seconds=5.0)
    frames = list(log.frames)
    for k in range(40, 55):
        frames[k] = replace(frames[k], imu=frames[k].imu[:0], imu_stamps_ns=frames[k].imu_stamps_ns[:0])
    held = estimate(log, RIG, FUSED)
    found = estimate(replace(log, frames=tuple(frames)), RIG, FUSED)
    gaps = [episode for episode in found.episodes if episode.kind == "gap"]
    assert {gap.who for gap in gaps} == {"imu0"}
    assert found.covariance[54, 1, 1] > 4 * held.covariance[54, 1, 1]


def test_gaps_and_a_clock_that_jumps_are_named(tmp_path):
    def log(*cuts):
        stamps = np.arange(0, 10_000_000_000, 10_000_000)
        return stamps[~np.any([(stamps > a * 1e9) & (stamps < b * 1e9) for a, b in cuts], axis=0)] if cuts else stamps

    def recording(frames, imu, orientation, encoders):
        n = len(frames)
        return Recording(
            tmp_path,
            RIG,
            NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5),
            frames,
            ("",) * n,
            imu,
            np.zeros((len(imu), 6)),
            orientation,
            np.tile([1.0, 0, 0, 0], (len(orientation), 1)),
            encoders,
            np.zeros((len(encoders), 3), dtype=np.int64),
        )

    assert log_gaps(recording(log()[::7], log(), log(), log())) == ()
    (gap,) = log_gaps(recording(log()[::7], log(), log(), log((4, 5.5))))
    assert (gap.who, gap.start_ns / 1e9) == ("encoders0", 4.0)
    assert gap.amount == pytest.approx(1.5)
    (jump,) = log_gaps(recording(*[log((3, 8))] * 4))
    assert "clock" in jump.who


def test_votes_take_the_likeliest_set():
    quiet, spread = np.zeros(3, dtype=bool), np.full((3, 3), 10.0)
    seen = slipping(np.array([1.0, 1.1, 30.0]), spread, np.full(3, 0.04), quiet, quiet, VotingSettings())
    assert seen.tolist() == [False, False, True]
    same = slipping(np.array([2.0, 2.1, 1.9]), spread, np.full(3, 0.04), quiet, quiet, VotingSettings())
    assert not same.any()
    alike = slipping(np.array([20.0, 20.1, 19.9]), spread, np.full(3, 0.04), quiet, quiet, VotingSettings())
    assert alike.all()
    table = hypotheses(4)
    assert not table[0].any()
    assert table[-2:].all()
    assert len({tuple(row) for row in table.tolist()}) == len(table) - 1 == 1 + 4 + 6 + 1


def test_the_slip_line_is_found_on_some_drives_and_holds_on_another():
    rng = np.random.default_rng(0)
    rolled = rng.uniform(20, 60, 400)
    line = fit_line(rolled, 0.97 * rolled + 0.4 + 0.2 * rng.standard_normal(400))
    assert line.slope == pytest.approx(0.97, abs=0.002)
    assert line.intercept_mm_s == pytest.approx(0.4, abs=0.1)
    assert line.spread_mm_s == pytest.approx(0.2, rel=0.2)
    one_speed = fit_line(np.full(50, 50.0), np.full(50, 49.0))
    assert (one_speed.slope, one_speed.intercept_mm_s) == (pytest.approx(0.98), 0.0)
    with pytest.raises(ValueError, match="at least 10"):
        fit_line(np.zeros(50), np.zeros(50))
    worn = WheelSettings(common_scale_std_pct=3, scale_std_pct=0.01, slip_std_pct=0)
    log = _log(7, wheels=worn, seconds=10.0)
    paper = estimate(log, RIG, ESTIMATORS["paper"].settings()).error[-1, 0]
    other = fit_line(np.full(50, 50.0), np.full(50, 50.0 * (1 - paper / log.z_mm[-1])))
    judged = estimate(_log(7, wheels=worn, seconds=14.0), RIG, SlipSettings(**other._asdict())).error[-1, 0]
    assert abs(judged) < 0.1 * abs(paper)


def test_calibration_drives_tell_scale_and_what_it_may_be_off_by():
    rolled = np.array([[1010.0, 1000.0, 990.0], [2020.0, 2000.0, 1980.0], [1010.0, 1000.0, 700.0]])
    found = calibrate_wheels(rolled, np.array([1000.0, 2002.0, 999.0]))
    assert found.scale_pct[1] == pytest.approx(0.0, abs=0.1)
    assert found.scale_pct[0] - found.scale_pct[1] == pytest.approx(-0.99, abs=0.02)
    assert found.common_scale_std_pct == pytest.approx(0.1 * np.sqrt(4 / 3), rel=0.1)
    with pytest.raises(ValueError, match="at least 2"):
        calibrate_wheels(rolled[:1], np.array([1000.0]))
    with pytest.raises(ValueError, match="3 encoder wheels"):
        estimate(_log(seconds=1.0), RIG, FusedSettings(wheels=WheelSettings(scale_pct=(1.0,))))
