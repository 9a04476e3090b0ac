"""Travel and roll from encoders and IMU: exact when they are, robust against one bad wheel, honest when vertical."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.localisation.paper import PaperSettings, advance, launch, predict, settle
from algorithms.localisation.upright import level_attitude
from sensor_model.encoders import EncoderNoise, measure_encoders
from sensor_model.geometry import twist_about_z_rad, wrap_rad
from sensor_model.imu import NO_IMU_NOISE, measure_imu
from sensor_model.recording import NominalPipe, Recording
from sensor_model.rig import preset_rig
from sensor_model.streams import stream
from twin.drives.gantry import GantryDrive, drive
from twin.pipe import Pipe
from twin.robot import Robot

RIG = preset_rig()
NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)


def _recording(tmp_path, noise=NO_IMU_NOISE, wheels=(0.0, 0.0, 0.0), slope=0.0):
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, inclination_deg=slope)
    path = GantryDrive(stages=[{"to_mm": 60, "roll_to_deg": 200}, {"to_mm": 120}], tilt_deg=(2, -1.5))
    truth = drive(pipe, Robot(), path, np.random.default_rng(0))
    imu = measure_imu(truth, RIG.imu, noise, stream(0, "imu"), stream(0, "attitude"))
    encoders = measure_encoders(truth, RIG.wheels, EncoderNoise(wheel_diameter_error_pct=wheels))
    stamps = (np.arange(int(truth.time_s[-1] * 15) + 1) / 15 * 1e9).astype(np.int64)
    samples = np.hstack([imu.gyro_rad_s, imu.acceleration_m_s2])
    logs = (imu.stamp_ns, samples, imu.stamp_ns, imu.q_world_imu_wxyz, encoders.stamp_ns, encoders.counts)
    return truth, Recording(tmp_path, RIG, NOMINAL, stamps, ("",) * len(stamps), *logs)


def _walk(truth, recording, settings=PaperSettings()):  # noqa: B008  settings are frozen
    """Errors of the priors when every frame's fit is perfect: travel in mm, roll in degrees."""
    errors = []
    for i in range(len(recording)):
        frame = recording.frame(i)
        T = truth.pose_at(np.array([frame.stamp_ns / 1e9]))[0]
        odometry = (
            launch(frame, RIG, NOMINAL, T[2, :3], settings) if i == 0 else advance(odometry, frame, RIG, settings)
        )
        prior = predict(odometry)
        turn = twist_about_z_rad(prior.T_pipe_camera[:3, :3] @ T[:3, :3].T)
        errors.append((prior.T_pipe_camera[2, 3] - T[2, 3], float(np.degrees(wrap_rad(turn)))))
        odometry = settle(odometry, type(prior)(T, prior.information))
    return np.abs(errors).max(axis=0)


@pytest.mark.parametrize("slope", [0.0, 40.0, -40.0])
def test_exact_sensors_give_exact_travel_and_roll(tmp_path, slope):
    travel, roll = _walk(*_recording(tmp_path, slope=slope))
    assert travel < 0.03
    assert roll < 0.01


def test_the_median_shrugs_off_one_wrong_wheel(tmp_path):
    travel, _ = _walk(*_recording(tmp_path, wheels=(0.0, 15.0, 0.0)))
    assert travel < 0.03
    travel, _ = _walk(*_recording(tmp_path, wheels=(1.0, 1.0, 0.0)))
    assert travel == pytest.approx(120 / 101, abs=0.05)


def test_the_filter_follows_a_roll_past_half_a_turn(tmp_path):
    _, roll = _walk(*_recording(tmp_path), PaperSettings(roll="kalman"))
    assert roll < 0.1


def test_the_filter_does_not_see_a_coarse_attitude_and_learns_the_bias(tmp_path):
    coarse = NO_IMU_NOISE.model_copy(update={"quaternion_rounding": 0.01, "gyroscope_bias_deg_s": 0.2})
    truth, recording = _recording(tmp_path, coarse)
    _, device = _walk(truth, recording)
    _, filtered = _walk(truth, recording, PaperSettings(roll="kalman"))
    assert filtered < 0.3 < device


def test_level_attitude_puts_up_at_12_oclock():
    R = Rotation.from_euler("zxy", [33, 2, -1.5], degrees=True).as_matrix()
    found = level_attitude(R.T @ np.array([0, 1.0, 0]), R[2])
    assert np.allclose(found, R)


def test_in_a_vertical_pipe_the_camera_is_its_own_datum():
    axis = np.array([0.0, 0.0, 1.0])
    assert np.allclose(level_attitude(axis, axis), np.eye(3))


def test_the_prior_claims_only_travel_and_roll(tmp_path):
    truth, recording = _recording(tmp_path)
    frame = recording.frame(0)
    odometry = launch(frame, RIG, NOMINAL, truth.pose_at(np.zeros(1))[0, 2, :3], PaperSettings())
    information = predict(odometry).information
    assert np.flatnonzero(information.any(axis=0)).tolist() == [2, 5]
