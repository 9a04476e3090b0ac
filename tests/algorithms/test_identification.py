"""Each estimator finds what was hidden in made-up data, and its interval holds it as often as it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from algorithms.identification.estimate import Estimate, Unknown, blocks_of, of_blocks, of_share
from algorithms.identification.inertial import (
    Imu,
    gyro_bias,
    motion_by_wheels,
    noise_density,
    random_walk,
    rest_by_wheels,
)
from algorithms.identification.picture_noise import noise_of, photon_and_read, quarters
from algorithms.identification.shaking import vibration
from algorithms.identification.slits import knot_correlation
from algorithms.identification.wheels import consensus_mm, wheel_figures
from sensor_model.geometry import GRAVITY_M_S2
from sensor_model.rig import preset_rig

RATE_HZ, COUNT_MM = 100.0, 0.007
ZERO = Estimate(0.0, 0.0, 0.0, 1, "none")


def imu(seconds: float, gyro_density: float = 0.0, rest_s: float = 0.0, seed: int = 0) -> Imu:
    rng, n = np.random.default_rng(seed), round(seconds * RATE_HZ)
    time_s = np.arange(n) / RATE_HZ
    gyro = rng.standard_normal((n, 3)) * gyro_density * np.sqrt(RATE_HZ)
    force = np.tile([0.0, -GRAVITY_M_S2, 0.0], (n, 1))
    return Imu(time_s, gyro, force, time_s < rest_s, time_s >= rest_s)


def covered(found: list, truth: float) -> int:
    return sum(one.low <= truth <= one.high for one in found)


def test_intervals_hold_the_mean_and_the_share_as_often_as_they_say():
    rng = np.random.default_rng(1)
    means = [of_blocks(3.0 + rng.standard_normal(6), "drawn") for _ in range(400)]
    assert 0.92 <= covered(means, 3.0) / 400 <= 0.98
    tries = np.full(8, 300.0)
    shares = [of_share(rng.binomial(300, 0.02, 8).astype(float), tries, "drawn") for _ in range(400)]
    assert covered(shares, 0.02) / 400 >= 0.93
    assert isinstance(of_blocks(np.array([1.0]), "one"), Unknown)
    assert [part.stop - part.start for part in blocks_of(10, 3)] == [3, 4, 3]


@pytest.mark.parametrize("rest_s", [0.0, 4.0])
def test_noise_density_is_found_in_rest_and_in_calm_motion(rest_s):
    found = [noise_density(imu(6.0, 3e-4, rest_s, seed), "gyro") for seed in range(40)]
    assert covered(found, 3e-4) >= 35
    assert ("no rest" in found[0].source) == (rest_s == 0)
    assert sum(one.high < 1.5 * one.low for one in found) >= 35


def test_noise_under_shaking_without_rest_is_only_bounded():
    quiet = imu(8.0, 3e-4)
    shaken = quiet.gyro_rad_s + 0.01 * np.sin(2 * np.pi * 30 * quiet.time_s)[:, None]
    found = noise_density(Imu(quiet.time_s, shaken, quiet.force_m_s2, quiet.at_rest, quiet.moving), "gyro")
    assert found.low == 0
    assert found.high > 3e-4
    assert "not told apart" in found.source


def test_a_bias_walk_wants_a_long_rest():
    assert "300 s are needed" in random_walk(imu(20.0, 3e-4, 20.0), "gyro").reason
    rng, n = np.random.default_rng(2), round(3600 * RATE_HZ)
    walk = np.cumsum(rng.standard_normal((n, 3)), axis=0) * 2e-4 / np.sqrt(RATE_HZ)
    still = imu(3600.0, 3e-4, 3600.0)
    found = random_walk(
        Imu(still.time_s, still.gyro_rad_s + walk, still.force_m_s2, still.at_rest, still.moving), "gyro"
    )
    assert found.low <= 2e-4 <= found.high
    assert found.high < 1.5 * found.low


def test_bias_is_the_mean_at_rest_or_what_the_poses_do_not_turn():
    bias = np.array([1e-3, -2e-3, 5e-4])
    for rest_s, frame_s in ((5.0, np.zeros(0)), (0.0, np.linspace(0, 9.9, 150))):
        held = 0
        for seed in range(20):
            log = imu(10.0, 2e-4, rest_s, seed)
            biased = Imu(log.time_s, log.gyro_rad_s + bias, log.force_m_s2, log.at_rest, log.moving)
            found = gyro_bias(biased, frame_s, np.zeros((max(frame_s.size - 1, 0), 3)), 1e-5, 2e-4, 5e-5)
            held += sum(one.low <= value <= one.high for one, value in zip(found, bias, strict=True))
        assert held >= 54  # of 60
    words = gyro_bias(imu(10.0, 2e-4), np.zeros(0), np.zeros((0, 3)), 0.0, 2e-4, 5e-5)
    assert all("neither rest nor poses" in one.reason for one in words)


def test_shaking_is_found_in_its_band_and_the_lever_s_part_is_not_the_camera_s():
    mount = preset_rig().imu
    quiet = imu(21.0, 1e-4, 1.0)
    rng = np.random.default_rng(4)
    n = quiet.time_s.size
    hz = np.fft.rfftfreq(n, 1 / RATE_HZ)
    inside = (hz >= 10) & (hz < 20)
    rate = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * inside, n)
    rate *= 0.02 / rate.std()
    omega = 2 * np.pi * np.maximum(hz, 1.0)
    spectrum = np.fft.rfft(rate)
    angle, speed_up = np.fft.irfft(spectrum / (1j * omega), n), np.fft.irfft(spectrum * 1j * omega, n)
    lever_m = np.array(mount.position_camera_mm) / 1e3
    about_x = np.array([1.0, 0.0, 0.0])
    gravity = np.array([0.0, -GRAVITY_M_S2, 0.0])
    force = gravity + np.outer(speed_up, np.cross(about_x, lever_m)) - np.outer(angle, np.cross(about_x, gravity))
    R = mount.R_camera_imu
    log = Imu(quiet.time_s, np.outer(rate, about_x) @ R, force @ R, quiet.at_rest, quiet.moving)
    band = next(one for one in vibration(log, mount, ZERO, ZERO) if one.from_hz == 10)
    assert band.rate_rad_s[0].low <= 0.02 <= band.rate_rad_s[0].high
    assert band.rate_rad_s[0].high < 1.3 * band.rate_rad_s[0].low
    swung = float(np.abs(speed_up).std() * np.linalg.norm(lever_m))
    assert all(one.low < 0.2 * swung for one in band.force_m_s2)
    assert vibration(imu(0.9), mount, ZERO, ZERO) == []


def test_a_weak_band_beside_a_strong_one_is_not_taken_for_its_leakage():
    held, off = 0, []
    for seed in range(30):
        quiet, rng = imu(7.0, 0.0, 1.0), np.random.default_rng(seed)
        n = quiet.time_s.size
        hz = np.fft.rfftfreq(n, 1 / RATE_HZ)
        rate = np.zeros(n)
        for (low, high), rms in (((5, 10), 0.02), ((10, 20), 0.006), ((20, 40), 0.02)):
            part = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * ((hz >= low) & (hz < high)), n)
            rate += rms * part / part.std()
        log = replace(quiet, gyro_rad_s=np.outer(rate, preset_rig().imu.R_camera_imu[0]))
        weak = next(one for one in vibration(log, preset_rig().imu, ZERO, ZERO) if one.from_hz == 10).rate_rad_s[0]
        held += weak.low <= 0.006 <= weak.high
        off.append(weak.value / 0.006)
    assert held >= 26
    assert np.mean(np.square(off)) == pytest.approx(1, abs=0.3)  # with all that leaks in it would be 2


def rolled(seconds: float = 10.0) -> np.ndarray:
    """Three wheels at 100 Hz, scaled, counted in steps of 7 um, the third slipping by 3 mm at once."""
    way = np.clip(np.arange(0, seconds, 0.01) - 1.5, 0, None)[:, None] * 50.0 * np.array([1.0, 1.01, 0.996])
    way[600:, 2] += np.clip(np.arange(way.shape[0] - 600) * 0.1, 0, 3)
    return np.round(way / COUNT_MM) * COUNT_MM


def test_wheels_are_scaled_against_each_other_whatever_one_of_them_slips():
    figures = wheel_figures(rolled(), 0.01, COUNT_MM)
    mean = np.mean([1.0, 1.01, 0.996])
    for one, factor in zip(figures.scale, (1.0, 1.01, 0.996), strict=True):
        assert one.low <= mean / factor - 1 <= one.high
        assert one.high - one.low < 5e-4
    # the third wheel's slip of 3 mm is outvoted
    way = consensus_mm(rolled(), figures, 0.01)
    assert way[-1] == pytest.approx(8.49 * 50 * mean, abs=0.3)


def test_a_dead_wheel_is_named_and_a_standing_robot_has_no_scales():
    dead = rolled()
    dead[:, 1] = 0
    figures = wheel_figures(dead, 0.01, COUNT_MM)
    assert figures.dead.tolist() == [False, True, False]
    assert "stands while the others roll" in figures.scale[1].reason
    assert "are needed" in wheel_figures(rolled()[:150], 0.01, COUNT_MM).scale[0].reason


def test_rest_and_motion_come_from_the_wheels():
    stamps = (np.arange(1000) * 1e7).astype(np.int64)
    way = rolled()
    rest, moving = (of(stamps, stamps, way) for of in (rest_by_wheels, motion_by_wheels))
    assert rest[30:135].all()
    assert not rest[150:].any()
    assert moving[200:950].all()
    assert not moving[:130].any()
    assert not (rest & moving).any()


def test_photon_and_read_noise_are_found_on_a_ramp_of_light():
    rng = np.random.default_rng(3)
    ramp = np.linspace(0.0, 0.8, 600)[None, :, None] * np.linspace(0.2, 1, 400)[:, None, None] * np.ones(3)
    light = ramp + rng.standard_normal(ramp.shape) * np.sqrt(0.02**2 * ramp + 0.005**2)
    picture = np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.4)).astype(np.uint8)
    parts = np.array([noise_of(part, 2.4) for part in quarters(picture)])
    shot, read = photon_and_read(parts, 2.4)
    assert shot.low <= 0.02 <= shot.high
    assert read.low <= 0.005 <= read.high
    assert shot.high < 1.15 * shot.low
    assert np.isnan(noise_of(np.full((200, 200, 3), 80, np.uint8), 2.4)).all()


def test_a_line_between_random_knots_is_as_alike_to_itself_as_stated():
    rng = np.random.default_rng(5)
    knots = rng.uniform(-1, 1, 40_000)
    line = np.interp(np.arange(0, 40_000 - 1, 0.05), np.arange(40_000), knots)
    lags = np.array([5, 10, 20, 30])
    seen = [np.mean(line[:-lag] * line[lag:]) / np.mean(line**2) for lag in lags]
    np.testing.assert_allclose(seen, knot_correlation(lags / 20), atol=0.02)
