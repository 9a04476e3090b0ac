"""`pipetwin calibrate slide`: a jagged slide is learned from a scan's own wall; a smooth one, or a groove, is not."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from algorithms.calibration.pipe_view import fit_cylinder
from algorithms.calibration.slide import with_jag
from algorithms.calibration.slide_in_scan import CELLS, clean_means, learn_slide_from_scan, radius_per_rad
from algorithms.triangulate import triangulate
from scenarios.calibration.rig_file import write_rig
from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.run import run
from sensor_model.geometry import apply, jag_rad, projector_azimuth_rad
from sensor_model.points import PointNoise, see_slits
from sensor_model.rig import Rig, load_settings, preset_rig
from twin.pipe import Pipe

RIG = preset_rig()
# 300 cells around: over so much does the print of a real slide stay alike
JAG_RAD = np.radians(0.12) * np.random.default_rng(5).standard_normal((8, 300))
PITS = ", ".join(
    f"{{kind: pit, distance_mm: {200 + 25 * (k % 2)}, clock_deg: {clock}, diameter_mm: 16, depth_mm: 4}}"
    for k, clock in enumerate((60, 100, 140, 220, 260, 300))
)
GROOVE = {
    "kind": "pocket",
    "distance_mm": 250,
    "clock_deg": 120,
    "length_mm": 1000,
    "width_mm": 12,
    "depth_mm": 2,
}


def _run(folder, jag_rad):
    changes = ["sensing.fidelity=points", "sensing.frame_rate_hz=10", "drive.stages=[{to_mm: 300}]"]
    scenario = load_scenario("paper-gantry", [*changes, f"pipe.features=[{PITS}]"])
    if jag_rad is not None:
        scenario = scenario.model_copy(update={"true_rig": with_jag(RIG, jag_rad)})
    run(scenario, folder, 1, lambda *_: None)
    return folder


def _at_cells(table_rad):
    """A table between its own cells, where the learned one's middles are."""
    azimuth = (np.arange(CELLS) + 0.5) * 2 * np.pi / CELLS
    return np.array([jag_rad(table_rad, np.full(CELLS, slit), azimuth) for slit in range(len(table_rad))])


def _learned(folder, out):
    result = CliRunner().invoke(app, ["calibrate", "slide", str(folder), "--out", str(out), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), load_settings(Rig, out)


@pytest.fixture(scope="module")
def smooth(tmp_path_factory):
    return _run(tmp_path_factory.mktemp("smooth") / "run", None)


def test_a_jagged_slide_is_learned_from_the_scan_s_own_wall(smooth, tmp_path):
    said, learned = _learned(_run(tmp_path / "run", JAG_RAD), tmp_path / "rig.yaml")
    assert said["correction_kept"]
    assert said["weak"] == ""
    assert said["residual_corrected_mm"] < said["residual_mm"] / 3
    before, after = said["scan"], said["scan_corrected"]
    assert after["map_rms_mm"] < before["map_rms_mm"] / 3
    # the pits are bowls, of whose depth something is open with any slide: what the jag adds to that is gone
    open_mm = json.loads((smooth / "score.json").read_text())["depth_error_mm_max"]
    assert after["depth_error_mm_max"] - open_mm < (before["depth_error_mm_max"] - open_mm) / 3
    assert (after["defects_found"], after["false_calls"]) == (6, 0)
    known = np.isfinite(learned.projector.jag_table_rad)
    assert known.mean() > 0.8
    off = (learned.projector.jag_table_rad - _at_cells(JAG_RAD))[known]
    assert np.std(off) < 0.15 * np.std(JAG_RAD)
    assert (tmp_path / "rig-slide.html").read_text().count("<img") == 1


def test_a_smooth_slide_is_left_as_it_is(smooth, tmp_path):
    said, learned = _learned(smooth / "recording", tmp_path / "rig.yaml")
    assert not said["correction_kept"]
    assert said["residual_corrected_mm"] < 1.02 * said["residual_mm"]
    assert learned == RIG


def test_a_groove_along_the_pipe_is_not_taken_for_the_slide():
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, start_mm=-400, end_mm=900, features=[GROOVE])
    true = with_jag(RIG, 0.5 * JAG_RAD)
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, 2, 3] = np.linspace(0, 300, 40)
    rng = np.random.default_rng(2)
    found = learn_slide_from_scan([see_slits(pipe, pose, true, PointNoise(), rng) for pose in poses], RIG)
    assert found.helps
    groove = np.flatnonzero(found.alike_mm)
    assert groove.min() >= 2 * 110
    assert groove.max() < 2 * 130
    assert np.abs(found.alike_mm).max() == pytest.approx(2.0, abs=0.6)
    floor = slice(2 * 117, 2 * 123)  # taken for the slide, the groove makes 0.21 degrees
    assert abs(np.degrees(np.mean((found.table_rad - _at_cells(0.5 * JAG_RAD))[:, floor]))) < 0.05


def test_what_is_no_scan_is_said(smooth, tmp_path):
    out = tmp_path / "rig.yaml"
    for folder in (tmp_path, smooth / "truth"):
        result = CliRunner().invoke(app, ["calibrate", "slide", str(folder), "--out", str(out)])
        assert result.exit_code != 0
        assert str(folder) in str(result.exception)
    assert not out.exists()
    frames = smooth / "recording" / "cam0" / "data.csv"
    text = frames.read_text()
    try:
        frames.write_text("\n".join(text.splitlines()[:12]) + "\n")
        result = CliRunner().invoke(app, ["calibrate", "slide", str(smooth / "recording"), "--out", str(out)])
    finally:
        frames.write_text(text)
    assert isinstance(result.exception, BadInput)
    assert "11 frames with a pipe in them; at least 16 are needed" in str(result.exception)


def test_the_lever_of_a_half_angle_is_the_difference_it_makes():
    pipe, pose = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5), np.eye(4)
    pose[:2, 3] = 6.0, -4.0
    exact = PointNoise(pixel_noise_px=0, drop_out_share=0, azimuths=360)
    seen = see_slits(pipe, pose, RIG, exact, np.random.default_rng(0))
    points = triangulate(seen, RIG)
    alignment = fit_cylinder(points)
    radii = [
        np.linalg.norm(
            apply(alignment.T_pipe_camera, triangulate(seen, with_jag(RIG, np.full((8, 1), h))).xyz_mm)[:, :2], axis=1
        )
        for h in (np.radians(-0.02), np.radians(0.02))
    ]
    lever = (radii[1] - radii[0]) / np.radians(0.04)
    np.testing.assert_allclose(radius_per_rad(points, alignment, RIG), lever, rtol=1e-3)


def test_what_passes_by_a_place_is_cut():
    rng = np.random.default_rng(1)
    place = np.repeat(np.arange(0, 2 * CELLS, 2), 40)
    excess = 0.01 * (place == 40) + 1e-4 * rng.standard_normal(place.size)
    passing = rng.random(place.size) < 0.2
    mean, clean, known = clean_means(np.where(passing, excess + 0.005, excess), place, 2 * CELLS)
    assert not clean[passing].any()
    assert mean[40] == pytest.approx(0.01, abs=1e-4)
    assert np.abs(np.delete(mean, 40)).max() < 1e-4
    assert known[::2].all()
    assert not known[1::2].any()


def test_no_point_is_made_where_the_slide_is_not_known(tmp_path):
    table = np.zeros((8, 360))
    table[:, 100:110] = np.nan
    write_rig(with_jag(RIG, table), tmp_path / "rig.yaml")
    rig = load_settings(Rig, tmp_path / "rig.yaml")
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, start_mm=-400, end_mm=900)
    seen = see_slits(pipe, np.eye(4), rig, PointNoise(), np.random.default_rng(0))
    with_all, without = (
        np.degrees(projector_azimuth_rad(triangulate(seen, one).xyz_mm, one.projector.T_camera_projector)) % 360
        for one in (RIG, rig)
    )
    assert np.count_nonzero((with_all > 100) & (with_all < 110)) > 100
    assert not np.any((without > 100) & (without < 110))
    kept, all_kept = (one[np.abs(one - 105) > 6] for one in (without, with_all))
    np.testing.assert_allclose(kept, all_kept)
