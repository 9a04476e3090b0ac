"""`pipetwin decode` and `calibrate pipe` on drawn pictures, where the truth is known."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.raycast import draw
from sensor_model.rig import Rig, load_settings, preset_rig, save_settings
from twin.pipe import Pipe

PIPE = Pipe(inner_radius_mm=71.0, wall_thickness_mm=7.5)
PLACES = [(8.0, -5.0), (-10.0, 4.0), (2.0, 9.0)]
TILT = (0.012, -0.008, 1.0)
ROUGH = Optics(slide_jag_deg=0.25)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Frames of a sensor whose axis is tilted and whose slide is rough."""
    folder, base = tmp_path_factory.mktemp("frames"), preset_rig()
    rig = base.model_copy(update={"projector": base.projector.model_copy(update={"axis": TILT})})
    for k, place in enumerate(PLACES):
        pose = np.eye(4)
        pose[:2, 3] = place
        picture = expose(draw(PIPE, pose, rig, ROUGH), ROUGH, np.random.default_rng(k), rig.camera)
        Image.fromarray(picture).save(folder / f"{k}.png", compress_level=1)
    save_settings(rig, folder / "true.yaml")
    return folder


def _json(*words):
    result = CliRunner().invoke(app, [*map(str, words), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_a_picture_is_measured_and_looks_like_its_twin(pictures, tmp_path):
    said = _json(
        "decode", pictures / "0.png", "--rig", pictures / "true.yaml", "-o", tmp_path / "out", "--twin", "plain"
    )
    assert said["inner_diameter_mm"] == pytest.approx(142.0, abs=0.2)
    assert said["center_mm"] == pytest.approx([-8.0, 5.0], abs=0.3)
    assert said["tilt_deg"] < 0.3
    assert said["coverage_inner"] > 0.97
    assert said["coverage_outer"] > 0.97
    assert said["off_the_wall_share"] < 0.005
    assert said["residual_corrected_mm"] is None
    for name, value in said["look"].items():
        if not name.startswith("jitter"):  # the twin's own print is the smoother default
            assert said["look_twin"][name] == pytest.approx(value, rel=0.2), name
    assert (tmp_path / "out" / "cloud.ply").read_bytes().startswith(b"ply\nformat binary_little_endian")
    with Image.open(tmp_path / "out" / "overlay.png") as overlay:
        assert overlay.size == (1664, 1232)
    assert (tmp_path / "out" / "decode.html").read_text().count("<img") == 3


def test_an_unknown_look_is_said(pictures, tmp_path):
    result = CliRunner().invoke(app, ["decode", str(pictures / "0.png"), "--twin", "shiny", "-o", str(tmp_path / "o")])
    assert isinstance(result.exception, BadInput)
    assert "no look is called 'shiny'; there are endoscope" in str(result.exception)


def test_seat_and_slide_are_learned_from_clean_pipe(pictures, tmp_path):
    out = tmp_path / "rig.yaml"
    said = _json("calibrate", "pipe", *(pictures / f"{k}.png" for k in (0, 1)), "--rig", "endoscope", "--out", out)
    learned = load_settings(Rig, out)
    axis = np.array(learned.projector.axis) / np.linalg.norm(learned.projector.axis)
    assert np.degrees(np.linalg.norm(np.cross(axis, np.array(TILT) / np.linalg.norm(TILT)))) < 0.15
    diameters = [row["diameter_mm"] for row in said["pictures"].values()]
    assert np.ptp(diameters) < 0.005 * np.mean(diameters)
    assert said["correction_kept"]
    # and on a picture that had no part in it
    third = _json("decode", pictures / "2.png", "--rig", out, "-o", tmp_path / "third")
    assert third["residual_corrected_mm"] < 0.8 * third["residual_mm"]
