"""The IMU as a device: its noise by Allan deviation, its range, steps and axes, and the attitude it fuses itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from sensor_model.attitude_filter import NORTH_DIP_RAD, Fusion, Magnetometer
from sensor_model.geometry import GRAVITY_M_S2, rotation_from_wxyz
from sensor_model.imu import NO_IMU_NOISE, ImuNoise, measure_imu, world_from_pipe
from sensor_model.rig import preset_rig
from sensor_model.streams import stream
from twin.drives.gantry import GantryDrive, drive
from twin.pipe import Pipe
from twin.robot import Robot
from twin.truth import Truth, from_path

PIPE = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
MOUNT = preset_rig().imu


def at_rest(hours: float) -> Truth:
    time_s = np.linspace(0, 3600 * hours, 9)
    still = np.zeros((time_s.size, 3))
    return from_path(PIPE, time_s, still, np.tile([1.0, 0, 0, 0], (time_s.size, 1)), still)


def moved(**settings) -> Truth:
    return drive(PIPE, Robot(), GantryDrive(**settings), np.random.default_rng(0))


def log_of(truth: Truth, noise: ImuNoise, seed: int = 0):
    return measure_imu(truth, MOUNT, noise, stream(seed, "imu"), stream(seed, "attitude"))


def allan_variance(rates: np.ndarray, dt_s: float, spans: np.ndarray) -> np.ndarray:
    """Overlapping Allan variance (IEEE 1139) of (n, axes) rates over spans of samples, the mean of the axes."""
    angle = np.vstack([np.zeros(rates.shape[1]), np.cumsum(rates, axis=0) * dt_s])
    second = [angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m] for m in spans]
    return np.array([np.mean(d**2) / (2 * (m * dt_s) ** 2) for d, m in zip(second, spans, strict=True)])


def fitted(rates: np.ndarray, dt_s: float) -> tuple[float, float]:
    """Noise density and random walk by a weighted fit of N^2 / tau + K^2 tau / 3."""
    spans = np.unique(np.geomspace(1, 400, 24).astype(int))
    variance, tau = allan_variance(rates, dt_s, spans), spans * dt_s
    terms = np.stack([1 / tau, tau / 3], axis=1)
    # a span of m samples has n / m independent ones, so each term's relative error grows as the root of m
    weight = 1 / (variance * np.sqrt(spans))
    squares, _ = nnls(terms * weight[:, None], variance * weight)
    return float(np.sqrt(squares[0])), float(np.sqrt(squares[1]))


def test_allan_deviation_of_a_rest_log_is_what_the_settings_say():
    noise = ImuNoise(update_rate=10)
    log, dt_s = log_of(at_rest(8.0), noise), 1 / noise.update_rate
    density, walk = fitted(log.gyro_rad_s, dt_s)
    assert density == pytest.approx(noise.gyroscope_noise_density, rel=0.1)
    assert walk == pytest.approx(noise.gyroscope_random_walk, rel=0.1)
    density, walk = fitted(log.acceleration_m_s2, dt_s)
    assert density == pytest.approx(noise.accelerometer_noise_density, rel=0.1)
    assert walk == pytest.approx(noise.accelerometer_random_walk, rel=0.1)


def test_a_bias_of_80_mg_turns_gravity_by_almost_five_degrees():
    noise = NO_IMU_NOISE.model_copy(update={"accelerometer_bias_m_s2": 0.08 * GRAVITY_M_S2})
    exact, biased = (log_of(at_rest(0.01), n).acceleration_m_s2.mean(axis=0) for n in (NO_IMU_NOISE, noise))
    devices = [log_of(at_rest(0.01), noise, seed).acceleration_m_s2[0] - exact for seed in range(60)]
    assert np.std(devices) == pytest.approx(0.08 * GRAVITY_M_S2, rel=0.15)
    assert np.degrees(np.arctan(0.08)) == pytest.approx(4.57, abs=0.01)
    assert np.linalg.norm(biased - exact) > 0


def test_readings_stop_at_their_range_and_come_in_steps():
    truth = moved(stages=[{"to_mm": 20, "roll_to_deg": 90}], turn_speed_deg_s=90)
    limits = {"gyroscope_range_deg_s": 60.0, "gyroscope_step_deg_s": 0.5, "accelerometer_step_mg": 5.0}
    exact, log = log_of(truth, NO_IMU_NOISE), log_of(truth, NO_IMU_NOISE.model_copy(update=limits))
    gyro_deg_s = np.degrees(log.gyro_rad_s)
    assert np.degrees(exact.gyro_rad_s).max() > 85
    assert np.abs(gyro_deg_s).max() == pytest.approx(60.0)
    np.testing.assert_allclose(gyro_deg_s, 0.5 * np.round(gyro_deg_s / 0.5), atol=1e-9)
    milli_g = 1e3 * log.acceleration_m_s2 / GRAVITY_M_S2
    np.testing.assert_allclose(milli_g, 5 * np.round(milli_g / 5), atol=1e-6)
    assert np.abs(log.acceleration_m_s2 - exact.acceleration_m_s2).max() <= 2.5e-3 * GRAVITY_M_S2 + 1e-9


def test_leaning_axes_and_wrong_scales_mix_the_readings():
    errors = {"accelerometer_misalignment_deg": 1.0, "accelerometer_scale_error_pct": 0.5}
    noise = NO_IMU_NOISE.model_copy(update=errors)
    exact = log_of(at_rest(0.01), NO_IMU_NOISE).acceleration_m_s2[0]
    off = np.array([log_of(at_rest(0.01), noise, seed).acceleration_m_s2[0] - exact for seed in range(100)])
    along = np.argmax(np.abs(exact))
    assert off[:, along].std() == pytest.approx(0.005 * GRAVITY_M_S2, rel=0.2)
    across = np.delete(off, along, axis=1)
    assert across.std() == pytest.approx(np.radians(1.0) * GRAVITY_M_S2, rel=0.2)


def angle_deg(log, truth: Truth) -> np.ndarray:
    """Angle between the device's attitude and the true one, and how far it is off level alone."""
    time_s = log.stamp_ns / 1e9
    R_true = world_from_pipe(truth) @ truth.pose_at(time_s)[:, :3, :3] @ MOUNT.R_camera_imu
    error = rotation_from_wxyz(log.q_world_imu_wxyz) @ np.swapaxes(R_true, -1, -2)
    whole = np.degrees(np.arccos(np.clip((np.trace(error, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    level = np.degrees(np.arccos(np.clip(error[:, 2, 2], -1, 1)))
    return np.stack([whole, level])


def test_the_device_s_own_filter_follows_a_roll_and_keeps_level():
    truth = moved(stages=[{"to_mm": 300, "roll_to_deg": 40}, {"to_mm": 500}])
    exact = NO_IMU_NOISE.model_copy(update={"fusion": Fusion()})
    # a change of speed looks like a tilt for as long as it lasts, which the filter follows by its gain
    ramp_deg = np.degrees(Fusion().gravity_gain_per_s * 0.05 / GRAVITY_M_S2)
    assert angle_deg(log_of(truth, exact), truth).max() < 1.5 * ramp_deg
    noisy = ImuNoise(fusion=Fusion())
    whole, level = angle_deg(log_of(truth, noisy), truth)
    assert level.max() < 0.6
    assert whole[-1] > level[-1]  # nothing holds its heading


def test_a_biased_accelerometer_pulls_the_device_s_level_with_it():
    tilted = ImuNoise(accelerometer_bias_m_s2=0.4, fusion=Fusion())
    _, level = angle_deg(log_of(at_rest(0.02), tilted), at_rest(0.02))
    bias = log_of(at_rest(0.02), tilted).acceleration_m_s2.mean(axis=0)
    up = MOUNT.R_camera_imu.T @ [0, -1.0, 0]
    leaning = np.degrees(np.arccos(bias @ up / np.linalg.norm(bias)))
    assert level[-1] == pytest.approx(leaning, abs=0.1)


def test_a_magnetometer_holds_the_heading_until_something_disturbs_it():
    truth = at_rest(0.1)
    drifting = {"gyroscope_bias_deg_s": 0.1, "gyroscope_noise_density": 0.0}

    def heading_deg(magnetometer: Magnetometer | None) -> float:
        noise = NO_IMU_NOISE.model_copy(update={**drifting, "fusion": Fusion(magnetometer=magnetometer)})
        return float(angle_deg(log_of(truth, noise), truth)[0].max())

    alone, held = heading_deg(None), heading_deg(Magnetometer())
    disturbed = heading_deg(Magnetometer(hard_iron=0.3))
    assert alone > 5
    # a filter without an integral of it lags by the drift over its gain, which the field's level part is squared in
    lag_deg = 0.1 / (Fusion().north_gain_per_s * np.cos(NORTH_DIP_RAD) ** 2)
    assert held < 1.1 * lag_deg
    assert disturbed > held + 2


def test_what_shakes_as_fast_as_it_is_read_passes_for_a_steady_force_unless_averaged():
    time_s = np.arange(2001) / 1e3
    shaking = np.zeros((time_s.size, 3))
    shaking[:, 2] = 2000 * np.cos(2 * np.pi * 100 * time_s)  # mm/s2, at the rate of the readings
    still = np.zeros_like(shaking)
    truth = replace(
        from_path(PIPE, time_s, still, np.tile([1.0, 0, 0, 0], (time_s.size, 1)), still), acceleration_mm_s2=shaking
    )
    for share, felt in ((0.0, 2.0), (1.0, 0.0)):
        log = log_of(truth, NO_IMU_NOISE.model_copy(update={"averaged_share": share}))
        force = log.acceleration_m_s2 @ MOUNT.R_camera_imu.T
        assert force[1:, 2] == pytest.approx(felt, abs=1e-3)
        assert force[1:, 1] == pytest.approx(-GRAVITY_M_S2, abs=1e-6)
