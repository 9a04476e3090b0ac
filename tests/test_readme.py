"""What the README shows is what happens."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.score import MEANINGS
from scenarios.study.study import load_study
from scenarios.study.tune_file import load_tuning

README = (Path(__file__).resolve().parents[1] / "README.md").read_text()


def _block(language: str, containing: str) -> str:
    blocks = re.findall(rf"```{language}\n(.*?)```", README, flags=re.S)
    return next(block for block in blocks if containing in block)


def test_the_example_scenario_is_sound_and_its_faults_are_said_as_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = _block("yaml", "name: my-pipe")
    Path("my-pipe.yaml").write_text(example)
    assert load_scenario("my-pipe.yaml").pipe.features[0].kind == "pit"
    spoiled = example.replace("depth_mm: 4,", "depht_mm: 4,").replace("path_length_mm: 60", "path_length_mm: -60")
    Path("bad-pipe.yaml").write_text(spoiled)
    with pytest.raises(BadInput) as faults:
        load_scenario("bad-pipe.yaml")
    assert _block("text", "check bad-pipe.yaml").splitlines()[1:] == str(faults.value).splitlines()


def test_the_example_study_is_sound_and_plans_as_many_runs_as_shown(tmp_path):
    (tmp_path / "depth.yaml").write_text(_block("yaml", "name: depth-and-noise"))
    study = load_study(tmp_path / "depth.yaml")
    assert f"planning {study.planned} runs" in _block("text", "pipetwin study depth.yaml")
    assert f"done {study.planned}, failed 0" in _block("text", "pipetwin study depth.yaml")


def test_the_example_tuning_is_sound(tmp_path):
    (tmp_path / "sizing.yaml").write_text(_block("yaml", "hold_out:"))
    assert load_tuning(tmp_path / "sizing.yaml").hold_out.planned == 12


def test_the_demo_s_table_has_every_figure():
    shown = [line.split()[0] for line in _block("text", "defects_true").splitlines()]
    assert shown == [*MEANINGS, "report:"]


def test_every_file_it_names_exists():
    root = Path(__file__).resolve().parents[1]
    named = set(re.findall(r"`((?:twin|algorithms|sensor_model|scenarios|tests|benchmarks|docs)/[\w/.]*)`", README))
    named |= set(re.findall(r"\]\(([\w/.-]+)\)", README))
    assert len(named) > 10
    assert [name for name in named if not (root / name).exists()] == []
