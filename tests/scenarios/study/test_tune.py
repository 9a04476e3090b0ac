"""Tuning: finds what there is to find, the same on every way there, and judges it on scans that it never saw."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.study import tune as module
from scenarios.study.tune import Tuned, tune
from scenarios.study.tune_file import load_tuning

TUNE = """\
name: tuned
base: paper-gantry
tuning:
  factors: {sensing.points.pixel_noise_px: [0.1, 0.2, 0.3]}
  design: {kind: grid, seeds: 2}
hold_out:
  factors: {sensing.points.pixel_noise_px: [0.15, 0.25]}
  design: {kind: grid, seeds: [10, 11, 12]}
search:
  method.sizing.threshold.rule: [noise, otsu]
  method.map.cell_z_mm: {low: 0.5, high: 4}
objectives: [depth_error_mm, misses_and_false_calls]
trials: 24
confirm: {scans: 0}
"""
FILES = ["method.yaml", "tuning.json", "tuning.html"]
MAKE = "standin:tunable"


def _tune(lab, out: str, *replace: tuple[str, str], workers: int = 1) -> Tuned:
    file = lab.write(*replace, text=TUNE, name="tune.yaml")
    return tune(file, lab.folder / out, workers, lambda *_: None, lambda _: None, make=MAKE)


def _bytes(lab, out: str) -> list[bytes]:
    return [(lab.folder / out / name).read_bytes() for name in FILES]


def test_it_finds_the_optimum_and_says_that_it_is_better(lab):
    tuned = _tune(lab, "out")
    assert tuned.settings["method.map.cell_z_mm"] == pytest.approx(2.0, abs=0.25)
    (verdict,) = tuned.verdicts
    assert "depth_error_mm: better (-0.9" in verdict.words
    assert "misses_and_false_calls: no difference beyond the noise" in verdict.words
    assert verdict.difference["depth_error_mm"].n == 6
    cell, rule = (
        tuned.importance["depth_error_mm"][f"method.{name}"] for name in ("map.cell_z_mm", "sizing.threshold.rule")
    )
    assert cell > rule


def test_the_robot_s_scenario_loads_what_it_writes(lab):
    tuned = _tune(lab, "out")
    scenario = load_scenario("paper-gantry", method=lab.folder / "out" / "method.yaml")
    assert scenario.method.map.cell_z_mm == tuned.settings["method.map.cell_z_mm"]
    changed = load_scenario("paper-gantry", ["method.map.cell_z_mm=3"], method=lab.folder / "out" / "method.yaml")
    assert changed.method.map.cell_z_mm == 3.0
    (lab.folder / "bad.yaml").write_text("map: {cell: 3}")
    with pytest.raises(BadInput, match=r"bad.yaml:1:7: method\.map\.cell: got an unknown key"):
        load_scenario("paper-gantry", method=lab.folder / "bad.yaml")


def test_the_same_search_ends_in_the_same_files(lab, monkeypatch):
    _tune(lab, "one")
    _tune(lab, "two", workers=2)
    assert _bytes(lab, "one") == _bytes(lab, "two")
    with monkeypatch.context() as patch:
        times = iter(range(100))

        def interrupted(*arguments: object) -> object:
            if next(times) == 5:
                raise KeyboardInterrupt
            return looked_at(*arguments)

        looked_at = module._looked_at
        patch.setattr(module, "_looked_at", interrupted)
        with pytest.raises(KeyboardInterrupt):
            _tune(lab, "stopped")
    _tune(lab, "stopped")
    assert _read(lab, "stopped")["settings"] == _read(lab, "one")["settings"]
    assert (lab.folder / "stopped" / "method.yaml").read_bytes() == _bytes(lab, "one")[0]
    _tune(lab, "other", ("trials: 24", "trials: 24\nseed: 5"))
    assert _bytes(lab, "other") != _bytes(lab, "one")


def _read(lab, out: str) -> dict:
    return json.loads((lab.folder / out / "tuning.json").read_text())


def test_a_search_that_cannot_win_is_told_so(lab):
    tuned = _tune(lab, "out", ("{low: 0.5, high: 4}", "{low: 0.5, high: 1}"), ("trials: 24", "trials: 3"))
    assert tuned.verdicts[0].words.startswith("depth_error_mm: no difference beyond the noise (+0 ± 0, n = 6)")
    page = (lab.folder / "out" / "tuning.html").read_text()
    assert 'class="verdict faulty">Hold-out: depth_error_mm: no difference' in page
    assert page.count("<img") == 2  # trials over the objectives, and over the searched settings


def test_it_is_judged_beyond_what_it_was_tuned_on_too(lab):
    """Scans of other scenarios, and a part under stress that the search never sees."""
    scenes = "{scenario: [field-dry, field-wet], sensing.points.pixel_noise_px: [0.1, 0.2, 0.3]}"
    stress = "stress:\n  factors: {scenario: [field-oval]}\n  design: {kind: grid, seeds: 5}\nsearch:"
    factors = "{sensing.points.pixel_noise_px: [0.1, 0.2, 0.3]}"
    tuned = _tune(lab, "out", (factors, scenes), ("search:", stress), ("trials: 24", "trials: 8"))
    assert [verdict.fidelity for verdict in tuned.verdicts] == ["points", "points, under stress"]
    assert tuned.verdicts[1].difference["depth_error_mm"].n == 5
    assert "under stress" in (lab.folder / "out" / "tuning.html").read_text()
    seen = stress.replace("field-oval", "field-dry").replace("seeds: 5", "seeds: [0]")
    seen = seen.replace("{scenario: [field-dry]}", "{scenario: [field-dry], sensing.points.pixel_noise_px: [0.1]}")
    with pytest.raises(BadInput, match=r"stress: got 1 of 1 scans; these are tuned on too"):
        _tune(lab, "seen", (factors, scenes), ("search:", seen))


def test_what_is_not_found_counts_with_the_depth_of_the_scan_s_own_defect(lab):
    own = "pipe.features: [[{kind: pit, distance_mm: 200, clock_deg: 90, diameter_mm: 16, depth_mm: 1.25}]]"
    deeper = "pipe.features.1.depth_mm: [5.5]"  # the second of field-dry's, laid over it
    scans = [f"{{scenario: [field-dry, field-wet], {factor}}}" for factor in (own, deeper)]
    changes = [
        ("{sensing.points.pixel_noise_px: [0.1, 0.2, 0.3]}", scans[0]),
        ("{sensing.points.pixel_noise_px: [0.15, 0.25]}", scans[1]),
        ("trials: 24", "trials: 1"),
    ]
    file = lab.write(*changes, text=TUNE, name="tune.yaml")
    found = tune(file, lab.folder / "out", 1, lambda *_: None, lambda _: None, make="standin:blind")
    assert found.trials[0].values == (1.25, 2)
    assert found.verdicts[0].default["depth_error_mm"].mean == 5.5


@pytest.mark.parametrize("sampler", ["nsga2", "random"])
def test_other_samplers_and_three_objectives_work_too(lab, sampler):
    three = ("misses_and_false_calls]", f"misses_and_false_calls, ms_per_frame]\nsampler: {sampler}")
    tuned = _tune(lab, "out", three)
    assert len(tuned.front) > 1
    assert set(tuned.verdicts[0].winner) == {"depth_error_mm", "misses_and_false_calls", "ms_per_frame"}


FAULTS = {
    "a hold-out that was seen": (
        (
            "[0.15, 0.25]}\n  design: {kind: grid, seeds: [10, 11, 12]}",
            "[0.1, 0.25]}\n  design: {kind: grid, seeds: [1, 9]}",
        ),
        "hold_out: got 1 of 4 scans; these are tuned on too",
    ),
    "a setting that does not exist": (
        ("map.cell_z_mm", "map.cel_z_mm"),
        "11:24: method.map.cel_z_mm: no such setting in the base scenario; did you mean method.map.cell_z_mm",
    ),
    "an unknown objective": (("[depth_error_mm,", "[depth_eror_mm,"), "did you mean depth_error_mm"),
    "an unknown key": (("trials:", "trails:"), "did you mean trials"),
    "a fault in a section": (
        ("[0.1, 0.2, 0.3]", "[]"),
        "4:44: factors.sensing.points.pixel_noise_px: got an empty",
    ),
    "a distribution": (
        ("{low: 0.5, high: 4}", "{distribution: normal, mean: 1, std: 1}"),
        "a search takes a list, or a range",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_input_is_said_with_its_place(lab, fault):
    change, words = FAULTS[fault]
    with pytest.raises(BadInput) as said:
        load_tuning(lab.write(change, text=TUNE, name="tune.yaml"))
    assert words in str(said.value)
    assert "tune.yaml" in said.value.lines[0]


def test_another_tuning_in_the_same_folder_is_refused(lab):
    few = ("trials: 24", "trials: 2")
    _tune(lab, "out", few)
    with pytest.raises(BadInput, match=r"begun with another tuning: .*high was 4 and is 3"):
        _tune(lab, "out", few, ("high: 4", "high: 3"))
    _tune(lab, "out", ("trials: 24", "trials: 4"))  # more of the same is no other tuning


def test_a_storage_that_is_none_is_said(lab):
    file = lab.write(text=TUNE, name="tune.yaml")
    for url in ("nonsense", "sqlite:////nowhere/at/all.sqlite"):
        with pytest.raises(BadInput, match="cannot be used"):
            tune(file, lab.folder / "out", 1, lambda *_: None, lambda _: None, url, MAKE)


def test_a_small_real_tuning_ends_with_a_verdict(lab, tmp_path: Path):
    text = lab.scan.split("factors:")[0] + TUNE.split("base: paper-gantry\n")[1]
    text = text.replace("[0.1, 0.2, 0.3]", "[0.2]").replace("seeds: 2", "seeds: 1").replace("[0.15, 0.25]", "[0.3]")
    text = text.replace("[10, 11, 12]", "[10, 11]").replace("trials: 24", "trials: 2").replace("low: 0.5", "low: 3")
    file = tmp_path / "tune.yaml"
    file.write_text(text)
    tuned = tune(file, tmp_path / "out", 2, lambda *_: None, lambda _: None)
    assert tuned.verdicts[0].difference["depth_error_mm"].n == 2
