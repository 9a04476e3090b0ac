"""The page that plays a run: what it shows is where things are, and it needs nothing but itself."""

from __future__ import annotations

import json
import re
from base64 import b64decode

import numpy as np
import pytest
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.view.drive import hub_places_mm, playback, read_run
from scenarios.view.page import write_view
from sensor_model.streams import stream
from twin.drives.robot import simulate_motion, truth_of
from twin.robot_model import MM, WHEEL_HUB, wheel_names
from twin.simulate import simulate
from twin.truth import save_truth

CHANGES = [
    "sensing.fidelity=points",
    "drive.start_mm=200",
    "drive.via=[]",
    "drive.end_mm=260",
    "pipe.joints=[{distance_mm: 400, gap_depth_mm: 1}]",
]
NOTHING = np.zeros((0, 3)), np.zeros(0)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("paper-imu-8", [*CHANGES, "drive.roll_to=[{start_s: 0.2, to_deg: 5}]"], 0)


@pytest.fixture(scope="module")
def motion(scenario):
    return simulate_motion(scenario.pipe, scenario.robot, scenario.drive, stream(0, "drive"))


@pytest.fixture(scope="module")
def truth(scenario, motion):
    return truth_of(scenario.pipe, scenario.robot, motion)


def test_wheels_are_drawn_where_they_are(scenario, motion, truth):
    drawn = hub_places_mm(scenario.pipe, scenario.robot, truth.pose_at(truth.time_s))
    for w, name in enumerate(wheel_names(scenario.robot)):
        true_mm = motion.readout(WHEEL_HUB.format(name)) / MM
        assert np.linalg.norm(drawn[:, w] - true_mm, axis=1).max() < 0.3


def test_light_falls_on_the_wall(scenario, truth):
    drive = playback(scenario, truth, *NOTHING)
    at = drive.time_s.size // 2
    T = drive.T_pipe_camera[at]
    places = (drive.apex_camera_mm + drive.light_mm[at][..., None] * drive.rays_camera) @ T[:3, :3].T + T[:3, 3]
    radius = scenario.pipe.radius(np.arctan2(places[..., 0], -places[..., 1]), places[..., 2])
    np.testing.assert_allclose(np.hypot(places[..., 0], places[..., 1]), radius, atol=1e-3)
    assert drive.roll_deg[-1] == pytest.approx(5, abs=0.1)


def run_of(scenario, truth, folder):
    from scenarios.settings_yaml import settings_yaml

    folder.mkdir()
    (folder / "scenario.yaml").write_text(settings_yaml(scenario))
    save_truth(truth, folder / "truth")
    return folder


def test_the_page_plays_the_drive_and_needs_nothing_else(scenario, truth, tmp_path):
    folder = run_of(scenario, truth, tmp_path / "run")
    result = CliRunner().invoke(app, ["view", str(folder)])
    assert result.exit_code == 0, result.output
    page = (folder / "view.html").read_text()
    assert not re.search(r"""(src|href)=["'](?!data:|#)|https?://|url\(""", page)
    data = json.loads(re.search(r'<script type="application/json" id="drive">(.*?)</script>', page)[1])
    frames = len(data["time"])
    pose = np.frombuffer(b64decode(data["pose"]), "<f4").reshape(frames, 3, 4)
    np.testing.assert_allclose(pose[-1], truth.pose_at(truth.time_s[-1:])[0, :3], atol=1e-3)
    slip = np.frombuffer(b64decode(data["slip"]), "<f4").reshape(frames, data["wheels"])
    travelled = slip[:, :6].mean() * truth.time_s[-1]
    assert travelled == pytest.approx(truth.wheels.slip_mm_s[:, :6].mean() * truth.time_s[-1], abs=0.05)
    again = tmp_path / "again.html"
    write_view(read_run(folder), again)
    assert again.read_text() == page
    assert len(page) < 1_000_000


def test_a_drive_without_a_robot_is_played_too(tmp_path):
    gantry = load_scenario("paper-gantry", ["drive.stages=[{to_mm: 100}]"], 0)
    truth = simulate(gantry.pipe, gantry.robot, gantry.drive, stream(0, "drive"))
    page = tmp_path / "gantry.html"
    write_view(read_run(run_of(gantry, truth, tmp_path / "run")), page)
    assert '"wheels":0' in page.read_text()


def test_a_folder_that_is_no_run_is_refused(tmp_path, scenario, truth):
    with pytest.raises(BadInput, match=r"scenario\.yaml is missing; `pipetwin run` makes such a folder"):
        read_run(tmp_path)
    folder = run_of(scenario, truth, tmp_path / "run")
    (folder / "truth" / "truth.npz").write_bytes(b"nothing")
    with pytest.raises(BadInput, match=r"truth\.npz: cannot be read: File is not a zip file"):
        read_run(folder)


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("time_s", np.zeros(4), "time_s: must be at least 2 finite numbers, each beyond the last"),
        ("position_mm", np.zeros((4, 2)), r"position_mm: got shape \(4, 2\); \(\d+, 3\) goes with time_s"),
        ("slip_mm_s", np.zeros(3, dtype=bool), "slip_mm_s: got bool; numbers are expected"),
    ],
)
def test_a_truth_that_cannot_be_is_refused(name, values, said, scenario, truth, tmp_path):
    folder = run_of(scenario, truth, tmp_path / "run")
    with np.load(folder / "truth" / "truth.npz") as held:
        arrays = dict(held)
    np.savez(folder / "truth" / "truth.npz", **{**arrays, name: values})
    with pytest.raises(BadInput, match=said):
        read_run(folder)
