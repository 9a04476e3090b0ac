"""The cheap fidelity: its noise is that of pictures, and where it differs from them is said."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.fidelity.compare import compare, trusted, verdict_of
from scenarios.fidelity.noise import measure, write_noise
from scenarios.load import load_scenario
from scenarios.study.conduct import How
from sensor_model.points import PointNoise, point_noise, see_slits
from sensor_model.rig import load_settings, preset_rig

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def _apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIPETWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "campaigns"), os.environ.get("PYTHONPATH", "")]))


def test_measured_noise_is_the_pictures_own(tmp_path):
    scenario = load_scenario("paper-gantry")
    found = measure(scenario, 4, 1, lambda *_: None)
    kept = point_noise("default")
    # the print of the slide makes 0.4 to 0.6 px; what is left of it where its own pattern is known is noise
    np.testing.assert_allclose(found.noise.slit_noise_px, kept.slit_noise_px, atol=0.03)
    np.testing.assert_allclose(found.noise.slit_bias_px, kept.slit_bias_px, atol=0.03)
    np.testing.assert_allclose(found.noise.slit_sigma_px, kept.slit_sigma_px, rtol=0.2)
    assert max(found.noise.slit_noise_px) < 0.15
    assert found.stray_share < 0.01
    write_noise(tmp_path / "noise.yaml", found, scenario)
    assert load_settings(PointNoise, tmp_path / "noise.yaml") == found.noise
    assert "paper-gantry, seed 0" in (tmp_path / "noise.yaml").read_text()


def test_a_noise_by_name_reaches_the_sensor():
    scenario = load_scenario("paper-gantry")
    named = type(scenario.sensing).model_validate({"points": "default"})
    assert named.points == point_noise("default")
    of_wall = type(scenario.sensing).model_validate({"optics": {"wall": "yellow-pe"}, "points": "default"})
    assert of_wall.points == point_noise("yellow-pe") != named.points
    with pytest.raises(ValueError, match="there are black-pe, default, endoscope"):
        type(scenario.sensing).model_validate({"points": "nobody"})
    noise = PointNoise(slit_noise_px=(0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match="got 3 values; the rig has 8 slits"):
        see_slits(scenario.pipe, np.eye(4), preset_rig(), noise, np.random.default_rng(0))


def test_slit_by_slit_says_what_one_number_said():
    pipe, rig = load_scenario("paper-gantry").pipe, preset_rig()
    one = see_slits(pipe, np.eye(4), rig, PointNoise(), np.random.default_rng(1))
    each = PointNoise(slit_noise_px=(0.25,) * 8, slit_drop_out_share=(0.02,) * 8, slit_sigma_px=(0.7,) * 8)
    other = see_slits(pipe, np.eye(4), rig, each, np.random.default_rng(1))
    np.testing.assert_array_equal(one.pixel, other.pixel)
    np.testing.assert_array_equal(other.sigma_px, 0.7)
    quiet = PointNoise(pixel_noise_px=0.0, drop_out_share=0.0)
    further = see_slits(pipe, np.eye(4), rig, quiet.model_copy(update={"slit_bias_px": (1.0,) * 8}), one_rng())
    there = see_slits(pipe, np.eye(4), rig, quiet, one_rng())
    center = [rig.camera.cx_px, rig.camera.cy_px]
    outward = np.linalg.norm(further.pixel - center, axis=1) - np.linalg.norm(there.pixel - center, axis=1)
    np.testing.assert_allclose(outward, 1.0, atol=1e-9)


def one_rng() -> np.random.Generator:
    """The same draws each time."""
    return np.random.default_rng(1)


@pytest.mark.parametrize(
    ("difference", "half", "spread", "verdict"),
    [(0.1, 0.5, 1.0, "agrees"), (1.9, 0.2, 1.0, "open"), (5.0, 1.0, 1.0, "differs"), (0.0, 0.0, 0.0, "agrees")],
)
def test_verdicts(difference, half, spread, verdict):
    assert verdict_of(difference, half, spread) == verdict


def test_scores_that_differ_are_not_trusted(tmp_path):
    how = How(2, make="standin:biased")
    args = (["paper-gantry"], ["points"], 5, "default", tmp_path / "out", how, lambda *_: None, lambda _: None)
    found, (cost,) = compare(*args)
    by_score = {one.score: one for one in found}
    first, *others = by_score
    assert by_score[first].verdict == "differs"
    assert by_score[first].difference == pytest.approx(100)
    assert all(by_score[name].verdict == "agrees" for name in others)
    assert trusted(found, "points") == others
    written = json.loads((tmp_path / "out" / "fidelity.json").read_text())
    assert written["trusted"]["points"] == others
    assert written["costs"][0]["cheaper"] == cost.cheaper
    page = (tmp_path / "out" / "fidelity.html").read_text()
    assert f"points: {len(others)} scores agree" in page
    assert compare(*args)[0] == found  # nothing is left to run


def test_no_such_scenario_is_said(tmp_path):
    with pytest.raises(BadInput, match="no such scenario"):
        compare(["nowhere"], ["points"], 2, "default", tmp_path, How(1), lambda *_: None, lambda _: None)
