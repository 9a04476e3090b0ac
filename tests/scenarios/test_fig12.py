"""Fig. 12 again: a commanded roll comes out without the IMU, and is undone with it."""

from __future__ import annotations

import json

import numpy as np
import pytest

import scenarios.paper.fig12 as fig12
from algorithms.localisation import ESTIMATORS
from scenarios.load import load_scenario
from sensor_model.geometry import rotation_from_wxyz, twist_about_z_rad
from sensor_model.streams import stream
from twin.simulate import simulate

COARSE = ("sensing.frame_rate_hz=7.5", "drive.start_mm=130", "drive.end_mm=470", "drive.roll_to.0.start_s=3.6")


def silent(*args) -> None:
    """No progress to show."""


@pytest.mark.parametrize("angle_deg", [8, 25])
def test_the_scenarios_turn_by_what_their_name_says(angle_deg):
    """Between the defects, and no further away than a tenth of a degree."""
    changes = ["drive.end_mm=330", "drive.start_mm=230", "drive.roll_to.0.start_s=1.6"]
    scenario = load_scenario(f"paper-imu-{angle_deg}", changes, 1)
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(1, "drive"))
    roll = np.degrees(twist_about_z_rad(rotation_from_wxyz(truth.q_pipe_camera_wxyz)))
    assert roll[-1] == pytest.approx(angle_deg, abs=0.1)
    assert abs(roll[(truth.time_s > 1.0) & (truth.time_s < 1.6)]).max() < 0.1  # it may be launched a little rolled


def test_the_table_has_the_paper_s_figures_and_every_estimator(tmp_path, monkeypatch):
    monkeypatch.setattr(fig12, "ESTIMATORS", {name: ESTIMATORS[name] for name in ("paper", "fused")})
    rows = fig12.run_fig12("points", 0, tmp_path / "fig12", 1, silent, COARSE)
    assert json.loads((tmp_path / "fig12" / "fig12.json").read_text()) == rows
    assert [row["angle_25_deg"] for row in rows[:2]] == [3.3, 25.0]
    found = {(row["estimator"], row["imu"]): row for row in rows[2:]}
    assert set(found) == {
        (name, imu) for name in ("paper", "fused") for imu in (fig12.WITH, fig12.WITHOUT, fig12.COARSE)
    }
    for name in ("paper", "fused"):
        without = found[name, fig12.WITHOUT]
        assert without["angle_8_deg"] == pytest.approx(8, abs=1)
        assert without["angle_25_deg"] == pytest.approx(25, abs=1)
    for key in fig12.SCENARIOS:
        assert found["fused", fig12.WITH][key] <= fig12.TARGET_DEG
    assert "holds" in fig12.words(rows)


def test_robots_come_by_size_and_a_wrong_name_says_which_there_are(tmp_path):
    from scenarios.document import BadInput

    small = load_scenario("paper-robot", ["robot=4-inch", "rig.wheels.diameters_mm=[24, 24, 24]"], 0)
    assert small.robot.bore_radius_mm == 51.1
    with pytest.raises(BadInput, match="no robot is called '5-inch'; there are 4-inch, 6-inch, 8-inch"):
        load_scenario("paper-robot", ["robot=5-inch"], 0)
