"""The registration bench: what a user reads off it, and that it says no more than the frames do."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from algorithms.registration import REGISTRATIONS
from scenarios.bench.errors import pose_error
from scenarios.bench.frame_bench import frame_errors, odometry, two_frames
from scenarios.bench.frames import CASES, LIMIT_CASES, FrameCase, cramer_rao
from scenarios.bench.registration import bench
from scenarios.bench.statistics import interval, pairs, rows, winner_words
from scenarios.document import BadInput
from sensor_model.geometry import apply

SMALL = FrameCase(points=1500)
TWO = {name: REGISTRATIONS[name].settings() for name in ("cylinder-map", "cylinder-variance")}
KEYS = ["method", "level", "frames", "failures", "axis_rms_deg", "center_rms_mm", "radius_rms_mm"]
KEYS += ["crb_ratio_axis", "crb_ratio_center", "crb_ratio_radius", "ms_median"]


def _silent(*_):
    """No progress."""


@pytest.mark.parametrize("name", sorted(CASES))
def test_frames_are_what_their_case_says(name):
    case = CASES[name].model_copy(update={"points": 4000})
    _, frame = two_frames(case, 3)
    wall = apply(frame.T_pipe_camera, frame.exact_mm[frame.on_wall])
    high = np.hypot(wall[:, 0], wall[:, 1]) - case.radius_mm
    assert np.abs(high).max() <= case.ovality_pct / 100 * case.radius_mm + 1e-9
    share = case.defect_share + case.spurious_share * (1 - case.defect_share)
    assert 1 - frame.on_wall.mean() == pytest.approx(share, abs=0.06 if share else 0)
    if case.spurious_share == 0:  # the stated standard deviation is the real one, along the light
        off = frame.points.xyz_mm - frame.exact_mm
        along = np.sum(off * frame.points.direction, axis=1) / frame.points.sigma_mm
        assert np.std(along) == pytest.approx(1, abs=0.05)
        assert np.abs(off - np.sum(off * frame.points.direction, axis=1)[:, None] * frame.points.direction).max() < 1e-9


def test_the_bound_falls_with_points_and_grows_with_noise():
    def bound(**changes):
        return np.array(cramer_rao(two_frames(SMALL.model_copy(update=changes), 0)[1]))

    assert np.allclose(bound(noise_mm=0.3) / bound(noise_mm=0.1), 3)
    assert np.allclose(bound(points=24_000) / bound(), 0.25, rtol=0.1)
    assert (bound(arc_deg=120) > bound()).all()


def test_a_bound_is_no_bound_without_the_right_sigma():
    frames = [two_frames(SMALL, seed)[1] for seed in range(30)]
    method = TWO["cylinder-map"]
    errors = list(frame_errors({"small": SMALL}, {"cylinder-map": method}, 30, 1))
    expected = np.sqrt(np.mean([cramer_rao(frame).center_mm ** 2 for frame in frames]))
    assert np.sqrt(np.mean([e.center_mm**2 for e in errors])) == pytest.approx(expected, rel=0.35)


def test_odometry_tells_travel_and_roll_and_nothing_else():
    T = two_frames(CASES["tilted"], 1)[1].T_pipe_camera
    told = odometry(T)
    off = pose_error(told.T_pipe_camera, T)
    assert off.travel_mm == 0
    assert abs(off.roll_deg) < 0.01
    assert off.axis_deg == pytest.approx(10)
    assert off.center_mm == pytest.approx(10, abs=0.2)
    assert np.flatnonzero(np.diag(told.information)).tolist() == [2, 5]


def test_robust_beats_plain_where_there_is_a_defect_and_the_bench_says_so():
    case = SMALL.model_copy(update={"defect_share": 0.3})
    errors = list(frame_errors({"dug": case}, TWO, 12, 1))
    ours, plain = rows(errors, "frame")
    assert (ours.method, ours.failures) == ("cylinder-map", 0)
    assert plain.failures > 8
    assert ours.crb_ratio_center < 2 < 20 < plain.crb_ratio_center
    (pair,) = pairs(errors)
    assert pair.a_nearer_share == 1
    assert pair.p < 0.01
    assert winner_words(pair) == "cylinder-map is nearer"


def test_a_method_is_not_nearer_than_itself():
    same = {"one": TWO["cylinder-map"], "two": TWO["cylinder-map"]}
    (pair,) = pairs(list(frame_errors({"small": SMALL}, same, 8, 1)))
    assert pair.difference_mm == (0, 0, 0)
    assert winner_words(pair) == "no difference"


def test_the_interval_holds_the_median_as_often_as_it_says():
    rng = np.random.default_rng(0)
    held = [(i := interval(rng.exponential(size=25))).low <= np.log(2) <= i.high for _ in range(600)]
    assert 0.94 < np.mean(held) < 0.995


def test_a_wrong_nominal_radius_moves_no_pose():
    case = FrameCase(points=4000, arc_deg=260)
    wrong = case.model_copy(update={"told_radius_error_pct": 1.0})
    method = {"cylinder-map": TWO["cylinder-map"]}
    right, told = (list(frame_errors({"case": c}, method, 10, 1)) for c in (case, wrong))
    for a, b in zip(right, told, strict=True):
        assert b.center_mm == pytest.approx(a.center_mm, abs=2e-4)
        assert b.radius_mm == pytest.approx(a.radius_mm, abs=2e-4)


def test_a_radius_far_from_the_nominal_one_is_let_go_and_said():
    case = FrameCase(points=4000, told_radius_error_pct=6.0)
    (error,) = frame_errors({"far": case}, {"cylinder-map": TWO["cylinder-map"]}, 1, 1)
    assert error.verdict == "weak"
    assert "the radius is 76.2" in error.reason
    assert error.center_mm < 0.1


def test_the_folder_is_whole_and_the_same_whatever_the_workers(tmp_path):
    for name, workers in (("one", 1), ("two", 2)):
        bench(["clean"], "cylinder-map,cylinder", 3, "frame", ["points=1500"], tmp_path / name, workers, _silent)
    one, two = tmp_path / "one", tmp_path / "two"
    for file in ("rows.csv", "pairs.csv", "frames.csv"):
        assert (one / file).read_bytes() == (two / file).read_bytes()
    with (one / "frames.csv").open() as lines:
        assert len(list(csv.DictReader(lines))) == 6
    assert set(json.loads((one / "run.json").read_text())["ms"]["clean"]) == {"cylinder", "cylinder-map"}
    page = (one / "report.html").read_text()
    assert "cylinder-map" in page
    assert "http" not in page.replace("http-equiv", "")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"names": ["claen"]}, "did you mean clean"),
        ({"methods": "cylinder,icpp"}, "did you mean icp"),
        ({"methods": ","}, "nothing named"),
        ({"changes": ["noise=3"]}, "FIELD=VALUE"),
        ({"changes": ["noise_mm=-1"]}, "noise_mm: got -1"),
    ],
)
def test_bad_input_is_said_in_a_line(tmp_path, given, said):
    asked = {"names": [], "methods": None, "changes": []} | given
    with pytest.raises(BadInput, match=said):
        bench(asked["names"], asked["methods"], 1, "frame", asked["changes"], tmp_path / "out", 1, _silent)
    assert not (tmp_path / "out").exists()


def test_the_command_prints_a_row_a_method(tmp_path):
    command = [sys.executable, "-m", "scenarios.cli", "bench", "registration", "clean", "hard", "--json"]
    options = ["--methods", "cylinder-map", "--seeds", "2", "--set", "points=1500", "-o", str(tmp_path / "b")]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=True, cwd=Path.cwd())
    (row,) = json.loads(done.stdout)
    assert list(row)[: len(KEYS)] == KEYS
    assert (row["method"], row["level"], row["frames"]) == ("cylinder-map", "frame", 4)


def test_the_library_of_cases_is_what_the_bench_promises():
    assert {"clean", "hard", "tilted", "points-200000"} <= set(LIMIT_CASES)
    worst = max(c.defect_share + c.spurious_share * (1 - c.defect_share) for c in CASES.values())
    assert worst == pytest.approx(0.45, abs=0.001)
