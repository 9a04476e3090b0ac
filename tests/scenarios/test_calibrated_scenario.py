"""A scenario whose nominal rig comes out of a calibration: its error is real, repeatable, and said in the run."""

from __future__ import annotations

import json

import numpy as np
import pytest

from scenarios.document import BadInput, parse
from scenarios.load import load_scenario, to_scenario
from scenarios.run import run
from scenarios.scenario import nominal_rig
from scenarios.settings_yaml import settings_yaml
from sensor_model.rig import Rig, load_settings, preset_rig

SESSION = "calibration={boards: 6, board_distance_std_mm: 0.1, board_tilt_std_deg: 0.1, points: {azimuths: 90}}"
EXACT = "{board_distance_std_mm: 0, board_tilt_std_deg: 0, points: {azimuths: 90, pixel_noise_px: 0}}"


def _worst_deg(one: Rig, other: Rig) -> float:
    return float(np.degrees(np.abs(one.projector.slit_half_angles_rad - other.projector.slit_half_angles_rad).max()))


def test_the_calibration_is_of_the_true_rig_and_goes_by_the_seed():
    changes = [SESSION, "true_rig.projector.apex_mm=[0.4, 0, -53.5]"]
    scenario = load_scenario("paper-gantry", changes)
    found = nominal_rig(scenario)
    assert found.projector.apex_mm == pytest.approx((0.4, 0, -53.5), abs=0.3)
    assert 1e-4 < _worst_deg(found, preset_rig()) < 0.1
    assert nominal_rig(to_scenario(parse(settings_yaml(scenario), "again.yaml"))) == found
    assert nominal_rig(load_scenario("paper-gantry", [*changes, "seed=1"])) != found


def test_its_error_falls_with_boards_and_goes_with_their_noise():
    def error_deg(session: str, seed: int) -> float:
        scenario = load_scenario("paper-gantry", [session, f"seed={seed}"])
        return _worst_deg(nominal_rig(scenario), preset_rig())

    few, many = (
        np.mean([error_deg(SESSION.replace("boards: 6", f"boards: {boards}"), seed) for seed in range(6)])
        for boards in (4, 40)
    )
    assert many < 0.6 * few
    assert error_deg(f"calibration={EXACT}", 0) < 1e-8


def test_a_run_is_measured_with_it_and_says_so(tmp_path):
    short = ["sensing.fidelity=points", "sensing.frame_rate_hz=5", "drive.stages=[{to_mm: 40}]", "pipe.features=[]"]
    scenario = load_scenario("paper-gantry", [*short, SESSION])
    run(scenario, tmp_path / "run", 1, lambda *_: None)
    assert load_settings(Rig, tmp_path / "run" / "recording" / "rig.yaml") == nominal_rig(scenario) != preset_rig()
    assert "calibrated on 6 boards in closed loop: apex off by" in (tmp_path / "run" / "report.html").read_text()
    assert json.loads((tmp_path / "run" / "run.json").read_text())["nominal_rig"] == "calibrated on 6 boards"


def test_a_session_s_faults_are_named():
    with pytest.raises(BadInput) as fault:
        load_scenario("paper-gantry", ["calibration={boards: 2, corners: 4}"])
    assert "calibration.boards" in str(fault.value)
    assert "corners" in str(fault.value)
