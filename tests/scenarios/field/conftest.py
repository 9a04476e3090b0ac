"""Run folders as a robot's would be: a reconstruction, and nothing of the truth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from algorithms.reconstruct import reconstruct
from algorithms.types import Episode
from scenarios.artefacts import write_reconstruction
from scenarios.load import load_scenario
from scenarios.scenario import nominal_pipe
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate


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
