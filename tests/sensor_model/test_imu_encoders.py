"""IMU and encoders: exact when their noise is off, and as noisy as their settings say."""

from __future__ import annotations

import numpy as np
import pytest

from sensor_model.encoders import EncoderNoise, measure_encoders
from sensor_model.geometry import GRAVITY_M_S2, rotation_from_wxyz, twist_about_z_rad
from sensor_model.imu import NO_IMU_NOISE, ImuNoise, measure_imu, world_from_pipe
from sensor_model.rig import preset_rig
from sensor_model.streams import stream
from twin.drives.gantry import GantryDrive, drive
from twin.pipe import Pipe
from twin.robot import Robot


def _truth(**settings):
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, end_mm=4000, inclination_deg=settings.pop("slope", 0.0))
    return drive(pipe, Robot(), GantryDrive(**settings), np.random.default_rng(0))


def _imu(truth, noise):
    return measure_imu(truth, preset_rig().imu, noise, stream(0, "imu"), stream(0, "attitude"))


def test_an_imu_at_constant_speed_feels_gravity_upwards():
    truth = _truth(stages=[{"to_mm": 100}], slope=30.0)
    log = _imu(truth, NO_IMU_NOISE)
    up = np.array([0.0, -np.cos(np.radians(30)), -np.sin(np.radians(30))]) * GRAVITY_M_S2
    middle = log.acceleration_m_s2.shape[0] // 2  # at constant speed
    assert np.allclose(log.acceleration_m_s2[middle] @ preset_rig().imu.R_camera_imu.T, up, atol=1e-3)


def test_the_gyro_integrates_to_the_roll_and_the_attitude_agrees():
    truth = _truth(stages=[{"to_mm": 50, "roll_to_deg": 40}], tilt_deg=(2, -1))
    log = _imu(truth, NO_IMU_NOISE)
    rate_camera = log.gyro_rad_s @ preset_rig().imu.R_camera_imu.T
    axis = truth.pose_at(np.zeros(1))[0, 2, :3]  # the pipe's axis in camera coordinates, about which it turns
    turned = np.sum(rate_camera @ axis) / 100.0
    assert np.degrees(turned) == pytest.approx(40, abs=0.05)
    R_pipe_camera = (
        world_from_pipe(truth).T @ rotation_from_wxyz(log.q_world_imu_wxyz) @ preset_rig().imu.R_camera_imu.T
    )
    roll = twist_about_z_rad(R_pipe_camera)
    assert np.degrees(roll[-1] - roll[0]) == pytest.approx(40, abs=1e-6)


def test_noise_has_the_stated_size():
    truth = _truth(stages=[{"to_mm": 3000}])
    noise = NO_IMU_NOISE.model_copy(update={"gyroscope_noise_density": 1e-3, "accelerometer_noise_density": 2e-3})
    exact, log = _imu(truth, NO_IMU_NOISE), _imu(truth, noise)
    assert (log.gyro_rad_s - exact.gyro_rad_s).std() == pytest.approx(1e-2, rel=0.03)  # density * sqrt(100 Hz)
    assert (log.acceleration_m_s2 - exact.acceleration_m_s2).std() == pytest.approx(2e-2, rel=0.03)


def test_quaternion_rounding_costs_about_half_a_degree():
    truth = _truth(stages=[{"to_mm": 500, "roll_to_deg": 90}])
    exact = rotation_from_wxyz(_imu(truth, NO_IMU_NOISE).q_world_imu_wxyz)
    q = _imu(truth, NO_IMU_NOISE.model_copy(update={"quaternion_rounding": 0.01})).q_world_imu_wxyz
    assert np.allclose(q, np.round(q, 2))
    error = rotation_from_wxyz(q) @ np.swapaxes(exact, -1, -2)
    angle = np.degrees(np.arccos(np.clip((np.trace(error, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert 0.2 < np.sqrt(np.mean(angle**2)) < 1.0


def test_sources_of_noise_do_not_disturb_each_other():
    truth = _truth(stages=[{"to_mm": 100}])
    loud = _imu(truth, ImuNoise(gyroscope_noise_density=1.0))
    quiet = _imu(truth, ImuNoise())
    assert np.array_equal(loud.q_world_imu_wxyz, quiet.q_world_imu_wxyz)


def test_encoders_count_the_travel_of_a_wheel_that_is_larger_than_believed():
    truth = _truth(stages=[{"to_mm": 1000}])
    log = measure_encoders(truth, preset_rig().wheels, EncoderNoise(wheel_diameter_error_pct=(0.0, 1.0, -1.0)))
    travel = log.counts[-1] / 16884 * np.pi * 38
    assert travel == pytest.approx([1000, 1000 / 1.01, 1000 / 0.99], abs=0.02)
    with pytest.raises(ValueError, match="3 encoder wheels"):
        measure_encoders(truth, preset_rig().wheels, EncoderNoise(wheel_diameter_error_pct=(0.0,)))
