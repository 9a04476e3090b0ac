"""`pipetwin pod` straight from scans: a study's ledger, or run folders."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.study.ledger import Ledger, Outcome, PlannedRun
from scenarios.trust.scan_looks import looks_of

METHODS = ("default", "coarse")
A50_MM = {"default": 1.0, "coarse": 2.0}


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """A ledger of two methods that find pits from 1 and 2 mm on: 60 depths, two seeds each; one run failed."""
    folder, rng = tmp_path_factory.mktemp("study"), np.random.default_rng(0)
    runs, outcomes = [], []
    for point, depth in enumerate(np.linspace(0.2, 4.0, 60)):
        for method in METHODS:
            for seed in (0, 1):
                key = f"{len(runs):032x}"
                runs.append(PlannedRun(key, point, method, seed, (float(depth),)))
                found = rng.uniform() < 1 / (1 + (A50_MM[method] / depth) ** 8)
                sizes = [10.0, 10.0, float(depth)]
                outcomes.append(Outcome(key, 1.0, [], [sizes + [10.1, 9.9, float(depth)] * int(found)]))
    outcomes[-1] = Outcome(runs[-1].key, 1.0, cause="raised", error="broke")
    with Ledger(folder) as ledger:
        path = "pipe.features.0.depth_mm"
        identity = {"paths": [path], "factors": {path: {}}, "record": []}
        facts = {"methods": list(METHODS), "identity": identity}
        ledger.plan(runs, facts)
        ledger.finished(outcomes)
    return folder


def test_every_defect_of_one_method_is_a_look_and_seeds_look_again(study):
    rows = looks_of(study, "coarse")
    assert len(rows) == 119
    assert len({row["target"] for row in rows}) == 60
    assert {row["found"] for row in rows} == {0, 1}
    assert rows[0]["true_depth_mm"] == rows[0]["pipe.features.0.depth_mm"]


def test_a_sweep_ends_in_a90_95(study, tmp_path):
    out = tmp_path / "pod"
    for method, a50 in A50_MM.items():
        said = CliRunner().invoke(app, ["pod", str(study), "--method", method, "-o", str(out)])
        assert said.exit_code == 0, said.exception
        words = dict(line.split("  ", 1) for line in said.stdout.splitlines() if "  " in line)
        assert float(words["a50"]) == pytest.approx(a50, rel=0.2)
        assert "2 a target" in words["looks"] or "1-2 a target" in words["looks"]
    looks = list(csv.DictReader((out / "looks.csv").read_text().splitlines()))
    assert len(looks) == 119
    assert {"report.html", "curve.csv"} <= {path.name for path in out.iterdir()}


def test_which_method_must_be_said_and_known(study, tmp_path):
    with pytest.raises(BadInput, match="choose one with --method"):
        looks_of(study)
    with pytest.raises(BadInput, match="got 'fine'"):
        looks_of(study, "fine")
    with pytest.raises(BadInput, match="neither a study nor runs"):
        looks_of(tmp_path)
