"""`pipetwin calibrate pipe`: a scan of clean pipe tightens what boards know, and says what it cannot see."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from algorithms.calibration.clean_pipe import calibrate_in_pipe, fit_pipe, seat_prior
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.poses_needed import off_from
from scenarios.bench.calibrated import BoardSession, calibrate
from scenarios.calibration.covariance_file import read_covariance, write_covariance
from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.run import run
from sensor_model.points import PointNoise, see_slits
from sensor_model.rig import Rig, load_settings, preset_rig, save_settings
from twin.pipe import Pipe

TRUE = {"apex_mm": (0.8, -1.2, -53.6), "axis": (0.012, -0.015, 1.0)}
BASE = preset_rig()
RIG = BASE.model_copy(update={"projector": BASE.projector.model_copy(update=TRUE)})
QUICK = BoardSession(boards=6, board_distance_std_mm=0.1, board_tilt_std_deg=0.1, points=PointNoise(azimuths=180))
PITS = [
    {"kind": "pit", "distance_mm": 170 + 20 * k, "clock_deg": 60 * k, "diameter_mm": 18, "depth_mm": 4}
    for k in range(6)
]


@pytest.fixture(scope="module")
def boards():
    return calibrate(RIG, 3, QUICK)


@pytest.fixture(scope="module")
def frames():
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, start_mm=-400, end_mm=900, features=PITS)
    rng, poses = np.random.default_rng(1), np.tile(np.eye(4), (20, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("xy", rng.normal(0, 1, (20, 2)), degrees=True).as_matrix()
    poses[:, :3, 3] = np.column_stack([rng.normal(0, 3, (20, 2)), np.linspace(0, 300, 20)])
    return [see_slits(pipe, pose, RIG, PointNoise(azimuths=360), rng) for pose in poses]


def test_a_pipe_of_known_radius_is_a_gauge(boards, frames):
    found = calibrate_in_pipe(frames, boards.rig, boards.fit.covariance, 76.2)
    before, after = off_from(boards.rig, RIG), off_from(found.rig, RIG)
    assert found.helps
    assert after.radius_mm < before.radius_mm / 3
    assert after.half_angle_deg < before.half_angle_deg
    std = np.sqrt(np.diag(found.covariance))
    assert (std < 1.01 * boards.fit.std).all()
    assert (
        np.abs(found.rig.projector.slit_half_angles_rad - RIG.projector.slit_half_angles_rad).max() < 4 * std[5:].max()
    )


def test_with_a_free_radius_the_scale_stays_and_is_named(boards, frames):
    found = calibrate_in_pipe(frames, boards.rig, boards.fit.covariance, None)
    scale = np.array([*boards.rig.projector.apex_mm, *[0.0] * 10])
    wall = np.linalg.inv(found.covariance) - np.linalg.inv(boards.fit.covariance)
    known = scale @ np.linalg.inv(boards.fit.covariance) @ scale
    assert abs(scale @ wall @ scale) < 0.05 * known
    assert found.stayed[0].left > 0.9
    assert off_from(found.rig, RIG).half_angle_deg < off_from(boards.rig, RIG).half_angle_deg
    assert found.radius_mm == pytest.approx(76.2, abs=0.1)


def test_an_exact_rig_is_left_where_it_is(frames):
    covariance = np.diag(np.full(13, 1e-12))
    rig, _ = fit_pipe(frames, RIG, covariance, None)
    assert max(off_from(rig, RIG)[:3]) < 1e-3
    with pytest.raises(CannotCalibrate, match="at least 8"):
        calibrate_in_pipe(frames[:5], RIG, seat_prior(8), None)


def test_the_command_goes_on_from_the_boards_and_writes_what_it_knows(boards, tmp_path):
    short = ["sensing.fidelity=points", "sensing.frame_rate_hz=4", "drive.stages=[{to_mm: 200}]", "pipe.features=[]"]
    scenario = load_scenario("paper-gantry", short).model_copy(update={"true_rig": RIG})
    run(scenario, tmp_path / "run", 1, lambda *_: None)
    start, true, out = (tmp_path / name for name in ("boards.yaml", "true.yaml", "rig.yaml"))
    save_settings(boards.rig, start)
    save_settings(RIG, true)
    write_covariance(boards.rig.projector, boards.fit.covariance, start)
    words = [
        "calibrate",
        "pipe",
        str(tmp_path / "run"),
        "--rig",
        str(start),
        "--out",
        str(out),
        "--true-rig",
        str(true),
    ]
    result = CliRunner().invoke(app, [*words, "--radius-mm", "76.2", "--json"])
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert said["kept"]
    assert said["known_by"] == "the boards"
    assert said["off_true_rig"]["radius_mm"] < said["off_true_rig_before"]["radius_mm"] / 2
    rig = load_settings(Rig, out)
    assert np.sqrt(read_covariance(rig.projector, out)[2, 2]) * 1.96 == pytest.approx(said["interval_95"]["apex_z_mm"])
    assert (tmp_path / "rig-pipe.html").read_text().count("<img") == 1
    save_settings(BASE, start)  # the covariance beside it is of another projector
    result = CliRunner().invoke(app, words)
    assert isinstance(result.exception, BadInput)
    assert "boards-covariance.yaml: apex_mm: got" in result.exception.lines[0]
