"""A log's health: a sound one is good, and faults put into it are named; `campaigns/faults.py` has all kinds."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from scenarios.field.health_imu import imu_findings
from sensor_model.recording import open_recording

SAMPLE = (
    "clock jumps back",
    "stamps in microseconds",
    "camera frozen",
    "encoder overflow of 32 bits",
    "an encoder dies halfway",
    "all wheels reversed",
    "all wheels 5 % off",
    "pipe told 4 % too wide",
    "rig: apex 2 mm off",
)


@pytest.fixture(scope="module")
def faults(campaign):
    return campaign("faults")


@pytest.fixture(scope="module")
def sound(faults, tmp_path_factory):
    """A sound log and its replay."""
    folder = tmp_path_factory.mktemp("sound")
    log = faults.write_base(folder / "log", 0, pictures=False)
    return log, faults.replayed(log, folder / "work")


def test_a_sound_log_is_good_and_its_figures_are_those_of_the_twin(sound):
    _, replay = sound
    assert [one for one in replay.health.findings if one.verdict != "good"] == []
    assert replay.health.figures["cam0_rate_hz"] == pytest.approx(10, abs=0.01)
    assert replay.health.figures["rings_apart_mm"] < 0.05


@pytest.mark.parametrize("kind", SAMPLE)
def test_a_fault_is_named(kind, faults, sound, tmp_path):
    log, replay = sound
    shutil.copytree(log, tmp_path / "log")
    faults.FAULTS[kind].do(tmp_path / "log", np.random.default_rng(0))
    what, words = faults.outcome(faults.FAULTS[kind], tmp_path / "log", replay, tmp_path / "work")
    assert what in ("named", "refused"), words


def test_the_gyroscope_is_held_against_the_attitude(faults, sound, tmp_path):
    """A device that turns at 0.3 rad/s and says so, in degrees, and with two axes swapped."""
    log = tmp_path / "log"
    shutil.copytree(sound[0], log)
    recording = open_recording(log)
    seconds = (recording.imu_stamps_ns - recording.imu_stamps_ns[0]) / 1e9
    half = 0.15 * seconds
    faults.numbers(log, "orientation0", lambda *_: np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1))
    for rates, verdict in (((0, 0, 0.3), "good"), ((0, 0, 17.2), "bad"), ((0.3, 0, 0), "bad")):
        felt = np.tile([*rates, 0, 0, 9.81], (seconds.size, 1))
        faults.numbers(log, "imu0", lambda *_, felt=felt: felt)
        gyroscope = next(one for one in imu_findings(open_recording(log)) if one.name == "gyroscope")
        assert gyroscope.verdict == verdict, gyroscope
