"""The cylinder fits: exact on exact data, at the noise's limit under noise, blind to defects, honest about failure."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from algorithms.registration import REGISTRATIONS
from algorithms.registration.cylinder import CylinderSettings
from algorithms.registration.fusion import covariance, fuse
from algorithms.registration.least_squares_cylinder import fit_cylinder
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, Wall
from sensor_model.geometry import twist_about_z_rad
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import NominalPipe
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
POCKET = {"kind": "pocket", "clock_deg": 120, "length_mm": 70, "width_mm": 35, "depth_mm": 7.5}


def _scene(noise_px=0.25, x=4.0, y=-3.0, tilt=(2.0, -1.5), roll=0.4, drop=0.0, seed=0, radius=76.2):
    pipe = Pipe(inner_radius_mm=radius, wall_thickness_mm=7.5, features=[{**POCKET, "distance_mm": 120}])
    T = np.eye(4)
    T[:3, :3] = (Rotation.from_rotvec([0, 0, roll]) * Rotation.from_euler("xy", tilt, degrees=True)).as_matrix()
    T[:3, 3] = x, y, 5.0
    noise = PointNoise(pixel_noise_px=noise_px, drop_out_share=drop)
    return T, triangulate(see_slits(pipe, T, preset_rig(), noise, np.random.default_rng(seed)), preset_rig())


def _prior(T):
    prior = np.eye(4)
    prior[:3, :3] = Rotation.from_rotvec([0, 0, float(twist_about_z_rad(T[:3, :3]))]).as_matrix()
    prior[2, 3] = T[2, 3]
    return Alignment(prior, np.diag([0, 0, 400.0, 0, 0, 3e4]))


def _error(a, T):
    tilt = np.degrees(np.arccos(np.clip(a.T_pipe_camera[2, :3] @ T[2, :3], -1, 1)))
    return np.linalg.norm(a.T_pipe_camera[:2, 3] - T[:2, 3]), tilt


@pytest.fixture(params=["cylinder", "cylinder-map"])
def align(request):
    method = REGISTRATIONS[request.param]
    return lambda points, prior, **changes: method.align(points, Wall(NOMINAL), prior, method.settings(**changes))


def test_fusing_ends_between_two_that_are_far_apart():
    """Turned apart by nearly half a turn too, and where only one of them knows anything."""
    for angle in (0.3, 2.0, 3.1415, np.pi):
        turned = np.eye(4)
        turned[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
        turned[:3, 3] = 3.0, -2.0, 7.0
        both = fuse(Alignment(turned, np.eye(6)), Alignment(np.eye(4), np.zeros((6, 6))))
        assert np.allclose(both.T_pipe_camera, turned, atol=1e-6)
        middle = fuse(Alignment(turned, np.eye(6)), Alignment(np.eye(4), np.eye(6))).T_pipe_camera
        assert np.allclose(middle[:3, 3], [1.5, -1.0, 3.5])
        assert abs(float(twist_about_z_rad(middle[:3, :3]))) == pytest.approx(angle / 2)


def test_exact_points_give_the_exact_pose_past_a_deep_defect(align):
    T, points = _scene(noise_px=0)
    found = align(points, _prior(T))
    assert found.converged
    center, tilt = _error(found, T)
    assert center < 1e-3  # the prior's roll is the twist of a tilted pose: its centre turns with it
    assert tilt < 1e-3
    assert found.radius_mm == pytest.approx(76.2, abs=1e-6)


def test_noise_is_averaged_as_the_information_says(align):
    errors, information = [], None
    for seed in range(12):
        T, points = _scene(seed=seed)
        found = align(points, Alignment(_prior(T).T_pipe_camera, np.zeros((6, 6))))
        errors.append(found.T_pipe_camera[:2, 3] - T[:2, 3])
        # off centre, roll and centre are known only together; here the prior's roll is exact
        exact = Alignment(found.T_pipe_camera, np.diag([0, 0, 1.0, 0, 0, 1e12]))
        information = fuse(exact, found).information
    sigma = np.sqrt(np.diag(covariance(information))[:2])
    ratio = np.std(errors, axis=0) / sigma
    assert (ratio > 0.5).all()
    assert (ratio < 1.7).all()


def test_moving_the_camera_moves_the_answer(align):
    for move in ({"x": -8.0, "y": 6.0}, {"tilt": (-6.0, 7.0)}, {"roll": -2.5}):
        T, points = _scene(noise_px=0.1, **move)
        center, tilt = _error(align(points, _prior(T)), T)
        assert center < 0.05
        assert tilt < 0.03


def test_travel_and_roll_are_left_to_the_prior(align):
    T, points = _scene()
    found = align(points, Alignment(_prior(T).T_pipe_camera, np.zeros((6, 6))))
    values = np.linalg.eigvalsh(found.information / np.outer([1, 1, 1, 100, 100, 100], [1, 1, 1, 100, 100, 100]))
    assert (np.abs(values[:2]) < 1e-9 * values[-1]).all()
    assert values[2] > 1
    assert found.T_pipe_camera[2, 3] == T[2, 3]


def test_inliers_leave_the_defect_out(align):
    T, points = _scene(noise_px=0.1)
    found = align(points, _prior(T))
    wall = points.xyz_mm @ T[:3, :3].T + T[:3, 3]
    deep = np.hypot(wall[:, 0], wall[:, 1]) > 80
    assert deep.sum() > 50
    assert not found.inliers[deep].any()
    assert found.inliers[~deep].mean() > 0.95


def test_the_inlier_threshold_follows_the_noise(align):
    for noise in (0.02, 0.2, 1.5):
        T, points = _scene(noise_px=noise)
        share = align(points, _prior(T)).inliers.mean()
        assert 0.85 < share < 0.999


def test_another_radius_is_found_free_of_the_nominal_one(align):
    T, points = _scene(noise_px=0.1, radius=77.5)
    found = align(points, _prior(T))
    assert found.radius_mm == pytest.approx(77.5, abs=0.02)


def test_the_plain_fit_agrees_with_scipy():
    rng = np.random.default_rng(3)
    theta, z = rng.uniform(0, 5, 400), rng.uniform(-60, 60, 400)
    xyz = np.stack([76 * np.sin(theta), -76 * np.cos(theta), z], axis=1) + rng.normal(size=(400, 3)) * 0.2
    xyz = Rotation.from_euler("xy", [3, -2], degrees=True).apply(xyz) + np.array([3, 2, 100])
    start, z_mid = np.array([0, 0, 0, 0, 70.0]), 100.0

    def residual(p):
        axis = np.array([p[2], p[3], 1.0]) / np.sqrt(1 + p[2] ** 2 + p[3] ** 2)
        return np.linalg.norm(np.cross(xyz - [p[0], p[1], z_mid], axis), axis=1) - p[4]

    ours = fit_cylinder(xyz)
    theirs = least_squares(residual, start, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    slope = ours.axis[:2] / ours.axis[2]
    at_middle = ours.center_mm[:2] + (z_mid - ours.center_mm[2]) * slope
    assert np.allclose(at_middle, theirs[:2], atol=1e-7)
    assert np.allclose(slope, theirs[2:4], atol=1e-9)
    assert ours.radius_mm == pytest.approx(theirs[4], abs=1e-8)


def test_reference_cylinders_of_the_ptb(shared):
    sets = sorted((shared / "reference" / "cylinder").glob("*.asc"))
    assert sets
    for file in sets:
        answer = np.loadtxt(file.with_suffix("").with_suffix(".answer.txt"))
        found = fit_cylinder(np.loadtxt(file))
        direction = answer[3:6] / np.linalg.norm(answer[3:6])
        off = found.center_mm - answer[:3]
        assert np.linalg.norm(off - direction * (off @ direction)) < 1e-4, file.name  # 0.1 um
        assert np.linalg.norm(np.cross(found.axis, direction)) < 1e-7, file.name  # 0.1 urad
        assert abs(found.radius_mm - answer[6]) < 1e-4, file.name


def test_too_few_points_are_no_cylinder():
    with pytest.raises(ValueError, match="no cylinder"):
        fit_cylinder(np.outer(np.arange(12.0), [1.0, 0.0, 0.0]))


def test_settings_refuse_what_makes_no_sense():
    with pytest.raises(ValueError, match="min_inlier_share"):
        CylinderSettings(min_inlier_share=2)
