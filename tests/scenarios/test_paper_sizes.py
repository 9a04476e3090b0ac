"""The paper's tables and figures of sizes: what is asked of each holds, and each leaves its file."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from scenarios.load import load_scenario
from scenarios.paper import fig14, fig15, fig17, fig18, table2, table4
from scenarios.paper.sized_scan import sized_scan
from scenarios.run import RunFailed

# the library's pockets in half the pipe, on the gantry, whose drive takes no time
POCKET = "kind: pocket, clock_deg: 120, length_mm: 70, width_mm: 35"
WALL_LOSS = [
    "sensing.fidelity=points",
    "drive.stages=[{to_mm: 430}]",
    f"pipe.features=[{{{POCKET}, distance_mm: 250, depth_mm: 5.625}}, {{{POCKET}, distance_mm: 400, depth_mm: 1.875}}]",
]


def quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""


@pytest.fixture(scope="module")
def scan():
    return sized_scan(load_scenario("paper-gantry", WALL_LOSS), 1, quiet)


def test_depth_quality_holds_at_every_wall_loss(scan):
    rows = table4.rows_of([scan])
    assert [row["wall_loss_pct"] for row in rows] == [75, 25]
    assert all(row["verdict"].endswith(": holds") for row in rows)
    assert all(row["quality_pct"] > row["paper_quality_pct"] for row in rows)
    assert "63.5" in table4.words(rows)


def test_a_depth_that_is_off_does_not_hold():
    assert table4._verdict(75.0, 99.0, 0.2).endswith("does not hold")
    assert table4._verdict(75.0, 96.0, 0.0).endswith("does not hold")
    assert table4._verdict(100.0, 50.0, 0.0).endswith("holds")


def test_a_scan_s_row_stands_beside_the_paper_s(scan):
    row = table2.row_of(1, scan)
    assert row["paper_err_pct"] == 2.3
    assert row["err_pct"] < 2 < row["oracle_err_pct"] < 20
    assert abs(row["depth_error_mm"]) < 0.1
    said = table2.words([row, {**row, "err_pct": 7.0}])
    assert "Err (Eq. 29): worst 7.00 %, at most 2 %: does not hold" in said


def test_a_missed_defect_fails_by_name(scan):
    blind = scan._replace(found=scan.found.__class__(**{**vars(scan.found), "defects": ()}))
    with pytest.raises(RunFailed, match=r"at 250\.0 mm was not found"):
        table2.row_of(1, blind)
    with pytest.raises(RunFailed, match="found in 0 of 1 scans"):
        table4.rows_of([blind])


@pytest.mark.parametrize("figure", [fig14, fig15, fig17, fig18])
def test_every_figure_has_rows_and_a_picture(scan, figure):
    rows, picture = figure.make(scan)
    assert rows
    assert figure.words(rows)
    assert picture.startswith(b"\x89PNG")
    json.dumps(rows, allow_nan=False)


def test_the_oracle_s_choice_is_labelled_and_the_blind_one_is_no_worse(scan):
    rows, _ = fig14.make(scan)
    chosen = {row["chosen"]: row["err_pct"] for row in rows if row["chosen"]}
    assert set(chosen) == {"the true size (oracle)", "blind"}
    assert chosen["blind"] < chosen["the true size (oracle)"] + 1


@pytest.mark.parametrize("name", ["paper-wall-loss", "paper-scratches"])
def test_the_scenarios_hold_what_the_paper_scanned(name):
    pipe = load_scenario(name).pipe
    assert len(pipe.features) == {"paper-wall-loss": 4, "paper-scratches": 3}[name]


def test_the_command_says_what_is_wrong(tmp_path):
    (tmp_path / "taken").write_text("a file")
    words = [sys.executable, "-m", "scenarios.cli", "paper", "table4", "--fidelity", "points", "-o", "taken/here"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "taken" in done.stderr
    assert "Traceback" not in done.stderr


def test_two_passes_see_what_the_strut_hides_from_one():
    pocket = "{kind: pocket, distance_mm: 140, clock_deg: 0, length_mm: 30, width_mm: 30, depth_mm: 3}"
    short = ["sensing.fidelity=points", f"pipe.features=[{pocket}]", "drive.speed_mm_s=40"]
    seen = {}
    for passes, stages in (("one", "[{to_mm: 90}]"), ("two", "[{to_mm: 90, roll_to_deg: 60}, {to_mm: 0}]")):
        scan = sized_scan(load_scenario("two-pass", [*short, f"drive.stages={stages}"]), 1, quiet)
        wall = scan.found.wall
        seen[passes] = wall.seen[:, (wall.z_mm > 110) & (wall.z_mm < 170)].mean()
    assert seen["one"] < 0.92
    assert seen["two"] > 0.97
    ((feature, defect),) = scan.pairs()
    assert defect.width_mm == pytest.approx(feature.width_mm, abs=1.0)
    assert defect.depth_mm == pytest.approx(3, abs=0.1)
