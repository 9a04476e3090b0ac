"""The deployment plan: from its limits to a decision that a study of its own size bears out."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from algorithms.trust.exact_bounds import share_of
from scenarios.document import BadInput
from scenarios.plan import studies as module
from scenarios.plan.check import Again, Estimate, Fresh, fresh_pictures, made_again, quantile
from scenarios.plan.conduct import make_plan
from scenarios.plan.findings import Kept, Looks, Scans, all_tolerances, at_most, tolerance
from scenarios.plan.plan_file import load_plan
from scenarios.plan.result import Confirmed, withheld
from scenarios.plan.scans import rows_of, scans_needed
from scenarios.study import conduct as conduct_module
from scenarios.study.conduct import How

ROOT = Path(__file__).resolve().parents[3]
PLAN = """\
name: job
why: A short pipe with pockets and pits.
base: paper-gantry
set: {pipe.end_mm: 600, drive.stages: [{to_mm: 250}]}
vary:
  pipe.ovality_pct: {distribution: uniform, low: 0, high: 0.3}
defects:
  pocket: {kind: pocket, length_mm: [25, 50], width_mm: [15, 30], depth_pct: [2, 80]}
  pit: {kind: pit, diameter_mm: [12, 20], depth_pct: [2, 60]}
stretch_mm: [110, 330]
per_scan: 2
speeds_mm_s: [50, 100]
confirm: 20
limits: {a90_95_pct: 60, depth_error_pct: 10, length_error_mm: 5, seen_share_pct: 80, false_calls_per_m: 2}
"""


@pytest.fixture(autouse=True)
def _apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIPETWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "campaigns"), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setattr(module, "_tried", lambda _: (0.5, 100))
    monkeypatch.setattr(module, "_picture_s", lambda _: 0.1)
    two = {name: module.CAUSES[name] for name in ("ovality", "wheels' build")}
    monkeypatch.setattr(module, "CAUSES", two)
    monkeypatch.setattr(conduct_module, "write_page", lambda *_, **__: None)  # drawn in its own tests


@pytest.fixture
def planned(tmp_path):
    """Make a plan of a text; returns its folder, its result and what was said."""

    def make(text: str = PLAN, out: str = "out", progress=lambda *_: None):
        file = tmp_path / "plan.yaml"
        file.write_text(text)
        said: list[str] = []
        how = How(2, make="standin:planned")
        folder, result = make_plan(file, tmp_path / out, how, progress, said.append)
        return folder, result, said

    return make


def test_the_study_is_as_large_as_the_confidence_needs(tmp_path):
    file = tmp_path / "plan.yaml"
    file.write_text(PLAN)
    assert scans_needed(load_plan(file)) == 60  # 60 of each of two kinds, two a scan
    file.write_text(PLAN.replace("false_calls_per_m: 2", "false_calls_per_m: 0.1"))
    assert scans_needed(load_plan(file)) == 137  # 30 m without a call, 0.22 m a scan


def test_scans_have_their_own_seeds_and_defects_in_the_light(tmp_path):
    file = tmp_path / "plan.yaml"
    file.write_text(PLAN)
    plan = load_plan(file)
    rows = rows_of(plan, 50, 0)
    assert rows == rows_of(plan, 50, 0)
    assert rows != rows_of(plan, 50, 1)
    assert len(set(rows["seed"])) == 50
    for features in rows["pipe.features"]:
        assert [feature["kind"] for feature in features] == ["pocket", "pit"]
        assert all(110 <= feature["distance_mm"] <= 330 for feature in features)
        assert all(18.5 < feature["clock_deg"] < 341.5 for feature in features)
        assert all(feature["depth_mm"] <= 0.8 * 7.5 for feature in features)


@pytest.mark.parametrize("file", sorted((ROOT / "campaigns/plans").glob("*.yaml")), ids=lambda file: file.stem)
def test_the_plans_that_are_measured_can_be_made(file):
    plan = load_plan(file)
    rows = rows_of(plan, scans_needed(plan), 0)
    assert len(rows["seed"]) == 40
    assert plan.file.name == file.stem


def test_a_plan_decides(planned):
    folder, result, said = planned()
    # 60, 20 each at another speed and without ovality, and 20 in pictures
    assert said[0].startswith("120 scans in 4 studies, about ")
    assert {row.limit: row.decision for row in result.kept} == dict.fromkeys((row.limit for row in result.kept), "go")
    assert result.decision == "go"
    depth = result.tolerances[0]
    assert depth.promised == pytest.approx(100 * 0.1 / 7.5)
    assert {one.kind: one.found.n for one in result.detections} == {"pocket": 60, "pit": 60}
    for one in result.detections:
        assert 9 < one.a90_95_pct < 60  # the stand-in misses below 13 % of the wall, give or take 4
    assert [one.speed_mm_s for one in result.speeds] == [50, 100]
    (without,) = result.without
    assert without.cause == "ovality"  # wheels are none of a gantry's
    assert without.change["depth_pct"].mean == 0  # the stand-in knows of no ovality
    written = json.loads((folder / "plan.json").read_text())
    assert written["decision"] == "go"
    assert written["scans"]["done"] == 60
    page = (folder / "plan.html").read_text()
    assert "GO: every limit is shown to be kept." in page
    assert "NOT INSPECTED" in page
    assert written["settings"] in page
    again = planned()[1]  # nothing is left to run
    assert again.tolerances == result.tolerances


def test_a_broken_limit_is_no_go(planned):
    text = PLAN.replace("depth_error_pct: 10", "depth_error_pct: 1").replace("speeds_mm_s: [50, 100]\n", "")
    _, result, _ = planned(text)
    assert result.decision == "no go"
    assert {row.limit: row.decision for row in result.kept}["depth_error_pct"] == "no go"


def test_too_few_scans_leave_it_open(planned):
    text = PLAN.replace("speeds_mm_s: [50, 100]\n", "scans: 6\n")
    folder, result, _ = planned(text)
    assert result.tolerances[0].promised is None
    assert result.decision == "open"
    # a gantry of slit pixels is not what the testbench was held against, and says so where its numbers stand
    assert result.extrapolated == json.loads((folder / "plan.json").read_text())["extrapolated"]
    assert ("EXTRAPOLATED" in (folder / "plan.html").read_text()) == bool(result.extrapolated)


def test_pictures_are_held_against_the_promise_or_make_it(planned):
    folder, result, _ = planned(PLAN.replace("speeds_mm_s: [50, 100]\n", ""))
    inside = {one.what: one.inside for one in result.confirmed}
    assert inside["depth_error_pct"].share == 1
    assert inside["distance_error_pct"].n == 20
    # slit pixels do not agree with pictures in length: it is promised by the pictures' own, and not held against them
    assert "length_error_mm" not in inside
    length = {one.what: one for one in result.tolerances}["length_error_mm"]
    assert length.shown_in == "picture"
    assert 29 <= length.n < 40
    assert "field-dry" in json.loads((folder / "plan.json").read_text())["trust"]
    assert "<td>picture</td>" in (folder / "plan.html").read_text()


def test_pictures_promise_by_themselves_what_they_gainsay(tmp_path):
    file = tmp_path / "plan.yaml"
    file.write_text(PLAN)
    plan = load_plan(file)
    rng = np.random.default_rng(0)

    def scans(n, worse):
        kind, true = np.array(["pocket", "pit"] * n), np.full((2 * n, 3), 20.0)
        off = rng.uniform(-0.1, 0.1, true.shape) * worse
        looks = Looks(kind, np.full(2 * n, 30.0), true, true + off, np.repeat(np.arange(n), 2))
        return Scans(
            looks, {"distance_error_pct": rng.uniform(0, 0.1, n), "roll_rms_deg": rng.uniform(0, 0.1, n)}, {}, 1.0
        )

    cheap, like, worse, few = scans(60, 1), scans(20, 1), scans(20, 1.3), scans(5, 4)
    depth = {one.what: one for one in all_tolerances(plan, cheap, like)}["depth_error_pct"]
    assert (depth.shown_in, depth.n) == ("points", 120)
    depth = {one.what: one for one in all_tolerances(plan, cheap, worse)}["depth_error_pct"]
    assert (depth.shown_in, depth.n) == ("picture", 40)
    errors = 100 * np.abs(worse.looks.measured_mm - worse.looks.true_mm)[:, 2] / plan.scene.pipe.wall_mm
    assert depth.promised in errors
    assert np.mean(errors <= depth.promised) > 0.95
    depth = {one.what: one for one in all_tolerances(plan, cheap, few)}["depth_error_pct"]
    assert depth.shown_in == "points"  # too few to promise anything; the limit is open if they break it


def test_a_promise_that_pictures_break_decides_nothing():
    kept = [Kept("depth_error_pct", 10.0, 3.0, 4.0, "go"), Kept("width_error_mm", 3.0, 1.0, 2.0, "go")]
    broken = [Confirmed("depth_error_pct", 4.0, share_of(5, 30)), Confirmed("width_error_mm", 2.0, share_of(26, 30))]
    assert [row.decision for row in withheld(kept, broken, 0.9)] == ["open", "go"]


def test_an_interrupted_plan_goes_on(planned):
    """Nothing looks whole before it is, and the end is that of a plan that was never stopped."""
    whole, _, _ = planned(out="whole")
    reported: list[int] = []

    def stop(stage: str, done: int, total: int) -> None:
        reported.append(done)
        if len(reported) == 40:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        planned(out="parts", progress=stop)
    assert not (whole.parent / "parts" / "plan.html").exists()
    begun = len(reported)
    parts, _, _ = planned(out="parts", progress=lambda *_: reported.append(0))
    assert begun == 40
    assert (parts / "plan.json").read_bytes() == (whole / "plan.json").read_bytes()


def test_a_plan_is_held_against_itself(planned, tmp_path, monkeypatch):
    monkeypatch.setattr("scenarios.plan.page.write_page", lambda *_: None)
    monkeypatch.setattr(module, "CAUSES", {})
    folder, _, _ = planned(PLAN.replace("speeds_mm_s: [50, 100]\n", "scans: 40\n"))
    plan, how = load_plan(tmp_path / "plan.yaml"), How(1, make="standin:planned")
    twice = {one.what: one for one in made_again(plan, folder, 7, how, lambda *_: None, lambda _: None)}
    assert all(one.agree for one in twice.values())
    width = twice["width_error_mm, 90 % within"]
    assert (width.first.value, width.second.value) == pytest.approx((0.3, 0.3))
    (deep,) = (one for what, one in twice.items() if what.startswith("found, pit from"))
    assert deep.first != deep.second  # other seeds, other defects
    fresh = fresh_pictures(plan, folder, 16, how, lambda *_: None, lambda _: None)
    inside = {one.what: one for one in fresh}
    assert inside["width_error_mm"].inside.counted == inside["width_error_mm"].inside.n > 20
    assert inside["roll_error_deg"].inside.n == 16
    assert all(one.kept for one in fresh)
    with pytest.raises(BadInput, match="the plan's own seed"):
        made_again(plan, folder, 0, how, lambda *_: None, lambda _: None)
    with pytest.raises(BadInput, match="holds no plan; `pipetwin plan"):
        fresh_pictures(plan, tmp_path / "elsewhere", 16, how, lambda *_: None, lambda _: None)


def test_figures_agree_as_far_as_their_intervals_reach():
    rng = np.random.default_rng(0)
    pairs = [[quantile(np.sort(np.abs(rng.standard_normal(60))), 0.9, 0.95) for _ in range(2)] for _ in range(300)]
    held = np.mean([one.low <= 1.645 <= one.high for pair in pairs for one in pair])
    assert 0.94 < held < 0.99
    assert np.mean([Again("x", *pair).agree for pair in pairs]) > 0.93
    assert not Again("x", Estimate(1.0, 0.9, 1.2), Estimate(2.0, 1.5, 2.3)).agree
    assert not Fresh("x", 1.0, 0.9, share_of(40, 60)).kept
    assert quantile(np.arange(20.0), 0.9, 0.95).high == np.inf  # too few for an end


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("time_limit_min: 30\n", "time_limit_min: 0.1\n", r"got 0\.1; 120 scans in 4 studies, about 2\.\d min"),
        ("a90_95_pct: 60", "a90_95_pct: 1", r"limits\.a90_95_pct: .*outside the depths 2 to 80 %"),
        ("seen_share_pct: 80", "seen_share_pct: 95", "the strut alone hides 10"),
        (
            "confirm: 20",
            "confirm: 14",
            r"length_error_mm: got 5; .*in `points` .*confirm: 15 or more",
        ),
        ("speeds_mm_s: [50, 100]", "speeds_mm_s: [50]\nconfidence: 2", r"confidence: got 2"),
        ("false_calls_per_m: 2}", "minutes_per_m: 0.1}", "contradicts the speeds: at 100 mm/s"),
        ("kind: pit", "kind: crack", r"defects\.pit\.kind"),
        ("diameter_mm: [12, 20]", "diameter_mm: [20, 12]", r"a range \[low, high\]"),
        ("depth_pct: [2, 60]", "depth_mm: 3", "state the depth as depth_pct"),
        ("kind: pit,", "kind: {a: 1},", r"defects\.pit\.kind: got .*; must be one of"),
        ("per_scan: 2", "per_scan: 4", "does not fit into"),
        (
            "diameter_mm: [12, 20]",
            "diameter_mm: [8, 20]",
            r"defects\.pit: got .*4\.5 mm deep; .*at most half its diameter",
        ),
        ("pipe.ovality_pct:", "pipe.ovalty_pct:", "pipe.ovalty_pct"),
        ("base: paper-gantry", "base: nowhere", "no such scenario"),
    ],
)
def test_bad_plans_say_where(planned, old, new, said):
    text = PLAN + "time_limit_min: 30\n"
    assert old in text
    with pytest.raises(BadInput, match=said):
        planned(text.replace(old, new))


def test_a_scene_that_cannot_be_scanned_is_said_with_its_line(planned, monkeypatch):
    def too_big(_) -> None:
        raise ValueError("the robot does not fit")

    monkeypatch.setattr(module, "_tried", too_big)
    with pytest.raises(BadInput, match=r"plan\.yaml:3:7: base: cannot be scanned: the robot does not fit"):
        planned()


def test_a_tolerance_limit_holds_as_often_as_it_says():
    rng = np.random.default_rng(0)
    quantile = 1.6448536269514722  # of the size of a standard normal's draw, 90 %
    limits = [tolerance("x", rng.standard_normal(60), 0.9, 0.95).promised for _ in range(2000)]
    exact = binom.cdf(binom.ppf(0.95, 60, 0.9), 60, 0.9)
    assert np.mean(np.array(limits) >= quantile) == pytest.approx(exact, abs=0.01)
    assert exact >= 0.95
    assert tolerance("x", rng.standard_normal(28), 0.9, 0.95).promised is None  # 29 are the fewest
    assert tolerance("x", rng.standard_normal(29), 0.9, 0.95).promised is not None


@pytest.mark.parametrize(
    ("found", "bound", "decision"),
    [(1.0, 2.0, "go"), (1.0, 4.0, "open"), (4.0, 5.0, "no go"), (None, None, "open"), (1.0, None, "open")],
)
def test_limits_are_decided_by_their_bounds(found, bound, decision):
    assert at_most("x", 3.0, found, bound).decision == decision
