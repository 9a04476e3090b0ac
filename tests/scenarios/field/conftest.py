"""A short log without pictures, as a robot would have written it."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenarios.load import load_scenario
from scenarios.scenario import nominal_pipe, nominal_rig
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate

CHANGES = (
    "sensing.fidelity=points",
    "sensing.frame_rate_hz=10",
    "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]",
    "drive.stages=[{to_mm: 120}]",
)


def write_log(folder: Path, *changes: str) -> Path:
    """The recording of a short scenario."""
    scenario = load_scenario("paper-gantry", [*CHANGES, *changes])
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    true_rig = scenario.true_rig or scenario.rig
    list(sense(truth, true_rig, nominal_rig(scenario), nominal_pipe(scenario), scenario.sensing, scenario.seed, folder))
    return folder


@pytest.fixture(scope="session")
def small_log(tmp_path_factory) -> Path:
    """One pocket on a short path, with the default noise."""
    return write_log(tmp_path_factory.mktemp("log") / "recording")
