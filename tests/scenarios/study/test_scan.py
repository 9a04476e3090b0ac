"""A study of real short scans: its rows are those of `run`, cached or not, and methods share a recording."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from scenarios.run import run, sensed
from scenarios.study import scan as module
from scenarios.study.cache import Cache
from scenarios.study.conduct import opened
from scenarios.study.plan import Recipe, recipe_of
from scenarios.study.scan import maker, scan, stage_keys
from scenarios.study.study import load_study
from sensor_model.recording import open_recording
from sensor_model.streams import stream
from twin.simulate import simulate

SCANS = "scenarios.study.scan:maker"


@pytest.fixture
def recipe(lab) -> Recipe:
    return recipe_of(load_study(lab.write(text=lab.scan)), "code")


def _scenario(recipe: Recipe, method: str = "default", noise_px: float = 0.2, seed: int = 0):
    return recipe.scenario([noise_px], method, seed)


def test_a_run_of_a_study_scores_as_run_does(recipe, tmp_path: Path, monkeypatch):
    import scenarios.report.page as page

    monkeypatch.setattr(page, "write_report", lambda _, file: file.write_text(""))
    scenario = _scenario(recipe)
    whole = run(scenario, tmp_path / "run", 1, lambda *_: None)
    cache = Cache(tmp_path / "cache", 1e9)
    first, pairs, ms = scan(scenario, cache)
    assert first == whole
    assert pairs[0][:3] == [40.0, 30.0, 5.0]
    assert scan(scenario, cache) == (first, pairs, ms)  # all of it out of the cache
    assert scan(scenario, Cache(tmp_path / "none", 0.0))[:2] == (first, pairs)
    assert ms > 0


def test_each_stage_depends_on_what_it_reads_and_on_nothing_else(recipe):
    def keys(**changes: dict) -> dict[str, str]:
        data = _scenario(recipe).model_dump(mode="json")
        for part, values in changes.items():
            data[part] |= values
        return stage_keys(type(_scenario(recipe)).model_validate(data))

    base = keys()
    changed = {
        "sizing": keys(method={"sizing": {"threshold": {"min_depth_mm": 2.0}}}),
        "map": keys(method={"map": {"cell_z_mm": 2.0}}),
        "decode": keys(method={"decode": {"azimuths": 360}}),
        "sensing": keys(sensing={"frame_rate_hz": 4.0}),
        "drive": keys(drive={"speed_mm_s": 40.0}),
    }
    stages = ["drive", "recording", "slits", "map"]
    kept = {name: [stage for stage in stages if other[stage] == base[stage]] for name, other in changed.items()}
    assert kept == {"sizing": stages, "map": stages[:3], "decode": stages[:2], "sensing": stages[:1], "drive": []}
    assert stage_keys(_scenario(recipe, seed=1))["recording"] != base["recording"]


def test_methods_measure_one_recording_and_no_stage_is_made_twice(recipe, tmp_path: Path, monkeypatch):
    made = []
    monkeypatch.setattr(module, "sensed", lambda *words: made.append(words[2]) or sensed(*words))
    cache = Cache(tmp_path / "cache", 1e9)
    figures = [scan(_scenario(recipe, method), cache)[0] for method in ("default", "wide")]
    assert len(made) == 1
    assert figures[0]["frames"] == figures[1]["frames"]
    assert figures[0] != figures[1]


def test_a_defect_that_was_missed_is_a_row_too_and_one_that_was_not_scanned_is_none(recipe, tmp_path: Path):
    scenario = _scenario(recipe)
    pocket = scenario.pipe.features[0]
    shallow = pocket.model_copy(update={"depth_mm": 0.01, "clock_deg": 240.0})
    beyond = pocket.model_copy(update={"distance_mm": scenario.pipe.end_mm - 30})
    pipe = scenario.pipe.model_copy(update={"features": (shallow, pocket, beyond)})
    _, sizes, _ = scan(scenario.model_copy(update={"pipe": pipe}), Cache(tmp_path / "cache", 1e9))
    assert sizes[0] == [40.0, 30.0, 0.01]
    assert sizes[1][:3] == [40.0, 30.0, 5.0]
    assert len(sizes[1]) == 6
    assert len(sizes) == 2


def test_pictures_are_decoded_once(recipe, tmp_path: Path, monkeypatch):
    drawn = _scenario(recipe)
    truth = simulate(drawn.pipe, drawn.robot, drawn.drive, stream(0, "drive"))
    sensed(drawn, truth, tmp_path / "recording", 1, {}, lambda *_: None)
    recording = open_recording(tmp_path / "recording")
    pictured = drawn.model_copy(update={"sensing": drawn.sensing.model_copy(update={"fidelity": "raycast"})})
    seen = []
    see = module.see
    monkeypatch.setattr(module, "see", lambda *words: seen.append(1) or see(*words))
    cache = Cache(tmp_path / "cache", 1e9)
    for _ in range(2):
        frames = list(module._slit_pixels(pictured, recording, cache, "0" * 40))
        for frame, raw in zip(frames, (recording[i].slit_pixels for i in range(len(recording))), strict=True):
            for name in ("pixel", "slit", "sigma_px"):
                np.testing.assert_array_equal(getattr(frame, name), getattr(raw, name))
    assert len(seen) == len(recording)


def test_a_worker_makes_rows_of_plain_data(recipe):
    make = maker(json.loads(json.dumps(asdict(recipe))))
    figures, pairs = make({"key": "k", "values": [0.2], "method": "default", "seed": 0})
    assert len(figures) == len(recipe.record)
    assert json.loads(json.dumps([figures, pairs], allow_nan=False)) == [figures, pairs]


def test_a_real_study_gives_the_same_rows_on_one_process_and_two(lab):
    file = lab.write(text=lab.scan)
    assert lab.run(file, "one", 1, SCANS)["done"] == 4
    rows = lab.exported("one")
    assert lab.run(file, "two", 2, SCANS, backwards=True)["done"] == 4
    assert lab.exported("two") == rows
    with opened(lab.folder / "one") as ledger:
        names = ledger.about("identity")["record"]
        figures = {row.method: dict(zip(names, row.figures, strict=True)) for row in ledger.rows()}
    assert figures["default"]["defects_found"] == 1
