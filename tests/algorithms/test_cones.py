"""The projector's cones: recovered from points on them, whatever lies beside them, and refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.calibration.cone_fit import Sight, fit_cones
from algorithms.calibration.cones import cones_of, excess_and_slopes, excess_rad, with_cones
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.surfaces import Bore, FlatBoard, Places
from sensor_model.geometry import transform
from sensor_model.rig import preset_rig

APEX, AXIS = (0.4, -0.7, -52.5), (0.01, -0.02, 1.0)
START = cones_of(preset_rig().projector)


@pytest.fixture(scope="module")
def true():
    return cones_of(preset_rig().projector.model_copy(update={"apex_mm": APEX, "axis": AXIS}))


def points_on(cones, rng, per_slit=300, noise_rad=0.0):
    """Points anywhere on each cone, from 80 to 300 mm down its light, and their slits."""
    slit = np.repeat(np.arange(cones.half_angle_rad.size), per_slit)
    alpha = cones.half_angle_rad[slit] + noise_rad * rng.standard_normal(slit.size)
    turn, reach = rng.uniform(0, 2 * np.pi, slit.size), rng.uniform(80, 300, slit.size)
    ray = np.column_stack([np.sin(alpha) * np.cos(turn), np.sin(alpha) * np.sin(turn), np.cos(alpha)])
    return (reach[:, None] * ray) @ cones.T_camera_projector[:3, :3].T + cones.apex_mm[0], slit


def sight(xyz, slit):
    range_mm = np.linalg.norm(xyz, axis=1)
    return Sight(xyz / range_mm[:, None], slit, Places(range_mm), np.zeros(slit.size))


def off(cones, true):
    return [float(np.abs(a - b).max()) for a, b in ((cones.apex_mm, true.apex_mm), (cones.axis, true.axis),
                                                    (cones.half_angle_rad, true.half_angle_rad))]  # fmt: skip


@pytest.mark.parametrize("own_apex", [False, True])
def test_exact_points_give_the_exact_cones(true, own_apex):
    fit = fit_cones([sight(*points_on(true, np.random.default_rng(1)))], START, own_apex=own_apex)
    assert max(off(fit.cones, true)) < 1e-6
    assert fit.rms_mm() < 1e-6


def test_noise_stays_within_what_the_fit_states(true):
    inside = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        fit = fit_cones([sight(*points_on(true, rng, noise_rad=3e-4))], START)
        inside.append(np.abs(fit.cones.apex_mm[0] - APEX) < 1.96 * fit.std[:3])
        inside.append(np.abs(fit.cones.half_angle_rad - true.half_angle_rad) < 1.96 * fit.std[5:])
        assert np.std(fit.excess_rad) == pytest.approx(3e-4, rel=0.1)
    assert np.mean(np.concatenate(inside)) > 0.85


def test_what_errs_alike_is_measured_and_widens_what_is_stated(true):
    rng = np.random.default_rng(2)
    plain = fit_cones([sight(*points_on(true, rng, noise_rad=3e-4))], START)
    xyz, slit = points_on(true, rng)
    turned = np.arctan2(xyz[:, 0], -xyz[:, 1])
    printed = 1 + 4e-3 * np.sin(3 * turned + slit)  # the slide's own: the same wherever the light falls
    jagged = fit_cones([sight(np.column_stack([xyz[:, :2] * printed[:, None], xyz[:, 2]]), slit)], START)
    assert plain.alike < 1.5
    assert jagged.alike > 3  # of the 8 points that a place has


def test_false_points_do_not_carry_it_away(true):
    rng = np.random.default_rng(3)
    xyz, slit = points_on(true, rng)
    xyz = xyz + 0.02 * rng.standard_normal(xyz.shape)
    wild = rng.random(slit.size) < 0.05
    xyz[wild] += rng.uniform(-20, 20, (wild.sum(), 3))
    fit = fit_cones([sight(xyz, slit)], START)
    apex, axis, angles = off(fit.cones, true)
    assert apex < 0.1
    assert max(axis, angles) < 1e-3
    assert fit.inliers[wild].mean() < 0.2


def test_turning_the_points_turns_the_cones(true):
    turn = transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.zeros(3))
    xyz, slit = points_on(true, np.random.default_rng(4))
    fit, turned = (fit_cones([sight(p, slit)], START).cones for p in (xyz, xyz @ turn[:3, :3].T))
    assert np.allclose(turn[:3, :3] @ fit.apex_mm[0], turned.apex_mm[0], atol=1e-5)


def test_what_cannot_be_fitted_says_why(true):
    xyz, slit = points_on(true, np.random.default_rng(5))
    few = np.concatenate([np.flatnonzero(slit == 0)[:3], np.flatnonzero(slit > 0)])
    for points, slits, reason in [
        (xyz[few], slit[few], "slit 1: 3 points"),
        (np.where(slit[:, None] == 7, np.nan, xyz), slit, "not finite"),
        (xyz, slit + 1, "points of 9 slits; the rig has 8"),
    ]:
        with pytest.raises(CannotCalibrate, match=reason):
            fit_cones([sight(points, slits)], START)
    with pytest.raises(CannotCalibrate, match="no projector's"):
        with_cones(preset_rig().projector, fit_cones([sight(xyz, 7 - slit)], START).cones)


def test_slopes_are_the_differences_they_make(true):
    rng = np.random.default_rng(6)
    xyz, slit = points_on(true, rng, 20)
    xyz = xyz + rng.normal(0, 3, xyz.shape)
    _, by_point, _ = excess_and_slopes(xyz, slit, true)
    for k in range(3):
        step = 1e-4 * (np.arange(3) == k)
        change = (excess_rad(xyz + step, slit, true) - excess_rad(xyz - step, slit, true)) / 2e-4
        np.testing.assert_allclose(by_point[:, k], change, atol=1e-8)
    ray = xyz / np.linalg.norm(xyz, axis=1)[:, None]
    for surface, own, common in [
        (FlatBoard(np.array([0.1, -0.2, 0.3, 5.0, 6.0, 200.0]), np.eye(6)), rng.normal(0, 1e-2, 6), np.zeros(0)),
        (
            Bore(np.array([3.0, -2.0, 0.03, 0.01]), 76.2, 0.5),
            np.array([0.1, 0.2, 0.001, 0.002, 0.0, 0.0]),
            np.array([0.3]),
        ),
    ]:
        by_own, by_common = surface.slopes(ray, surface.range_mm(ray, own, common), own, common)
        for slopes, given, of in [(by_own, own, 0), (by_common, common, 1)]:
            for k in range(given.size):
                step = 1e-5 * (np.arange(given.size) == k)
                ends = [
                    surface.range_mm(ray, *((given + s, common) if of == 0 else (own, given + s)))
                    for s in (step, -step)
                ]
                np.testing.assert_allclose(slopes[:, k], (ends[0] - ends[1]) / 2e-5, rtol=1e-4, atol=2e-3)
