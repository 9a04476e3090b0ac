"""The cheap fidelity: light ends on the wall, rims hide what lies behind them, holes and the strut return nothing."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.triangulate import triangulate
from sensor_model.geometry import half_angle_rad
from sensor_model.points import PointNoise, see_slits
from sensor_model.rig import preset_rig
from sensor_model.wall_rays import in_shadow, point_in_shadow, stretch_mm, wall_range_mm, wall_ranges_mm
from twin.pipe import Pipe

EXACT = PointNoise(pixel_noise_px=0, drop_out_share=0, azimuths=360)
POCKET = {"kind": "pocket", "distance_mm": 120, "clock_deg": 120, "length_mm": 60, "width_mm": 35, "depth_mm": 7.5}


def _pipe(backed=True, **settings):
    return Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=[POCKET], backed=backed, **settings)


def _wall(pipe, noise=EXACT, z=0.0):
    T = np.eye(4)
    T[2, 3] = z
    points = triangulate(see_slits(pipe, T, preset_rig(), noise, np.random.default_rng(0)), preset_rig())
    xyz = points.xyz_mm + T[:3, 3]
    theta = np.arctan2(xyz[:, 0], -xyz[:, 1])
    return points, xyz, theta, np.hypot(xyz[:, 0], xyz[:, 1])


def test_light_ends_on_the_wall():
    pipe = _pipe(ovality_pct=2)
    _, xyz, theta, rho = _wall(pipe)
    assert np.abs(rho - pipe.radius(theta, xyz[:, 2])).max() < 1e-3
    assert rho.max() > 83


def test_the_floor_begins_one_shadow_behind_the_rim():
    rims, nearest = 90.0, []
    for z in np.arange(-80, 60, 2.0):
        points, xyz, theta, rho = _wall(_pipe(), z=z)
        floor = (rho > 83.6) & (np.abs(np.degrees(theta) - 120) < 10) & (points.ring == 4)
        nearest.append(xyz[floor, 2].min(initial=np.inf))
    run = 7.5 / np.tan(np.radians(28.99))
    assert min(nearest) == pytest.approx(rims + run, abs=2.5)  # steps of 2 mm, and the rim's rounding


def test_a_hole_returns_no_light():
    _, _, _, backed = _wall(_pipe())
    _, _, _, open_ = _wall(_pipe(backed=False))
    assert (backed > 83.65).sum() > 20
    assert (open_ > 83.65).sum() == 0


def test_frames_in_succession_see_the_wall_between_one_anothers_lines():
    pipe, noise = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5), EXACT.model_copy(update={"azimuths": 720})

    def around_deg(frames):
        seen = [
            see_slits(pipe, np.eye(4), preset_rig(), noise, np.random.default_rng(0), frame_index=k) for k in frames
        ]
        points = [triangulate(one, preset_rig()) for one in seen]
        x, y = np.concatenate([p.xyz_mm[p.ring == 4, :2] for p in points]).T
        return np.sort(np.degrees(np.arctan2(x, -y)) % 360)

    for frames, widest in (([7], 13), (range(40, 45), 3), (range(13), 1), (range(0, 130, 10), 1)):
        lit = around_deg(frames)
        lit = lit[(lit > 30) & (lit < 330)]
        assert np.diff(lit).max() == pytest.approx(widest * 0.5 / 13)
    assert np.array_equal(around_deg([3]), around_deg([16]))


def test_the_strut_hides_its_sector_and_drop_outs_drop():
    points, _, _, _ = _wall(_pipe())
    azimuth = np.degrees(np.arctan2(points.direction[:, 0], -points.direction[:, 1]))
    assert np.abs(azimuth).min() > 18
    fewer, _, _, _ = _wall(_pipe(), EXACT.model_copy(update={"drop_out_share": 0.25}))
    assert fewer.sigma_mm.size == pytest.approx(0.75 * points.sigma_mm.size, rel=0.03)


def test_marching_agrees_with_plain_numpy():
    pipe, rng = _pipe(), np.random.default_rng(1)
    theta, alpha = rng.uniform(1.8, 2.4, 200), rng.uniform(0.35, 0.65, 200)
    rays = np.stack([np.sin(alpha) * np.sin(theta), -np.sin(alpha) * np.cos(theta), np.cos(alpha)], axis=1)
    origin = np.array([2.0, -1.0, -40.0])
    found = origin + wall_ranges_mm(pipe.wall, tuple(origin), rays)[:, None] * rays
    t = np.arange(100, 400, 0.01)
    for ray, hit in zip(rays[:40], found, strict=False):
        path = origin + t[:, None] * ray
        outside = np.hypot(path[:, 0], path[:, 1]) > pipe.radius(np.arctan2(path[:, 0], -path[:, 1]), path[:, 2])
        assert np.linalg.norm(path[outside.argmax()] - hit) < 0.02
    assert np.allclose(half_angle_rad(found, origin, np.array([0, 0, 1.0])), alpha)


def test_shadows_agree_with_plain_numpy():
    pipe, eye, rng = _pipe(), np.array([2.0, -1.0, 13.0]), np.random.default_rng(2)
    theta, z = rng.uniform(1.8, 2.4, 300), rng.uniform(85, 155, 300)
    rho = pipe.radius(theta, z)
    points = np.stack([rho * np.sin(theta), -rho * np.cos(theta), z], axis=1)
    shaded = in_shadow(pipe.wall, points, tuple(eye))
    assert 0.02 < shaded.mean() < 0.2
    share = np.linspace(0, 1, 4000)[:, None]
    for point, dark in zip(points, shaded, strict=True):
        path = point + share * (eye - point)
        wall = pipe.radius(np.arctan2(path[:, 0], -path[:, 1]), path[:, 2])
        # by how much the line leaves the bore; what grazes the wall may go either way
        deepest = np.max(np.hypot(path[:, 0], path[:, 1]) - wall)
        assert dark == (deepest > 0.05) or 1e-9 < deepest < 0.05

    # the near corner of the floor cannot be seen from far behind the rim, and can from above
    corner = np.array([[83.6 * np.sin(2.0944), -83.6 * np.cos(2.0944), 92.5]])
    assert in_shadow(pipe.wall, corner, (0.0, 0.0, -300.0))[0]
    assert not in_shadow(pipe.wall, corner, (0.0, 0.0, 92.5))[0]


@pytest.mark.parametrize("ovality_pct", [0.0, 2.0])
def test_many_rays_at_once_go_as_one_by_one(ovality_pct):
    pipe, rng = _pipe(ovality_pct=ovality_pct), np.random.default_rng(4)
    theta, alpha = rng.uniform(1.5, 2.7, 500), rng.uniform(0.2, 0.65, 500)
    rays = np.stack([np.sin(alpha) * np.sin(theta), -np.sin(alpha) * np.cos(theta), np.cos(alpha)], axis=1)
    origin, eye = (2.0, -1.0, -40.0), (2.5, -0.5, 13.0)
    ranges = wall_ranges_mm(pipe.wall, origin, rays)
    one_by_one = [
        wall_range_mm(pipe.wall, origin, ray, *stretch_mm(pipe.wall, origin, ray)) for ray in map(tuple, rays)
    ]
    assert ranges == pytest.approx(one_by_one, abs=1e-9)
    points = origin + ranges[:, None] * rays
    dark = [point_in_shadow(pipe.wall, tuple(point), eye) for point in points]
    assert in_shadow(pipe.wall, points, eye).tolist() == dark


def test_a_ray_along_the_axis_meets_no_wall():
    assert np.isnan(wall_ranges_mm(_pipe().wall, (0.0, 0.0, 0.0), np.array([[0.0, 0.0, 1.0]]))).all()
