"""The paper's table and figures made again: what the rows say, and what the folders hold."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from algorithms.registration import CylinderMapSettings, CylinderSettings
from scenarios.bench import contenders
from scenarios.bench.clouds import TIMES, stretched
from scenarios.bench.scans import take_scan, triangulated
from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.paper import fig5, fig7, fig11, table1

SHORT = [
    "sensing.fidelity=points",
    "sensing.frame_rate_hz=4",
    "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 60, width_mm: 35, depth_mm: 7.5}]",
    "drive.stages=[{to_mm: 40, roll_to_deg: 25}, {to_mm: 90}]",
]
WIDER = "true_rig.projector.apex_mm=[0.4, 0, -53.5]"


def quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""


def rows_of(*changes: str):
    return {row["method"]: row for row in table1.table1(load_scenario("paper-gantry", [*SHORT, *changes]), 1, quiet)}


@pytest.fixture(scope="module")
def rows():
    return rows_of()


def test_true_poses_have_no_error_and_do_not_win_the_papers_figures(rows):
    true = rows[table1.TRUE_POSES]
    for key in ("axis_rms_deg", "center_rms_mm", "roll_rms_deg", "distance_error_pct", "failures"):
        assert true[key] == 0
    others = [row for row in rows.values() if row is not true]
    assert min(row["center_variance_mm2"] for row in others) < true["center_variance_mm2"]
    assert min(row["radius_closeness_pct"] for row in others) < true["radius_closeness_pct"]


def test_without_defect_points_the_true_poses_show_the_bore(rows):
    true = rows[table1.TRUE_POSES]
    assert true["radius_closeness_wall_pct"] < 0.01 < true["radius_closeness_pct"]
    assert true["center_variance_wall_mm2"] < 1e-3


def test_ours_keeps_what_is_asked_of_it_and_the_plane_start_does_not(rows):
    said = table1.targets(list(rows.values()))
    assert len(said) == 6
    assert all(line.endswith("holds") for line in said)
    lost = rows[contenders.ICP_PLANE]
    assert lost["failures"] == lost["frames"]
    assert lost["axis_rms_deg"] > 5


def test_the_papers_row_stands_beside_ours(rows):
    assert rows["cylinder"]["paper_radius_closeness_pct"] == 0.95
    assert rows["ellipsoid"]["paper_center_variance_mm2"] == 1.507
    assert "paper_normal_variance" not in rows["cylinder-map"]
    words = table1.words(list(rows.values()))
    assert "9.112" in words
    assert "cannot rank" in words


def test_a_wrong_calibration_shows_and_a_new_one_mends_it(rows):
    wrong = rows_of(WIDER)
    ours, mended = wrong["cylinder-map"], wrong[table1.CALIBRATED]
    assert ours["radius_closeness_wall_pct"] > 0.2 > 10 * rows["cylinder-map"]["radius_closeness_wall_pct"]
    assert mended["radius_closeness_wall_pct"] < 0.05
    assert any(line.endswith("MISSED") for line in table1.targets(list(wrong.values())))


def test_what_grows_is_one_thing_at_a_time():
    base = load_scenario("paper-gantry")
    levels = list(table1.grown(base))
    assert [what for what, _, _ in levels].count("noise") == 3
    assert {what for what, _, _ in levels} == {"nothing", "noise", "calibration error", "ovality", "defects"}
    assert all(scenario.sensing.fidelity == "points" for _, _, scenario in levels)
    largest = levels[-1][2].pipe.features[0]
    assert largest.length_mm == 2.5 * base.pipe.features[0].length_mm


def test_table1_comes_as_files_that_say_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(table1, "contenders", lambda: {"cylinder-map": CylinderMapSettings()})
    monkeypatch.setattr(
        table1, "load_scenario", lambda name, changes, seed: load_scenario(name, [*changes, *SHORT], seed)
    )
    rows = table1.run_table1("points", 2, False, tmp_path / "t", 1, quiet)
    assert json.loads((tmp_path / "t" / "table1.json").read_text()) == rows
    assert (tmp_path / "t" / "table1.csv").read_text().splitlines()[1].startswith("cylinder-map,")
    first = (tmp_path / "t" / "table1.json").read_bytes()
    table1.run_table1("points", 2, False, tmp_path / "t", 1, quiet)
    assert (tmp_path / "t" / "table1.json").read_bytes() == first


@pytest.fixture(scope="module")
def isolated(tmp_path_factory):
    out = tmp_path_factory.mktemp("paper") / "fig5"
    return fig5.run_fig5("points", None, out, 1, quiet), out


def test_ransac_sets_the_deep_defect_apart(isolated):
    rows, out = isolated
    for row in rows:
        assert row["defect_inlier"] == 0
        assert row["recall_pct"] == 100
        assert row["precision_pct"] > 85
    assert json.loads((out / "fig5.json").read_text()) == rows
    assert (out / "fig5.png").read_bytes().startswith(b"\x89PNG")


def test_the_truth_of_a_point_is_the_wall_that_its_light_meets():
    scan = take_scan(load_scenario("paper-gantry", [*fig5.CHANGES, "sensing.fidelity=points"]), 1, quiet)
    points = triangulated(scan)
    depth = fig5.true_depth_mm(scan, len(points) - 1, points[-1])
    assert depth.max() == pytest.approx(fig5.DEPTH_MM, abs=1e-3)
    assert np.abs(fig5.true_depth_mm(scan, 0, points[0])).max() < 1e-6


def test_a_confusion_counts_every_point_once():
    inliers, defect = np.array([True, True, False, False, False]), np.array([True, False, True, True, False])
    row = fig5.confusion("m", inliers, defect)
    assert [row[key] for key in fig5.KEYS] == [2, 1, 1, 1]
    assert row["recall_pct"] == pytest.approx(200 / 3)
    none = fig5.confusion("m", np.ones(3, dtype=bool), np.zeros(3, dtype=bool))
    assert none["precision_pct"] is none["recall_pct"] is None


def test_fig11_shows_a_cloud_a_method(monkeypatch):
    monkeypatch.setattr(fig11, "METHODS", {"cylinder": CylinderSettings(), "cylinder-map": CylinderMapSettings()})
    scan = take_scan(load_scenario("paper-gantry", SHORT), 1, quiet)
    found = list(fig11.clouds(scan, quiet))
    assert [cloud.method for cloud in found] == ["cylinder", "cylinder-map"]
    assert all(len(cloud.xyz_mm) > 10_000 and len(cloud.frame_mm) > 1000 for cloud in found)
    assert fig11.picture(scan, found).startswith(b"\x89PNG")


def test_small_deviations_are_drawn_larger_and_large_ones_as_they_are():
    turn = np.linspace(0, 6, 50)
    ring = np.column_stack([np.cos(turn), np.sin(turn), turn])
    near, far = ring * [77.0, 77.0, 1.0], ring * [120.0, 120.0, 1.0]
    times, drawn, off = stretched(near, 76.0)
    assert times == TIMES
    assert np.allclose(off, 1)
    assert np.allclose(np.hypot(drawn[:, 0], drawn[:, 1]), 76.0 + times)
    times, drawn, _ = stretched(far, 76.0)
    assert times == 1
    assert np.allclose(drawn, far)


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path):
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(BadInput, match="no pipetwin run"):
        fig11.run_fig11("points", None, tmp_path, 1, quiet)
    assert (tmp_path / "letter.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "command",
    [
        ["paper", "table1", "--fidelity", "blurry"],
        ["paper", "fig5", "-o", "/dev/null"],
        ["bench", "artefacts", "--reference", "/dev/null"],
    ],
)
def test_bad_input_ends_with_status_2_and_a_word(command):
    ran = subprocess.run([sys.executable, "-m", "scenarios.cli", *command], capture_output=True, text=True)
    assert ran.returncode == 2
    assert command[-1] in ran.stderr
    assert "Traceback" not in ran.stderr


def test_fig7_finds_mount_lag_and_drift_and_errs_as_the_real_log_does(tmp_path):
    for seed in (0, 1):
        found = fig7.run_fig7(seed, tmp_path / "fig7")  # the second replaces the first
        # what `calibrate imu` leaves of the published log, on blocks of rows that had no part in the fit
        assert found["rmse_rad"] == pytest.approx([0.0069, 0.0086, 0.0062], rel=0.25)
        assert found["lag_rows"] == pytest.approx(fig7.LAG_ROWS, abs=0.2)
        assert found["heading_drift_deg"] == pytest.approx(fig7.HEADING_DRIFT_DEG, rel=0.2)
        assert found["mount_error_deg"] < 0.3
        assert max(found["rmse_without_heading_drift_rad"]) > 3 * max(found["rmse_rad"])
    assert (tmp_path / "fig7" / "fig7-imu.html").read_text().count("<img") == 1
