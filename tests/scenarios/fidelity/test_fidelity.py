"""The cheap fidelity: its noise is that of pictures, and where it differs from them is said."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.fidelity.agreed import Compared, Comparison, alike, looks, trusted, trusts, verdict_of
from scenarios.fidelity.compare import compare, of_library
from scenarios.fidelity.noise import measure, write_noise
from scenarios.load import library, load_scenario
from scenarios.study import conduct as conduct_module
from scenarios.study.conduct import How
from sensor_model.points import PointNoise, point_noise, see_slits
from sensor_model.rig import load_settings, preset_rig

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def _apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIPETWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(conduct_module, "write_page", lambda *_, **__: None)  # drawn in its own tests
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


def _compared(tmp_path: Path, bases: list[str], noise: str = "default") -> list[Comparison]:
    how = How(2, make="standin:biased")
    chosen = {base: {"drive.speed_mm_s": 100} for base in bases}
    return compare(chosen, ["points"], 5, noise, tmp_path / "out", how, lambda *_: None, lambda _: None)


def test_scores_that_differ_are_not_trusted(tmp_path, monkeypatch):
    (one,) = _compared(tmp_path, ["paper-gantry"])
    by_score = {row.score: row for row in one.scores}
    first, *others = by_score
    assert by_score[first].verdict == "differs"
    assert by_score[first].difference == pytest.approx(100)
    assert trusted([one], "points") == others
    # another scenario joins it in the same folder, where the first is left as it was
    both = _compared(tmp_path, ["field-4in-yellow-sdr11"])
    assert [c.scenario for c in both] == ["paper-gantry", "field-4in-yellow-sdr11"]
    assert (both[0].seeds, both[0].changes) == (5, {"drive.speed_mm_s": 100})
    assert [len(group) for group in looks(both)] == [1, 1]
    page = (tmp_path / "out" / "fidelity.html").read_text()
    assert f"points over paper-gantry: {len(others)} scores agree" in page
    written = (tmp_path / "out" / "fidelity.json").read_text()
    _compared(tmp_path, ["paper-gantry"])  # nothing is left to run
    assert (tmp_path / "out" / "fidelity.json").read_text() == written
    # shipped, it stands for scenes of the same optics and bore, and for no others
    monkeypatch.setattr("scenarios.fidelity.agreed.FOLDER", tmp_path / "agreed")
    (tmp_path / "agreed").mkdir()
    (tmp_path / "out" / "fidelity.json").rename(tmp_path / "agreed" / "default.json")
    measured = ["sensing.fidelity=points", "sensing.points=default"]
    dry, yellow = (load_scenario(name, measured) for name in ("field-dry", "field-4in-yellow-sdr11"))
    assert [c.scenario for c in alike(dry)] == ["paper-gantry"]
    assert [c.scenario for c in alike(yellow)] == ["field-4in-yellow-sdr11"]
    assert trusts(dry, others[0])
    assert not trusts(dry, first)
    assert trusts(load_scenario("field-dry"), first)  # in pictures
    assert not trusts(load_scenario("field-8in", measured), others[0])
    assert not trusts(load_scenario("field-dry", measured[:1]), others[0])  # noise of its own


def test_a_score_must_agree_over_all_and_differ_in_none():
    def one(*differences: float) -> list[Comparison]:
        rows = [[Compared("points", "x", 5.0, 1.0, difference, 1.2, 10)] for difference in differences]
        return [Comparison("s", 10, "0", "c", {}, {}, 76.2, [], row) for row in rows]

    assert [c.scores[0].verdict for c in one(1.0, 0.0, 5.0)] == ["open", "agrees", "differs"]
    assert trusted(one(1.0), "points") == []
    assert trusted(one(1.0, 0.0), "points") == ["x"]  # what is open in one is told by both
    assert trusted(one(5.0, 0.0, 0.0, 0.0, 0.0, 0.0), "points") == []


def test_another_noise_needs_another_folder(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fidelity.json").write_text('{"noise": "default", "scenarios": []}')
    with pytest.raises(BadInput, match="compares with the noise default"):
        _compared(tmp_path, ["paper-gantry"], "endoscope")


def test_the_library_is_compared_whole():
    found = of_library([])
    assert {name for name in library() if name.startswith("field-")} <= set(found)
    for name, changes in found.items():
        load_scenario(name, [f"{path}={value}" for path, value in changes.items()])
    assert list(of_library(["field-wet"])) == ["field-wet"]
    with pytest.raises(BadInput, match=r"nowhere: --library has field-dry,"):
        of_library(["nowhere"])


def test_no_such_scenario_is_said(tmp_path):
    with pytest.raises(BadInput, match="no such scenario"):
        _compared(tmp_path, ["nowhere"])
