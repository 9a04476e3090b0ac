"""The same pipe twice: what grew by a known amount, what is new, what is gone, and what nobody can say."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.field.alignment import Places, lay_over
from scenarios.field.match import matched, table, words
from scenarios.field.match_page import write_match
from scenarios.found_run import read_found

RADIUS_MM = 76.2
BEFORE = (
    "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 3},"
    "{kind: pit, distance_mm: 260, clock_deg: 240, diameter_mm: 20, depth_mm: 4},"
    "{kind: pit, distance_mm: 360, clock_deg: 20, diameter_mm: 20, depth_mm: 4},"
    "{kind: pit, distance_mm: 420, clock_deg: 90, diameter_mm: 18, depth_mm: 4}]"
)
AFTER = (
    "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 44, width_mm: 30, depth_mm: 3.8},"
    "{kind: pit, distance_mm: 260, clock_deg: 240, diameter_mm: 20, depth_mm: 4},"
    "{kind: pit, distance_mm: 360, clock_deg: 20, diameter_mm: 20, depth_mm: 4},"
    "{kind: pit, distance_mm: 300, clock_deg: 170, diameter_mm: 16, depth_mm: 3}]"
)
SHORT = ("sensing.frame_rate_hz=10", "pipe.end_mm=700")


def _drive(roll_deg: float, offset: str) -> str:
    stages = f"[{{to_mm: 1, roll_to_deg: {roll_deg}}}, {{to_mm: 420}}]"
    return f"drive={{kind: gantry, speed_mm_s: 60, offset_mm: {offset}, stages: {stages}}}"


@pytest.fixture(scope="module")
def pair(run_of, tmp_path_factory):
    """A year apart: the later scan is launched 12 mm off, and its strut hides the pit at 12:40."""
    place = tmp_path_factory.mktemp("pair")
    told = "nominal_pipe={inner_radius_mm: 76.2, wall_thickness_mm: 7.5, launch_mm: 12}"
    run_of(place / "before", *SHORT, BEFORE, _drive(-25, "[0, 0]"), seed=3)
    run_of(place / "after", *SHORT, AFTER, _drive(20, "[2, 1]"), told, seed=4)
    return place / "before", place / "after"


def test_growth_new_gone_and_not_seen(pair):
    found = matched(*map(read_found, pair))
    assert found.laid.offset_mm == pytest.approx(-12, abs=1)
    assert np.degrees(found.laid.turn_rad) == pytest.approx(0, abs=1)
    pocket, pit, new, hidden, gone = found.rows
    for name, true in (("depth", 0.8), ("length", 4.0), ("width", 0.0)):
        growth = pocket.growth[name]
        assert abs(growth.change_mm - true) < growth.half_width_mm, name
    assert pocket.growth["depth"].verdict == "grown"
    assert pocket.growth["width"].verdict == "no change shown"
    assert {growth.verdict for growth in pit.growth.values()} == {"no change shown"}
    assert (new.fate, new.after.distance_mm) == ("new", pytest.approx(312, abs=2))
    assert (hidden.fate, hidden.before.distance_mm) == ("not seen now", pytest.approx(360, abs=2))
    assert (gone.fate, gone.before.distance_mm) == ("gone", pytest.approx(420, abs=2))
    assert abs(gone.deepest_there_mm) < 0.2
    assert words(found).startswith("2 paired, 1 of them grown, 1 new, 1 gone, 1 in a place that one scan did not see.")


def test_turned_around_in_time_new_is_gone_and_unseen_is_unseen(pair):
    fates = [row.fate for row in matched(*map(read_found, reversed(pair))).rows]
    assert fates == ["paired", "paired", "gone", "not seen before", "new"]


def test_beyond_the_scan_nothing_is_gone(pair):
    before, after = map(read_found, pair)
    short = after.deviation_mm.copy()
    short[:, after.wall.z_mm > 425] = np.nan
    rows = matched(before, replace(after, deviation_mm=short)).rows
    assert rows[-1].fate == "not seen now"
    assert "nothing is said of it" in table(matched(before, replace(after, deviation_mm=short)))[-1]["remark"]


def test_a_least_size_has_no_interval_of_growth(pair):
    before, after = map(read_found, pair)
    dark = tuple(replace(one, floor_seen=False) for one in after.defects)
    growth = matched(before, replace(after, defects=dark)).rows[0].growth
    assert (growth["depth"].verdict, growth["depth"].half_width_mm) == ("open", None)
    assert growth["length"].half_width_mm is not None


def test_what_stands_inward_is_no_defect_s_partner_and_rings_lay_scans_over(pair):
    before, after = map(read_found, pair)
    dents = tuple(replace(one, feature_class="inward") for one in after.defects)
    assert "paired" not in [row.fate for row in matched(before, replace(after, defects=dents)).rows]
    ring = replace(before.defects[0], start_mm=200.0, length_mm=6.0, theta_rad=0.0, feature_class="inward ring")
    rings = [replace(run, defects=(replace(ring, start_mm=z),)) for run, z in ((before, 200.0), (after, 230.0))]
    found = matched(*rings)
    assert [row.fate for row in found.rows] == ["paired"]
    assert (found.laid.offset_mm, found.laid.sure) == (pytest.approx(-30), False)


def test_the_command_leaves_a_page_and_tables(pair, tmp_path):
    out = tmp_path / "match"
    done = CliRunner().invoke(app, ["match", *map(str, pair), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert {path.name for path in out.iterdir()} == {"match.csv", "match.json", "report.html", "run.json"}
    held = json.loads((out / "match.json").read_text())
    assert [row["fate"] for row in held["defects"]] == ["paired", "paired", "new", "not seen now", "gone"]
    assert held["alignment_sure"] is True
    assert "What became of it" in (out / "report.html").read_text()


def test_another_pipe_is_refused(pair, run_of, tmp_path):
    wide = run_of(
        tmp_path / "wide", "pipe.inner_radius_mm=90", "pipe.features=[]", "drive.stages=[{to_mm: 40}]", SHORT[0]
    )
    with pytest.raises(BadInput, match="not one pipe"):
        write_match(pair[0], wide, tmp_path / "out")


def _places(rng, n):
    return Places(rng.uniform(0, 3000, n), rng.uniform(0, 2 * np.pi, n), rng.uniform(5, 30, n))


@pytest.mark.parametrize("seed", range(5))
def test_an_alignment_is_recovered_among_strays(seed):
    rng = np.random.default_rng(seed)
    kept, extra = _places(rng, 8), _places(rng, 4)
    offset, turn = rng.uniform(-200, 200), rng.uniform(-1, 1)
    later = Places(
        np.concatenate([kept.z_mm - offset + rng.normal(0, 1, 8), extra.z_mm]),
        np.concatenate([kept.theta_rad - turn + rng.normal(0, 0.01, 8), extra.theta_rad]),
        np.concatenate([kept.size_mm, extra.size_mm]),
    )
    laid = lay_over(kept, later, RADIUS_MM)
    assert laid.sure
    assert laid.offset_mm == pytest.approx(offset, abs=1.5)
    assert laid.turn_rad == pytest.approx(turn, abs=0.02)
    assert set(laid.pairs) >= {(k, k) for k in range(8)}


def test_joints_alone_give_the_offset_and_weak_alignments_say_so():
    nothing = np.full(3, np.nan)
    joints = Places(np.array([100.0, 640.0, 1200.0]), nothing, nothing)
    laid = lay_over(joints, joints._replace(z_mm=joints.z_mm - 30), RADIUS_MM)
    assert (laid.offset_mm, laid.turn_rad, laid.sure) == (pytest.approx(30), 0.0, True)
    one = Places(np.array([100.0]), np.array([1.0]), np.array([10.0]))
    assert "one pair alone cannot be checked" in lay_over(one, one, RADIUS_MM).words
    none = Places(*(np.zeros(0) for _ in range(3)))
    assert "no pair of places falls together" in lay_over(one, none, RADIUS_MM).words
    even = Places(np.arange(4) * 100.0, np.ones(4), np.full(4, 10.0))
    three = Places(np.arange(3) * 100.0 + 60, np.ones(3), np.full(3, 10.0))
    assert "another offset would do nearly as well" in lay_over(even, three, RADIUS_MM).words
