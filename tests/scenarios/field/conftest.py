"""Logs and run folders as a robot's would be: short logs, another robot's bag, and runs without any truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from algorithms.reconstruct import reconstruct
from algorithms.types import Episode
from scenarios.artefacts import write_reconstruction
from scenarios.field import ros
from scenarios.load import load_scenario
from scenarios.scenario import nominal_pipe, nominal_rig
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate

CHANGES = (
    "sensing.fidelity=points",
    "sensing.frame_rate_hz=10",
    "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]",
    "drive.stages=[{to_mm: 120}]",
)
WITH_PICTURES = ("sensing.fidelity=raycast", "drive.stages=[{to_mm: 8}]")


def _write_log(folder: Path, *changes: str) -> Path:
    scenario = load_scenario("paper-gantry", [*CHANGES, *changes])
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    true_rig = scenario.true_rig or scenario.rig
    list(sense(truth, true_rig, nominal_rig(scenario), nominal_pipe(scenario), scenario.sensing, scenario.seed, folder))
    return folder


@pytest.fixture(scope="session")
def scenario():
    """A short drive past one pocket, without pictures."""
    return load_scenario("paper-gantry", list(CHANGES))


@pytest.fixture(scope="session")
def small_log(tmp_path_factory) -> Path:
    """One pocket on a short path, with the default noise."""
    return _write_log(tmp_path_factory.mktemp("log") / "recording")


@pytest.fixture(scope="session")
def picture_log(tmp_path_factory) -> Path:
    """A few pictures."""
    return _write_log(tmp_path_factory.mktemp("pictures") / "recording", *WITH_PICTURES)


@pytest.fixture(scope="session")
def foreign_bag(picture_log, tmp_path_factory) -> Path:
    """The log with pictures as another robot's bag.

    It has two IMUs without attitude, another order of joints, raw pictures in BGR, and stamps of the present day.
    """
    pytest.importorskip("rosbags", reason="the package rosbags is not installed")
    from rosbags.rosbag2 import StoragePlugin, Writer

    recording, types, later = open_recording(picture_log), ros.types(), 1_780_000_000 * 10**9
    known, zeros, unknown = types.types, np.zeros(9), np.append(-1.0, np.zeros(8))
    vector, quaternion = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    folder = tmp_path_factory.mktemp("foreign") / "bag"
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as bag:

        def write(topic, stamp, kind, *content):
            message = known[kind](ros.header(int(stamp) + later, "robot"), *content)
            bag.write(topic, int(stamp) + later, types.serialize_cdr(message, kind))

        topics = ("/imu/a", ros.IMU), ("/imu/b", ros.IMU), ("/joints", ros.WHEELS), ("/camera/image", ros.IMAGE)
        imu_a, imu_b, joints, camera = (bag.add_connection(name, kind, typestore=types) for name, kind in topics)
        for stamp, row in zip(recording.imu_stamps_ns, recording.imu, strict=True):
            for topic, scale in ((imu_a, 2.0), (imu_b, 1.0)):
                rate, force = vector(*(scale * row[:3])), vector(*(scale * row[3:]))
                write(topic, stamp, ros.IMU, quaternion, unknown, rate, zeros, force, zeros)
        angles = ros.angles_rad(recording.counts, recording.rig.wheels.counts_per_turn)
        for stamp, angle in zip(recording.encoder_stamps_ns, angles, strict=True):
            names, turned = ["top", "arm", "left", "right"], np.array([angle[2], 0.5, angle[0], angle[1]])
            write(joints, stamp, ros.WHEELS, names, turned, np.zeros(0), np.zeros(0))
        for index, stamp in enumerate(recording.frame_stamps_ns):
            height, width, _ = (bgr := recording[index].picture[:, :, ::-1]).shape
            write(camera, stamp, ros.IMAGE, height, width, "bgr8", 0, 3 * width, np.ascontiguousarray(bgr).ravel())
    return folder


@pytest.fixture(scope="session")
def found_folder(small_scan, tmp_path_factory):
    """A run's folder without truth, score, recording or pictures, with a joint upstream of its pocket."""
    folder = tmp_path_factory.mktemp("field") / "run"
    tie = Episode("joint", "joint at 40.5 mm", 0, 0, 0.3)
    write_reconstruction(replace(small_scan.found, episodes=(tie,)), folder / "reconstruction")
    return folder


@pytest.fixture(scope="session")
def run_of():
    """Makes a run's folder of a scenario by slit pixels: a log and what is measured from it, nothing of the truth."""

    def make(folder, *changes, name="paper-gantry", seed=0):
        scenario = load_scenario(name, ["sensing.fidelity=points", *changes], seed)
        truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(seed, "drive"))
        log, told = folder / "recording", nominal_pipe(scenario)
        list(sense(truth, scenario.true_rig or scenario.rig, scenario.rig, told, scenario.sensing, seed, log))
        recording = open_recording(log)
        frames = (recording[k] for k in range(len(recording)))
        found = reconstruct(frames, recording.rig, recording.pipe, scenario.method)
        write_reconstruction(found, folder / "reconstruction")
        return folder

    return make
