"""`pipetwin calibrate camera`: files in, rig and page out, and a clear word for what cannot be used."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from sensor_model import board_pictures
from sensor_model.geometry import transform
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.rig import Rig, load_settings, preset_rig

TILTS = [(25, 0, 0), (-25, 10, 90), (0, 25, 180), (15, 15, -60), (-20, -20, 140)]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder, rig, rng = tmp_path_factory.mktemp("boards"), preset_rig(), np.random.default_rng(4)
    optics = Optics().model_copy(update={"inter_reflection": 0.0, "exposure": 1.0})
    sheet = board_pictures.checkerboard(6, 9, 25.0)
    for k, tilt in enumerate(TILTS):
        R = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
        T = transform(R, np.array([20.0 * (k % 3 - 1), 15.0 * (k % 2), 230.0]) - R @ [62.5, 100.0, 0.0])
        linear = board_pictures.draw_board(sheet, T, rig, optics, rings=False)
        picture = expose(linear, optics, rng, rig.camera)
        Image.fromarray(picture).save(folder / f"{k}.png", compress_level=1)
    return folder


def _run(*words):
    return CliRunner().invoke(app, ["calibrate", "camera", *map(str, words)])


def test_pictures_give_a_rig_a_page_and_figures(pictures, tmp_path):
    out = tmp_path / "rig.yaml"
    blank = tmp_path / "blank.png"
    Image.fromarray(np.full((1232, 1664, 3), 90, dtype=np.uint8)).save(blank)
    half = tmp_path / "half.png"
    half.write_bytes((pictures / "0.png").read_bytes()[:40_000])
    result = _run(pictures, blank, half, "--board", "6x9", "--out", out, "--json")
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert said["pictures_used"] == len(TILTS)
    assert "no board" in said["pictures_rejected"][str(blank)]
    assert "read whole" in said["pictures_rejected"][str(half)]
    assert said["rms_px"] < 0.25
    camera = load_settings(Rig, out).camera
    assert (
        camera.fx_px == said["fx_px"] == pytest.approx(preset_rig().camera.fx_px, abs=3 * said["interval_95"]["fx_px"])
    )
    page = (tmp_path / "rig-camera.html").read_text()
    assert page.count("<img") == 3
    assert "half.png" in page


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--board", "6by9"], "inner corners as 6x9"),
        (["--board", "7x10"], "no board of 7x10 inner corners"),
        (["--rig", "nosuch.yaml"], "no such rig"),
    ],
)
def test_bad_input_is_named(pictures, tmp_path, words, said):
    result = _run(pictures / "0.png", pictures / "1.png", "--out", tmp_path / "rig.yaml", *words)
    assert isinstance(result.exception, BadInput)
    assert said in "\n".join(result.exception.lines)
    assert not (tmp_path / "rig.yaml").exists()
