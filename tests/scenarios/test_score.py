"""Scoring: defects matched one to one, misses and false calls counted, poses and map compared with the truth."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from algorithms.types import Defect
from scenarios.load import load_scenario
from scenarios.matching import match
from scenarios.score import MEANINGS, Score, placed, pose_errors, score, true_slits
from sensor_model import raycast
from sensor_model.geometry import apply, fisheye_project, fisheye_rays, half_angle_rad, wall_angle_rad, wrap_rad
from sensor_model.glass import Glass
from sensor_model.optics import Optics
from sensor_model.water import Water
from twin.pipe import Pipe


@pytest.fixture
def scan(small_scan):
    return small_scan.truth, small_scan.found, small_scan.tally


def test_every_figure_has_a_meaning():
    assert [field.name for field in fields(Score)] == list(MEANINGS)


def test_a_good_scan_scores_well(scan):
    truth, found, tally = scan
    row = score(found, truth, tally)
    assert (row.defects_true, row.defects_found, row.false_calls) == (1, 1, 0)
    assert row.center_rms_mm < 0.05
    assert row.tilt_rms_deg < 0.02
    assert row.wrong_words == 0
    assert row.frames == row.frames_registered
    assert row.radius_closeness_wall_pct < 0.01 < row.radius_closeness_pct
    assert row.clock_spread_deg is None  # one defect alone shares its clock position with none


def test_a_displaced_estimate_is_charged_to_the_axis_it_belongs_to(scan):
    truth, found, tally = scan
    path = found.trajectory
    moved = path.T_pipe_camera.copy()
    moved[:, 0, 3] += 0.3
    moved[:, 2, 3] *= 1.01
    worse = score(replace(found, trajectory=replace(path, T_pipe_camera=moved)), truth, tally)
    assert worse.center_rms_mm == pytest.approx(0.3, abs=0.05)
    assert worse.distance_error_pct == pytest.approx(1.0, abs=0.05)
    assert worse.tilt_rms_deg == score(found, truth, tally).tilt_rms_deg
    assert pose_errors(found, truth).center_mm.shape == (path.registered.sum(), 2)


def _call(distance, theta_deg):
    return Defect(distance - 20.0, 40.0, 30.0, 5.0, np.radians(theta_deg), 66.0, 0.4, 0.5, 0.1, 2.6, 0.0, 500, False)


def test_misses_and_false_calls(scan):
    truth, found, tally = scan
    near, far = _call(152, 121), _call(60, 121)
    assert match(truth.pipe, (far, near)) == [(0, 1)]
    assert match(truth.pipe, (_call(150, 300),)) == []
    assert match(truth.pipe, ()) == []
    # two calls on one defect: the nearer is the find, the other a false call
    row = score(replace(found, defects=(_call(160, 120), near)), truth, tally)
    assert (row.defects_found, row.false_calls) == (1, 1)
    assert row.length_error_mm_max == 0
    row = score(replace(found, defects=()), truth, tally)
    assert (row.defects_found, row.depth_error_mm_max, row.eq32_quality_pct) == (0, None, None)


def test_a_floor_that_was_not_seen_is_no_depth_error_but_its_least_depth_is_judged(scan):
    truth, found, tally = scan
    depth = truth.pipe.features[0].depth_mm
    least = replace(_call(152, 121), depth_mm=depth - 1.0, floor_seen=False)
    row = score(replace(found, defects=(least,)), truth, tally)
    assert (row.floors_not_seen, row.at_least_wrong, row.depth_error_mm_max) == (1, 0, None)
    beyond = replace(least, depth_mm=depth + 1.0)
    assert score(replace(found, defects=(beyond,)), truth, tally).at_least_wrong == 1


def test_wrong_words_are_seen(scan):
    truth, _, _ = scan
    rig = load_scenario("paper-gantry").rig
    from sensor_model.points import PointNoise, see_slits

    T = truth.pose_at(np.array([1.0]))[0]
    seen = see_slits(truth.pipe, T, rig, PointNoise(pixel_noise_px=0), np.random.default_rng(0))
    assert np.array_equal(true_slits(truth.pipe, rig, seen.pixel, T), seen.slit)
    center = np.array([rig.camera.cx_px, rig.camera.cy_px])
    between = center + (seen.pixel[seen.slit == 3] - center) * 1.06
    assert (true_slits(truth.pipe, rig, between, T) == -1).mean() > 0.9


@pytest.mark.parametrize("water", [Water(), Water(depth_mm=15, absorption_per_m=0)], ids=["glass", "glass and water"])
def test_the_slit_of_a_pixel_is_told_through_glass_and_water_as_the_ray_caster_draws_them(water):
    rig, T = load_scenario("paper-gantry").rig, np.eye(4)
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
    glass = Glass(thickness_mm=1.5, offset_mm=(1.0, -0.7), tilt_deg=(1.0, -0.5), ghost=0)
    optics = Optics.ideal().model_copy(update={"glass": glass, "water": water})
    picture = raycast.draw(pipe, T, rig, optics).max(axis=2)
    v, u = (grid.ravel() for grid in np.mgrid[700:1200:3, 500:1164:3])
    off_px = np.hypot(u - rig.camera.cx_px, v - rig.camera.cy_px)
    u, v = u[(off_px > 240) & (off_px < 480)], v[(off_px > 240) & (off_px < 480)]  # between the first slit and the last
    dark, pixel = picture[v, u] < 0.03, np.stack([u, v], axis=1).astype(float)
    narrow = rig.projector.model_copy(update={"slit_width_deg": 0.6 * rig.projector.slit_width_deg})
    scored = rig.model_copy(update={"projector": narrow})  # which tells slits to 1.2 of their own width
    told = true_slits(pipe, scored, pixel, T, optics) >= 0
    assert 0.03 < dark.mean() < 0.3
    assert np.mean(told[dark]) > 0.99
    assert np.mean(dark[told]) > 0.6
    assert np.mean((true_slits(pipe, scored, pixel, T) >= 0)[dark]) < 0.95


def test_true_slits_agree_with_plain_numpy(scan):
    truth, _, _ = scan
    rig = load_scenario("paper-gantry").rig
    T, rng = truth.pose_at(np.array([0.5]))[0], np.random.default_rng(3)
    pixel = rng.uniform(0, 1, (4000, 2)) * [rig.camera.width_px - 1, rig.camera.height_px - 1]
    rays = fisheye_rays(pixel, rig.camera.intrinsics) @ T[:3, :3].T
    plain = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, start_mm=-50, end_mm=300)
    a, b, c = np.sum(rays[:, :2] ** 2, axis=1), rays[:, :2] @ T[:2, 3], T[:2, 3] @ T[:2, 3] - 76.2**2
    wall = T[:3, 3] + ((-b + np.sqrt(b * b - a * c)) / a)[:, None] * rays
    projector = rig.projector
    apex, axis = np.array(projector.apex_mm), projector.T_camera_projector[:3, 2]
    off = np.abs(half_angle_rad((wall - T[:3, 3]) @ T[:3, :3], apex, axis)[:, None] - projector.slit_half_angles_rad)
    shown = (off.min(axis=1) <= np.radians(projector.slit_width_deg)) & (wall[:, 2] > -50) & (wall[:, 2] < 300)
    assert 0.1 < shown.mean() < 0.9
    assert np.array_equal(true_slits(plain, rig, pixel, T), np.where(shown, off.argmin(axis=1), -1))


def test_a_pixel_at_a_rim_shows_either_side_of_it():
    rig, T = load_scenario("paper-gantry").rig, np.eye(4)
    alpha = rig.projector.slit_half_angles_rad[4]
    rim = 76.2 / np.tan(alpha) - 53.0
    pocket = {
        "kind": "pocket",
        "distance_mm": rim + 31,
        "clock_deg": 120,
        "length_mm": 60,
        "width_mm": 40,
        "depth_mm": 7,
    }
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=[pocket])
    theta = np.radians(120)
    on_rim = np.array([[76.2 * np.sin(theta), -76.2 * np.cos(theta), rim - 0.05]])
    pixel = fisheye_project(on_rim, rig.camera.intrinsics)
    center = np.array([rig.camera.cx_px, rig.camera.cy_px])
    inward = (center - pixel) / np.linalg.norm(center - pixel)
    assert [int(true_slits(pipe, rig, pixel + px * inward, T)[0]) for px in (0.0, 0.9, 3.0)] == [4, 4, -1]


def test_scoring_edits_nothing(scan):
    truth, found, tally = scan
    before = (found.wall.radius_mm.copy(), found.trajectory.T_pipe_camera.copy(), truth.position_mm.copy())
    score(found, truth, tally)
    after = (found.wall.radius_mm, found.trajectory.T_pipe_camera, truth.position_mm)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True))


def test_points_are_placed_with_those_near_a_defect_last(scan):
    rng, T = np.random.default_rng(0), scan[0].pose_at(np.array([1.0]))[0]
    turn = rng.uniform(0, 2 * np.pi, 500)
    xyz = np.column_stack([76 * np.sin(turn), -76 * np.cos(turn), rng.uniform(0, 200, 500)])
    kept, outlines = (
        rng.random(500) < 0.8,
        np.array([[T[2, 3] + 60, 0.1, 40.0, 30.0], [T[2, 3] + 150, 3.0, 30.0, 20.0]]),
    )

    there = apply(T, xyz[kept])
    theta = wall_angle_rad(there[:, 0], there[:, 1])
    off = [np.abs(there[:, 2] - z) < length for z, _, length, _ in outlines]
    arc = [np.abs(wrap_rad(theta - middle)) * 76.2 < width for _, middle, _, width in outlines]
    near = (off[0] & arc[0]) | (off[1] & arc[1])
    found, walls = placed(xyz, kept, T, outlines, 76.2)
    assert 0 < walls == np.count_nonzero(~near) < near.size
    assert found[:walls] == pytest.approx(there[~near], abs=1e-12)
    assert found[walls:][::-1] == pytest.approx(there[near], abs=1e-12)
