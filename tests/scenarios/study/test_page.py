"""The study page, the tables for other programs, and the numbers in both."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from scenarios.study.conduct import opened
from scenarios.study.gather import Gathered, gather, levels, mean_of, paired
from scenarios.study.ledger import Ledger, Outcome
from scenarios.study.page import write_page
from scenarios.study.plan import identity, planned_runs, recipe_of
from scenarios.study.study import load_study

RECORD = ("name: stand-in", "name: stand-in\nwhy: <b>why</b>\nrecord: [depth_error_mm_max, false_calls]")


@pytest.fixture
def folder(lab, tmp_path: Path) -> Path:
    """A ledger whose figures are known: the error is the depth, and 0.5 more for `coarse`; some runs have failed."""
    study = load_study(lab.write(RECORD))
    out = tmp_path / "out"
    out.mkdir()
    with Ledger(out) as ledger:
        recipe = recipe_of(study, "code")
        facts = {"identity": identity(study, "code"), "name": study.name, "why": study.why}
        ledger.plan(planned_runs(study, recipe), {**facts, "methods": list(study.methods)})
        for job in ledger.todo():
            more = 0.5 if job.method == "coarse" else 0.0
            depth, noise = (float(value) for value in job.values)
            if job.seed == 3:
                ledger.finished([Outcome(job.key, 1.0, cause="raised", error="<script>it</script> broke")])
            elif job.seed < 2:
                pair = [40.0, 30.0, depth, 41.0, 30.0 - noise, depth + more]
                ledger.finished([Outcome(job.key, 1.0, [depth + more, None if depth == 1 else 0], [pair])])
    return out


@pytest.fixture
def found(folder: Path) -> Gathered:
    with opened(folder) as ledger:
        return gather(ledger)


def test_figures_are_gathered_with_their_n(found):
    assert len(found.method) == 24
    depth = found.column("depth_error_mm_max")
    mean = mean_of(depth[found.method == 0])
    assert (mean.mean, mean.n) == (2.0, 12)
    assert mean.half == pytest.approx(2.201 * np.std([1, 2, 3] * 4, ddof=1) / 12**0.5, rel=1e-3)  # Student's t, 11
    assert mean_of(found.column("false_calls")).n == 16  # the rest have none
    assert mean_of(np.array([1.0])).half is None
    assert mean_of(np.array([np.nan])).n == 0


def test_methods_are_compared_scan_by_scan(found):
    difference = paired(found, "depth_error_mm_max", 1)
    assert difference.mean == pytest.approx(0.5)
    assert difference.half == pytest.approx(0.0, abs=1e-12)
    assert difference.n == 12


def test_a_factor_has_its_levels_and_many_numbers_come_in_bins(found):
    by_depth = levels(found, "pipe.features.0.depth_mm")
    assert [(level.name, level.place, int(level.runs.sum())) for level in by_depth] == [
        ("1", 1.0, 8),
        ("2", 2.0, 8),
        ("3", 3.0, 8),
    ]
    found.values["x"] = list(np.linspace(0, 1, 24))
    bins = levels(found, "x")
    assert sum(level.runs.sum() for level in bins) == 24
    assert len(bins) == 6
    found.values["x"] = ["a", {"b": 1}] * 12
    assert [level.runs.sum() for level in levels(found, "x")] == [12, 12]


def test_the_page_says_failures_first_and_every_n(folder: Path):
    with opened(folder) as ledger:
        write_page(ledger, folder / "study.html")
    page = (folder / "study.html").read_text()
    assert "Stopped: 24 of 48 runs done, 12 failed." in page
    headings = [part.split("</h2>")[0] for part in page.split("<h2>")[1:]]
    assert headings == [
        "Failures",
        "Progress",
        "Methods",
        "Methods, paired",
        "Over pipe.features.0.depth_mm",
        "Over sensing.points.pixel_noise_px",
        "Measured over true",
        "Extrapolated: beyond what the testbench was held against",
    ]
    assert "&lt;script&gt;it&lt;/script&gt; broke" in page
    assert "<script" not in page
    assert "&lt;b&gt;why" in page
    assert "0.5 ± " in page
    assert "(n = 12)" in page
    assert page.count("data:image/png;base64,") == 3
    assert 'http-equiv="refresh"' not in page


def test_the_page_of_a_running_study_is_light(folder: Path):
    with opened(folder) as ledger:
        write_page(ledger, folder / "study.html", running=True)
    page = (folder / "study.html").read_text()
    assert "Running: 24 of 48" in page
    assert 'http-equiv="refresh"' in page
    assert "data:image" not in page


def test_a_study_without_any_result_has_a_page(lab, tmp_path: Path):
    study = load_study(lab.write())
    with Ledger(tmp_path) as ledger:
        facts = {"identity": identity(study, "code"), "name": study.name, "methods": list(study.methods)}
        ledger.plan(planned_runs(study, recipe_of(study, "code")), facts)
        write_page(ledger, tmp_path / "study.html")
    assert "Stopped: 0 of 48 runs done" in (tmp_path / "study.html").read_text()


def test_tables_hold_every_run_sorted_by_key_without_times(folder: Path, lab):
    runs, defects = (list(csv.DictReader(io.StringIO(table.decode()))) for table in lab.exported("out"))
    assert [row["key"] for row in runs] == sorted(row["key"] for row in runs)
    assert {state: sum(row["state"] == state for row in runs) for state in ("done", "failed", "planned")} == {
        "done": 24,
        "failed": 12,
        "planned": 12,
    }
    done = next(row for row in runs if row["state"] == "done" and row["method"] == "coarse")
    assert float(done["depth_error_mm_max"]) == float(done["pipe.features.0.depth_mm"]) + 0.5
    assert "seconds" not in done
    assert len(defects) == 24
    assert float(defects[0]["width_mm_true"]) == 30.0


def test_parquet_holds_the_same(folder: Path, lab):
    import pyarrow.parquet as pq

    assert lab.exported("out", "parquet") == lab.exported("out", "parquet")
    table = pq.read_table(folder / "runs.parquet")
    rows = list(csv.DictReader(io.StringIO(lab.exported("out")[0].decode())))
    assert table.column("key").to_pylist() == [row["key"] for row in rows]
    assert str(table.schema.field("false_calls").type) == "int64"
    assert str(table.schema.field("pipe.features.0.depth_mm").type) == "double"
    assert [v for v in table.column("depth_error_mm_max").to_pylist() if v is not None] == [
        float(row["depth_error_mm_max"]) for row in rows if row["depth_error_mm_max"]
    ]
