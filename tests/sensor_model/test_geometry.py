"""Laws of the frames, the wall's angle and the fisheye."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sensor_model import geometry as g
from sensor_model.rig import preset_rig

ANGLE = st.floats(-20.0, 20.0)


@pytest.mark.parametrize(("x", "y", "clock"), [(0, -1, "12:00"), (1, 0, "3:00"), (0, 1, "6:00"), (-1, 0, "9:00")])
def test_clock_runs_clockwise_seen_downstream(x, y, clock):
    assert g.clock_position(float(g.wall_angle_rad(float(x), float(y)))) == clock


def test_clock_rounds_up_to_twelve():
    assert g.clock_position(2 * np.pi - 1e-6) == "12:00"


@given(ANGLE)
def test_wall_direction_is_the_inverse_of_wall_angle(theta):
    x, y, z = g.wall_direction(theta)
    assert z == 0
    assert abs(g.wrap_rad(g.wall_angle_rad(x, y) - theta)) < 1e-9


@given(ANGLE)
def test_a_wrapped_angle_is_the_same_turn(angle):
    wrapped = float(g.wrap_rad(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped - angle) == pytest.approx(1)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_transforms_close(seed):
    rng = np.random.default_rng(seed)
    T_a_b = g.transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 100)
    points = rng.normal(size=(5, 3)) * 50
    assert np.allclose(g.inverse(T_a_b) @ T_a_b, np.eye(4), atol=1e-12)
    assert np.allclose(g.apply(g.inverse(T_a_b), g.apply(T_a_b, points)), points, atol=1e-9)
    q = g.wxyz_from_rotation(T_a_b[:3, :3])
    assert q[0] >= 0
    assert np.allclose(g.rotation_from_wxyz(q), T_a_b[:3, :3], atol=1e-12)


@given(st.floats(-3.0, 3.0), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_twist_is_the_turn_that_a_tilt_leaves_alone(turn, tilt_x, tilt_y):
    tilt = Rotation.from_rotvec([tilt_x, tilt_y, 0.0])
    spin = Rotation.from_rotvec([0.0, 0.0, turn])
    for both in (tilt * spin, spin * tilt):
        assert float(g.wrap_rad(g.twist_about_z_rad(both.as_matrix()) - turn)) == pytest.approx(0, abs=1e-9)


def test_swing_is_the_smallest_rotation():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 3))
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    R = g.swing_onto(a, b)
    assert np.allclose(R @ a, b)
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(np.arccos(a @ b))
    with pytest.raises(ValueError, match="opposite"):
        g.swing_onto(a, -a)


def test_fisheye_agrees_with_opencv():
    import cv2

    k = preset_rig().camera.intrinsics
    points = np.random.default_rng(0).normal(size=(200, 3)) * [60, 60, 20] + [0, 0, 90]
    K = np.array([[k[0], 0, k[3]], [0, k[1], k[4]], [0, 0, 1.0]])
    # OpenCV's skew (alpha) is in units of fx
    theirs, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, k[5:].copy(), alpha=k[2] / k[0])
    assert np.allclose(g.fisheye_project(points, k), theirs[:, 0], atol=1e-9)


def test_the_compiled_fisheye_agrees_with_plain_numpy():
    k = preset_rig().camera.intrinsics
    points = np.vstack([np.random.default_rng(0).normal(size=(50, 3)) * [60, 60, 20] + [0, 0, 90], [[0, 0, 5.0]]])
    assert np.allclose([g.fisheye_pixel(*point, k) for point in points], g.fisheye_project(points, k), atol=1e-9)


def test_fisheye_rays_undo_the_projection():
    k = preset_rig().camera.intrinsics
    u, v = np.meshgrid(np.linspace(0, 1663, 40), np.linspace(0, 1231, 30))
    pixels = np.stack([u, v], axis=-1)
    rays = g.fisheye_rays(pixels, k)
    assert np.allclose(np.linalg.norm(rays, axis=-1), 1)
    assert np.abs(g.fisheye_project(rays * 120, k) - pixels).max() < 1e-7
    assert np.allclose(g.fisheye_rays(np.array([k[3], k[4]]), k), [0, 0, 1])


def test_half_angle_of_a_tilted_cone():
    axis = np.array([0.02, -0.01, 1.0])
    axis /= np.linalg.norm(axis)
    R, apex = g.cone_frame(axis), np.array([1.0, -2.0, -53.0])
    alpha, around = np.radians(25.0), np.linspace(0, 6, 13)
    local = np.stack(
        [np.sin(alpha) * np.cos(around), np.sin(alpha) * np.sin(around), np.full(13, np.cos(alpha))], axis=-1
    )
    assert np.allclose(g.half_angle_rad(apex + 150 * local @ R.T, apex, axis), alpha)


def test_the_fast_arc_tangent_is_numpys_to_its_last_digits():
    rng = np.random.default_rng(0)
    y, x = rng.normal(size=(2, 2000)) * 10.0 ** rng.integers(-6, 6, (2, 2000))
    edges = [0.0, -0.0, 1.0, -1.0]
    for v, u in [*zip(y, x, strict=True), *((v, u) for v in edges for u in edges if (v, u) != (0.0, 0.0) or u > 0)]:
        assert g.fast_arctan2.py_func(v, u) == pytest.approx(np.arctan2(v, abs(u) if u == 0 else u), rel=1e-15, abs=0)
    assert np.isnan(g.fast_arctan2(np.nan, 1.0))
    assert np.isnan(g.fast_arctan2(1.0, np.nan))


def test_rays_from_pixels_further_out_than_ninety_degrees_can_be_seen():
    k = np.array([300.0, 300.0, 0.0, 500.0, 500.0, 0.0, 0.0, 0.0, 0.0])
    wide = np.array([2.0, 0.0, -0.5])
    pixel = g.fisheye_project(np.array([wide, [1.0, 1.0, 5.0]]), k)
    assert g.fisheye_rays(pixel, k)[0] == pytest.approx(wide / np.linalg.norm(wide), abs=1e-12)
