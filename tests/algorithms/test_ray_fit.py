"""The compiled core of the cylinder fits, held against plain numpy; what the likeliest cylinder does with its prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from algorithms.registration import REGISTRATIONS
from algorithms.registration.cylinder_pose import (
    axis_of,
    information_of_axis,
    information_of_pose,
    looseness,
    pose_of,
    without,
)
from algorithms.registration.from_axis import radii_information
from algorithms.registration.fusion import covariance
from algorithms.registration.ray_fit import (
    across,
    moved,
    normal_matrix,
    pack,
    pull,
    residuals,
    solve,
    tightest_half,
)
from algorithms.registration.wall_cells import find_cells, is_wall
from algorithms.types import Alignment, RingPoints, Wall
from scenarios.bench.frame_bench import odometry, two_frames
from scenarios.bench.frames import FrameCase
from sensor_model.recording import NominalPipe

NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)


def _frame(**changes):
    return two_frames(FrameCase(points=3000, **changes), 5)[1]


def _packed(points):
    packed, finite = pack(points.xyz_mm, points.direction, points.sigma_mm, 0, points.sigma_mm.size, 1)
    assert finite
    return packed


def _cylinder(oval=(0.0, 0.0)):
    axis = np.array([0.03, -0.05, 1.0])
    return np.concatenate([[3.0, -2.0, 115.0], axis / np.linalg.norm(axis), [76.0], oval])


def _beyond(points, cylinder):
    """How far each point must go back along its ray to the wall, by root finding, in its standard deviations."""
    frame = np.array(across(cylinder)).reshape(2, 3)

    def gap(t, p, d):
        x, y = frame @ (p + t * d - cylinder[:3])
        turn = np.array([x * x - y * y, 2 * x * y]) @ cylinder[7:] / (x * x + y * y)
        return np.hypot(x, y) - cylinder[6] - turn

    rows = zip(points.xyz_mm, points.direction, points.sigma_mm, strict=True)
    return np.array([-brentq(gap, -60, 60, args=(p, d)) / s for p, d, s in rows])


def test_residuals_are_the_way_along_the_ray():
    frame, out = _frame(noise_mm=0.5), np.empty(3000)
    residuals(_packed(frame.points), _cylinder(), out)
    assert np.allclose(out, _beyond(frame.points, _cylinder()), atol=1e-7)


def test_residuals_of_an_oval_wall_vanish_on_it():
    frame, out, round_out = _frame(noise_mm=0.0, ovality_pct=1.0, tilt_deg=0.0, offset_mm=0.0), *np.empty((2, 3000))
    T = frame.T_pipe_camera
    turn = 2 * np.arctan2(T[1, 0], T[0, 0])  # of the pipe's frame against the camera's: swell is -cos 2t in the pipe's
    oval = 0.762 * np.array([-np.cos(turn), np.sin(turn)])
    points = replace(frame.points, sigma_mm=np.ones(3000))
    cylinder = np.concatenate([[0.0, 0.0, 120.0, 0.0, 0.0, 1.0, 76.2], oval])
    residuals(_packed(points), cylinder, out)
    assert np.abs(out).max() < 1e-9
    residuals(_packed(points), np.append(cylinder[:7], [0.0, 0.0]), round_out)
    assert np.abs(round_out).max() > 1


def test_the_fast_normal_equations_are_the_slow_ones():
    points = _frame(defect_share=0.3, spurious_share=0.05).points
    packed = _packed(points)
    packed[7, ::7] = 0.0
    H, g, slow_H, slow_g = np.empty((5, 5)), np.empty(5), np.empty((7, 7)), np.empty(7)
    residual, slow_residual, alone = np.empty(3000), np.empty(3000), np.empty(3000)
    weight = normal_matrix(packed, _cylinder(), 4.0, H, g, residual)
    slow_weight = normal_matrix(packed, _cylinder(), 4.0, slow_H, slow_g, slow_residual)
    assert weight == pytest.approx(slow_weight, rel=1e-12)
    residuals(packed, _cylinder(), alone)
    assert np.allclose(residual, alone, atol=1e-9)
    assert np.allclose(slow_residual, alone, atol=1e-9)
    assert np.allclose(H, slow_H[:5, :5], rtol=1e-9, atol=1e-9 * np.abs(H).max())
    assert np.allclose(g, slow_g[:5], rtol=1e-9, atol=1e-9 * np.abs(g).max())


def test_the_normal_equations_are_the_residuals_slopes():
    packed, terms = _packed(_frame().points), 7
    cylinder = _cylinder(oval=(0.3, -0.2))
    J, here = np.empty((3000, terms)), np.empty(3000)
    residuals(packed, cylinder, here)
    for k in range(terms):
        step, ahead, behind = np.zeros(terms), np.empty(3000), np.empty(3000)
        step[k] = 1e-5
        residuals(packed, moved(cylinder, step), ahead)
        residuals(packed, moved(cylinder, -step), behind)
        J[:, k] = (ahead - behind) / 2e-5
    H, g = np.empty((terms, terms)), np.empty(terms)
    normal_matrix(packed, cylinder, 1e9, H, g, np.empty(3000))
    scale = np.sqrt(np.diag(J.T @ J))
    assert np.allclose(H / np.outer(scale, scale), J.T @ J / np.outer(scale, scale), atol=0.02)
    assert np.allclose(g / scale, -J.T @ here / scale, atol=0.02 * np.abs(J.T @ here / scale).max())


def test_a_small_system_is_solved_or_refused():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(5, 5)) * [1, 10, 100, 1e3, 1e4]
    H, x, out = A.T @ A, rng.normal(size=5), np.empty(5)
    assert solve(H, H @ x, 0.0, out)
    assert np.allclose(out, x, rtol=1e-6)
    assert not solve(np.ones((5, 5)), np.ones(5), 0.0, out)
    assert not solve(np.zeros((5, 5)), np.ones(5), 0.0, out)


def test_steps_and_pulls_are_each_other_s_inverse():
    step = np.array([0.5, -0.3, 0.002, 0.001, 0.4])
    there = moved(_cylinder(), step)
    assert np.allclose(pull(_cylinder(), there), step, atol=1e-6)
    assert np.allclose(pull(there, there), 0)


def test_the_tightest_half_is_the_mode_though_nearly_half_lies_aside():
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.normal(0, 1, 5500), rng.normal(8, 0.5, 4500)])
    middle, scale = tightest_half(values)
    assert abs(middle) < 0.1
    assert scale == pytest.approx(1, abs=0.05)


def test_cells_condemn_a_shallow_patch_and_nothing_else():
    frame = _frame(defect_share=0.3, defect_depth_mm=0.5, tilt_deg=0.0, offset_mm=0.0)
    packed, cylinder = _packed(frame.points), np.concatenate([[0.0, 0.0, 120.0, 0, 0, 1, 76.2], [0.0, 0.0]])
    residual, cell = np.empty(3000), np.empty(3000, dtype=np.int32)
    residuals(packed, cylinder, residual)
    find_cells(packed, cylinder, -50.0, 50.0, 24, 7, cell)
    assert cell.min() >= 0
    assert cell.max() < 24 * 7
    kept = is_wall(cell, residual, 1.0, 24 * 7)[cell]
    assert kept[~frame.on_wall].mean() < 0.1
    assert kept[frame.on_wall].mean() > 0.9


def test_pose_and_axis_are_each_other_s_inverse():
    T = _frame(tilt_deg=8.0, offset_mm=9.0).T_pipe_camera
    back = pose_of(axis_of(T, 110.0, 76.2), T)
    assert np.allclose(back, T, atol=1e-12)


def test_information_goes_to_the_pose_and_back_where_the_roll_is_known():
    T = _frame(tilt_deg=8.0, offset_mm=9.0).T_pipe_camera
    cylinder, rng = axis_of(T, 110.0, 76.2), np.random.default_rng(2)
    A = rng.normal(size=(6, 4)) * [1, 1, 100, 100]
    H = A.T @ A
    pose = information_of_pose(H, cylinder, T)
    assert np.linalg.matrix_rank(pose / np.outer([1, 1, 1, 100, 100, 100], [1, 1, 1, 100, 100, 100])) == 4
    assert np.allclose(information_of_axis(pose, cylinder, T), H, rtol=1e-9)


def test_the_pose_s_information_is_that_of_the_radii_written_out():
    frame = _frame(tilt_deg=0.0, offset_mm=6.0, noise_mm=0.0)
    T, H, g = frame.T_pipe_camera, np.empty((5, 5)), np.empty(5)
    points = replace(frame.points, sigma_mm=np.full(3000, 0.3))
    cylinder = axis_of(T, 110.0, 76.2)
    normal_matrix(_packed(points), cylinder, 1e9, H, g, np.empty(3000))
    facing = points.direction @ T[:3, :3].T
    wall = points.xyz_mm @ T[:3, :3].T + T[:3, 3]
    across = np.abs(np.sum(facing[:, :2] * wall[:, :2], axis=1)) / np.hypot(wall[:, 0], wall[:, 1])
    ours = information_of_pose(without(H, 4, 5), cylinder, T)
    plain = radii_information(points.xyz_mm, 0.3 * across, T)
    scale = np.sqrt(np.abs(np.diag(plain)) + 1e-9)
    assert np.allclose(ours / np.outer(scale, scale), plain / np.outer(scale, scale), atol=1e-6)


def test_what_is_estimated_too_is_taken_off():
    rng = np.random.default_rng(3)
    A = rng.normal(size=(9, 5))
    H = A.T @ A
    assert np.allclose(np.linalg.inv(without(H, 4, 5)), np.linalg.inv(H)[:4, :4])
    center, tilt = looseness(np.linalg.inv(np.diag([4.0, 1.0, 0.01, 0.02])), 0.0)
    assert center == pytest.approx(2)
    assert tilt == pytest.approx(0.02**0.5)
    assert looseness(np.diag([1.0, 1.0, 1.0, 0.0]), 0.0) == (np.inf, np.inf)


# ---- the likeliest cylinder and its prior


def _align(points, prior, **settings):
    method = REGISTRATIONS["cylinder-map"]
    return method.align(points, Wall(NOMINAL), prior, method.settings(**settings))


def _rows(points, rows):
    return RingPoints(
        points.xyz_mm[rows], points.ring[rows], points.pixel[rows], points.direction[rows], points.sigma_mm[rows]
    )


def _knowing(T, center_mm, tilt_deg, off_mm=0.0):
    """A prior that is told centre and tilt too, give or take."""
    told = T.copy()
    told[0, 3] += off_mm
    stds = np.array([center_mm, center_mm, 0.05, np.radians(tilt_deg), np.radians(tilt_deg), np.radians(0.3)])
    return Alignment(told, np.diag(stds**-2.0))


def test_one_ring_fails_alone_and_leans_on_a_prior_that_knows():
    frame = _frame(tilt_deg=1.0)
    one = _rows(frame.points, frame.points.ring == 3)
    alone = _align(one, odometry(frame.T_pipe_camera))
    assert alone.verdict == "failed"
    assert alone.reason
    told = _align(one, _knowing(frame.T_pipe_camera, 0.2, 0.2))
    assert told.verdict != "good"
    assert told.reason


def test_a_narrow_arc_is_pulled_to_its_prior_by_as_much_as_it_knows():
    frame = _frame(arc_deg=60.0, noise_mm=0.3)
    free = _align(frame.points, odometry(frame.T_pipe_camera))
    told = _align(frame.points, _knowing(frame.T_pipe_camera, 0.01, 0.01))
    error = [np.linalg.norm((a.T_pipe_camera - frame.T_pipe_camera)[:2, 3]) for a in (free, told)]
    assert error[1] < 0.03
    assert error[1] < error[0]
    assert np.trace(told.information) > np.trace(free.information)


def test_a_prior_that_the_points_contradict_is_said():
    frame = _frame()
    found = _align(frame.points, _knowing(frame.T_pipe_camera, 0.05, 0.05, off_mm=3.0))
    assert found.verdict == "weak"
    assert "prior" in found.reason


def test_the_posterior_is_worth_what_it_says():
    errors, std = [], []
    for seed in range(60):
        frame = two_frames(FrameCase(points=600, arc_deg=200.0), seed)[1]
        found = _align(
            frame.points, replace(odometry(frame.T_pipe_camera), information=np.diag([0, 0, 1.0, 0, 0, 1e9]))
        )
        errors.append((found.T_pipe_camera - frame.T_pipe_camera)[:2, 3])
        std.append(np.sqrt(np.diag(covariance(found.information))[:2]))
    assert np.sqrt(np.mean(np.square(errors) / np.square(std))) == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("ovality_pct", [0.2, 0.5, 1.0, 4.0])
def test_an_oval_pipe_is_fitted_as_such_unless_it_is_said_to_be_round(ovality_pct):
    frame = _frame(ovality_pct=ovality_pct, arc_deg=320.0)
    as_oval = _align(frame.points, odometry(frame.T_pipe_camera))
    as_round = _align(frame.points, odometry(frame.T_pipe_camera), ovality_std_pct=0.0)
    off = [np.linalg.norm((a.T_pipe_camera - frame.T_pipe_camera)[:2, 3]) for a in (as_oval, as_round)]
    assert off[0] < 0.05 < off[1]
    assert as_oval.inliers.mean() > 0.95
    assert as_oval.noise_scale == pytest.approx(1, abs=0.1)
    assert as_oval.radius_mm == pytest.approx(76.2, abs=0.05)


def test_a_round_pipe_with_a_large_defect_is_fitted_as_one_that_is_said_to_be_round():
    for seed in range(5):
        frame = two_frames(FrameCase(points=3000, defect_share=0.3, arc_deg=320.0), seed)[1]
        found = _align(frame.points, odometry(frame.T_pipe_camera))
        as_round = _align(frame.points, odometry(frame.T_pipe_camera), ovality_std_pct=0.0)
        assert np.allclose(found.T_pipe_camera, as_round.T_pipe_camera, atol=0.01)


def test_many_points_are_no_worse_than_few_and_labelled_all():
    frame = two_frames(FrameCase(points=50_000, defect_share=0.2), 0)[1]
    found = _align(frame.points, odometry(frame.T_pipe_camera))
    assert found.inliers.size == 50_000
    assert found.inliers[frame.on_wall].mean() > 0.97
    assert found.inliers[~frame.on_wall].mean() < 0.01


def test_noise_that_is_not_the_stated_one_is_measured_and_said():
    frame = _frame()
    louder = replace(frame.points, sigma_mm=frame.points.sigma_mm / 15)
    found = _align(louder, odometry(frame.T_pipe_camera))
    assert found.noise_scale == pytest.approx(15, rel=0.1)
    assert "scatter" in found.reason
