"""A scan without pictures, report or run folder: from a scenario and changes to truth, reconstruction and score."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from algorithms.reconstruct import begin, finish, see, step
from algorithms.types import Reconstruction
from scenarios.load import load_scenario
from scenarios.scenario import nominal_pipe, nominal_rig
from scenarios.score import FrameTally, Score, score, tally_frame
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate
from twin.truth import Truth


class Scan(NamedTuple):
    """What one scan leaves."""

    truth: Truth
    found: Reconstruction
    tally: FrameTally
    score: Score


def _scan(folder, name: str, *changes: str) -> Scan:
    scenario = load_scenario(name, ["sensing.fidelity=points", *changes])
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    true_rig = scenario.true_rig or scenario.rig
    list(sense(truth, true_rig, nominal_rig(scenario), nominal_pipe(scenario), scenario.sensing, scenario.seed, folder))
    recording = open_recording(folder)
    state, tally = begin(recording.rig, recording.pipe, scenario.method), FrameTally(truth.pipe, true_rig)
    for frame in (recording[i] for i in range(len(recording))):
        result = step(state, frame, see(frame, recording.rig, scenario.method))
        tally_frame(tally, result, truth.pose_at(np.array([frame.stamp_ns / 1e9]))[0])
    found = finish(state)
    return Scan(truth, found, tally, score(found, truth, tally))


@pytest.fixture
def scan_of(tmp_path):
    return lambda name, *changes: _scan(tmp_path / "recording", name, *changes)


@pytest.fixture(scope="session")
def small_scan(tmp_path_factory) -> Scan:
    """One pocket on a short path, with the default noise."""
    return _scan(
        tmp_path_factory.mktemp("scan"),
        "paper-gantry",
        "sensing.frame_rate_hz=10",
        "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]",
        "drive.stages=[{to_mm: 120}]",
    )
