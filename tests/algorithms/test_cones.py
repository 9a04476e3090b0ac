"""The projector's cones: recovered from points on them, whatever lies beside them, and refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.calibration.cone_fit import ConesNotFound, fit_cones
from sensor_model.geometry import transform
from sensor_model.rig import preset_rig

APEX, AXIS = (0.4, -0.7, -52.5), (0.01, -0.02, 1.0)


@pytest.fixture(scope="module")
def true_rig():
    rig = preset_rig()
    return rig.model_copy(update={"projector": rig.projector.model_copy(update={"apex_mm": APEX, "axis": AXIS})})


def points_on(rig, rng, per_slit=300):
    """Points anywhere on each cone, from 80 to 300 mm down its light."""
    out = []
    for alpha in rig.projector.slit_half_angles_rad:
        turn, reach = rng.uniform(0, 2 * np.pi, per_slit), rng.uniform(80, 300, per_slit)
        ray = np.column_stack([np.sin(alpha) * np.cos(turn), np.sin(alpha) * np.sin(turn), np.full(300, np.cos(alpha))])
        out.append((reach[:, None] * ray) @ rig.projector.T_camera_projector[:3, :3].T + rig.projector.apex_mm)
    return out


def off(fit, rig):
    true = rig.projector
    axis = fit.projector.T_camera_projector[:3, 2] - true.T_camera_projector[:3, 2]
    angles = fit.projector.slit_half_angles_rad - true.slit_half_angles_rad
    return [float(np.abs(e).max()) for e in (np.subtract(fit.projector.apex_mm, true.apex_mm), axis, angles)]


def test_exact_points_give_the_exact_projector(true_rig):
    fit = fit_cones(points_on(true_rig, np.random.default_rng(1)), preset_rig())
    assert max(off(fit, true_rig)) < 1e-9
    assert fit.rms_mm < 1e-9


def test_noise_stays_within_what_the_fit_states(true_rig):
    rng = np.random.default_rng(2)
    noisy = [points + 0.05 * rng.standard_normal(points.shape) for points in points_on(true_rig, rng)]
    fit = fit_cones(noisy, preset_rig())
    assert np.all(np.abs(np.subtract(fit.projector.apex_mm, APEX)) < 3.5 * np.array(fit.apex_std_mm))
    assert fit.rms_mm == pytest.approx(0.05, rel=0.1)


def test_false_points_do_not_carry_it_away(true_rig):
    rng = np.random.default_rng(3)
    points = [p + 0.02 * rng.standard_normal(p.shape) for p in points_on(true_rig, rng)]
    for one in points:
        one[:15] += rng.uniform(-20, 20, (15, 3))
    apex, axis, angles = off(fit_cones(points, preset_rig()), true_rig)
    assert apex < 0.1
    assert max(axis, angles) < 1e-3


def test_turning_the_points_turns_the_projector(true_rig):
    turn = transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.zeros(3))
    points = points_on(true_rig, np.random.default_rng(4))
    fit, turned = (fit_cones(p, preset_rig()) for p in (points, [one @ turn[:3, :3].T for one in points]))
    assert np.allclose(turn[:3, :3] @ fit.projector.apex_mm, turned.projector.apex_mm, atol=1e-8)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda points: points[:-1], "points of 7 slits; the rig has 8"),
        (lambda points: [points[0][:3], *points[1:]], "slit BB: 3 points"),
        (lambda points: [*points[:-1], points[-1] * np.nan], "slit RY: points that are not finite"),
        (lambda points: points[::-1], "no projector's"),
    ],
)
def test_what_cannot_be_fitted_says_why(true_rig, spoil, reason):
    points = spoil(points_on(true_rig, np.random.default_rng(5)))
    with pytest.raises(ConesNotFound, match=reason):
        fit_cones(points, preset_rig())
