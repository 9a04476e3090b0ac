"""Triangulation recovers wall points exactly, says how uncertain each is, and refuses rays that miss their cone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.reconstruct import share_of_places
from algorithms.triangulate import triangulate
from sensor_model.geometry import fisheye_project, fisheye_rays, half_angle_rad
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig, preset_rig
from twin.pipe import Pipe

PIPE = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
EXACT = PointNoise(pixel_noise_px=0, drop_out_share=0, azimuths=180)


def _pose(x=4.0, y=-3.0, z=100.0, tilt=(2.0, -1.5, 20.0)):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
    T[:3, 3] = x, y, z
    return T


def _reference(seen: SlitPixels, rig: Rig) -> np.ndarray:
    """The same by plain numpy: the far end of each ray is moved until its half angle is the slit's."""
    rays = fisheye_rays(seen.pixel, rig.camera.intrinsics)
    wanted = rig.projector.slit_half_angles_rad[seen.slit]
    apex, axis = np.array(rig.projector.apex_mm), rig.projector.T_camera_projector[:3, 2]
    low, high = np.full(len(rays), 1.0), np.full(len(rays), 1e4)
    for _ in range(80):
        middle = (low + high) / 2
        inside = half_angle_rad(rays * middle[:, None], apex, axis) < wanted
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return rays * low[:, None]


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (-0.013, 0.013, 1.0)])
def test_points_lie_on_the_wall_and_agree_with_plain_numpy(axis):
    rig = preset_rig()
    projector = rig.projector.model_copy(update={"axis": axis, "apex_mm": (0.4, -0.3, -53.1)})
    rig = rig.model_copy(update={"projector": projector})
    T = _pose()
    seen = see_slits(PIPE, T, rig, EXACT, np.random.default_rng(0))
    points = triangulate(seen, rig)
    assert points.sigma_mm.size == seen.slit.size > 1000
    wall = points.xyz_mm @ T[:3, :3].T + T[:3, 3]
    assert np.abs(np.hypot(wall[:, 0], wall[:, 1]) - 76.2).max() < 1e-6
    assert np.abs(points.xyz_mm - _reference(seen, rig)).max() < 1e-6


def test_the_stated_deviation_is_the_measured_one():
    rig, T = preset_rig(), _pose(x=0.0, y=0.0, tilt=(0.0, 0.0, 0.0))
    exact = see_slits(PIPE, T, rig, EXACT, np.random.default_rng(0))
    noisy = see_slits(PIPE, T, rig, EXACT.model_copy(update={"pixel_noise_px": 0.3}), np.random.default_rng(1))
    here, there = triangulate(exact, rig), triangulate(noisy, rig)
    assert np.array_equal(here.ring, there.ring)
    moved = np.sum((there.xyz_mm - here.xyz_mm) * there.direction, axis=1)
    assert np.std(moved / there.sigma_mm) == pytest.approx(1, abs=0.05)
    # across the wall: pixels per mm of radius by the closed form, a ring of radius R at R / tan(alpha) - 53 mm ahead
    radial = np.linalg.norm(there.direction[:, :2], axis=1) * there.sigma_mm / 0.3
    for k, alpha in enumerate(rig.projector.slit_half_angles_rad):
        ring = np.array([[0.0, R, R / np.tan(alpha) - 53.0] for R in (76.1, 76.3)])
        sensitivity = -np.diff(fisheye_project(ring, rig.camera.intrinsics)[:, 1])[0] / 0.2
        assert 1 / np.median(radial[there.ring == k]) == pytest.approx(sensitivity, rel=0.01)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (-0.013, 0.013, 1.0)])
def test_the_stated_deviation_is_the_slope_that_plain_numpy_finds(axis):
    rig = preset_rig()
    rig = rig.model_copy(update={"projector": rig.projector.model_copy(update={"axis": axis})})
    seen = see_slits(PIPE, _pose(), rig, EXACT, np.random.default_rng(0))
    outward = seen.pixel - [rig.camera.cx_px, rig.camera.cy_px]
    outward *= 0.01 / np.linalg.norm(outward, axis=1, keepdims=True)
    ends = [_reference(SlitPixels(seen.pixel + end, seen.slit, seen.sigma_px), rig) for end in (-outward, outward)]
    slide = np.linalg.norm(ends[1] - ends[0], axis=1) / 0.02
    assert triangulate(seen, rig).sigma_mm / seen.sigma_px == pytest.approx(slide, rel=1e-6)


def test_a_ray_inside_its_cone_gives_no_point():
    rig = preset_rig()
    near_axis = fisheye_project(np.array([[5.0, 0.0, 100.0]]), rig.camera.intrinsics)
    seen = SlitPixels(near_axis, np.array([4]), np.array([0.2]))
    assert triangulate(seen, rig).sigma_mm.size == 0
    at_the_center = SlitPixels(np.array([[rig.camera.cx_px, rig.camera.cy_px]]), np.array([0]), np.array([0.2]))
    assert triangulate(at_the_center, rig).sigma_mm.size == 0


def test_the_yield_counts_every_place_once():
    rng = np.random.default_rng(0)
    pixel, slit = rng.uniform(0, 1000, (3000, 2)), rng.integers(0, 8, 3000)
    line = np.arctan2(pixel[:, 0] - 480.0, 510.0 - pixel[:, 1]) / (2 * np.pi) * 360
    for turn in (0.0, 8 / 13):
        places = set(zip(slit.tolist(), (np.rint(line - turn) % 360).tolist(), strict=True))
        assert share_of_places(pixel, slit, (480.0, 510.0), (8, 360), turn) == len(places) / (8 * 360)
