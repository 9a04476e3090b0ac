"""`pipetwin calibrate draw` and `projector`: the twin's own board pictures give back the rig that drew them."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from algorithms.calibration.poses_needed import LIMITS
from scenarios.calibration.covariance_file import covariance_file
from scenarios.calibration.rig_file import read_rig
from scenarios.cli import app
from scenarios.document import BadInput
from sensor_model.rig import preset_rig, save_settings


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder, rig = tmp_path_factory.mktemp("boards"), preset_rig()
    moved = rig.projector.model_copy(update={"apex_mm": (0.8, -1.2, -53.6), "axis": (0.012, -0.015, 1.0)})
    save_settings(rig.model_copy(update={"projector": moved}), folder / "true.yaml")
    _run("draw", folder / "drawn", "--board", "markers", "--rig", folder / "true.yaml", "--poses", 3, "--seed", 1)
    return folder / "drawn"


def _run(*words):
    return CliRunner().invoke(app, ["calibrate", *map(str, words)])


def test_drawn_boards_give_the_rig_that_drew_them(drawn, tmp_path):
    out, true = tmp_path / "rig.yaml", drawn / "rig.yaml"
    result = _run("projector", drawn, "--camera", true, "--true-rig", true, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert said["pairs_used"] == 3
    off = said["off_true_rig"]
    assert off["half_angle_deg"] < LIMITS.half_angle_deg
    assert off["axis_deg"] < LIMITS.axis_deg
    assert off["radius_mm"] < LIMITS.radius_mm
    assert said["poses"]["is"] == "error against the true rig"
    assert read_rig(str(out)).projector.apex_mm == tuple(said["apex_mm"])
    assert covariance_file(out).is_file()
    assert (tmp_path / "rig-projector.html").read_text().count("<img") >= 1


def test_too_few_pairs_and_a_picture_without_a_board_are_named(drawn, tmp_path):
    for name in ("Cam01.png", "Proj01.png", "Proj02.png"):
        (tmp_path / name).write_bytes((drawn / name).read_bytes())
    (tmp_path / "Cam02.png").write_bytes((drawn / "Proj02.png").read_bytes()[:50_000])
    (tmp_path / "Cam03.png").write_bytes((drawn / "Cam03.png").read_bytes())
    result = _run("projector", tmp_path, "--camera", drawn / "rig.yaml", "--out", tmp_path / "rig.yaml")
    assert isinstance(result.exception, BadInput)
    said = "\n".join(result.exception.lines)
    assert "1 of 2 pairs can be used; at least 3 are needed" in said
    assert "Cam02.png: is no picture that can be read whole" in said
    assert not (tmp_path / "rig.yaml").exists()
