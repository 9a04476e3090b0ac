"""The projector's calibration recovers the cones that were seen on the boards, and the slide's jaggedness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.calibration.board_pose import seen
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.poses_needed import LIMITS, off_from, pose_curve
from algorithms.calibration.projector import SeenBoards, calibrate_projector, fit_boards
from sensor_model.geometry import fisheye_project
from sensor_model.rig import preset_rig

TILTED = {"axis": (0.012, -0.015, 1.0), "apex_mm": (0.8, -1.2, -53.6)}
BASE = preset_rig()
RIG = BASE.model_copy(update={"projector": BASE.projector.model_copy(update=TILTED)})
LENS = RIG.camera.intrinsics
HALF = RIG.projector.slit_half_angles_rad
AZIMUTHS = 90
MARKERS = np.array([[x, y, 0.0] for x in range(0, 180, 36) for y in range(0, 250, 36)])


def _boards(rng, depths_mm, tilt_deg=20.0):
    for z in depths_mm:
        R = Rotation.from_euler("xyz", rng.uniform(-tilt_deg, tilt_deg, 3), degrees=True)
        yield np.concatenate([R.as_rotvec(), [rng.uniform(-20, 20), rng.uniform(10, 40), z]])


def _on(pose, jag_rad=0.0):
    """Where the slits' light meets a board (camera frame), so many azimuths a slit."""
    T = RIG.projector.T_camera_projector
    slit = np.repeat(np.arange(HALF.size), AZIMUTHS)
    azimuth = np.tile(np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS, HALF.size)
    half = HALF[slit] + jag_rad * np.sin(23 * azimuth + slit)
    light = np.stack([np.sin(half) * np.sin(azimuth), -np.sin(half) * np.cos(azimuth), np.cos(half)], axis=1)
    direction = light @ T[:3, :3].T
    normal = Rotation.from_rotvec(pose[:3]).as_matrix()[:, 2]
    range_mm = (normal @ (pose[3:] - T[:3, 3])) / (direction @ normal)
    return T[:3, 3] + range_mm[:, None] * direction, slit


def _seen(rng, depths_mm, noise_px=0.2, corner_px=0.3, jag_rad=0.0, tilt_deg=20.0):
    parts = []
    for i, pose in enumerate(_boards(rng, depths_mm, tilt_deg)):
        xyz, slit = _on(pose, jag_rad)
        pixel = fisheye_project(xyz, LENS) + rng.normal(0, noise_px, (slit.size, 2))
        view = seen(LENS, pose, MARKERS)
        information = np.einsum("nij,nik->jk", view.by_pose, view.by_pose)
        error = np.linalg.solve(np.linalg.cholesky(information).T, rng.normal(0, corner_px, 6))
        parts.append((pixel, slit, np.full(slit.size, i), pose + error, information))
    pixel, slit, board = (np.concatenate([part[k] for part in parts]) for k in range(3))
    corners = np.full(len(parts), corner_px * np.sqrt(2))
    noise = np.full(slit.size, noise_px)
    return SeenBoards(
        pixel, noise, slit, board, np.array([p[3] for p in parts]), np.array([p[4] for p in parts]), corners
    )


def _axis_deg(cones):
    true = RIG.projector.T_camera_projector[:3, 2]
    return np.degrees(np.linalg.norm(np.cross(cones.axis, true)))


def _fit(seen_boards):
    return fit_boards(seen_boards.sights(LENS), HALF.size)


def test_the_cones_are_recovered_and_boards_help_to_place_themselves():
    seen_boards = _seen(np.random.default_rng(0), [130, 160, 190, 220, 250, 280])
    fit = _fit(seen_boards)
    off = np.degrees(fit.cones.half_angle_rad - HALF)
    assert np.abs(off).max() < 0.02
    assert _axis_deg(fit.cones) < 0.02
    assert fit.cones.apex_mm[0] == pytest.approx(TILTED["apex_mm"], abs=0.15)
    assert (np.abs(np.radians(off)) < 4 * fit.std[5:]).all()


def test_wild_points_have_no_say():
    rng = np.random.default_rng(1)
    good = _seen(rng, [130, 170, 210, 260], corner_px=0.05)
    pixel = good.pixel.copy()
    wild = rng.random(len(pixel)) < 0.08
    pixel[wild] += rng.uniform(-60, 60, (wild.sum(), 2))
    fit = _fit(replace(good, pixel=pixel))
    assert np.abs(np.degrees(fit.cones.half_angle_rad - HALF)).max() < 0.05
    assert fit.inliers[wild].mean() < 0.3


def test_a_slit_s_own_cone_agrees_with_the_shared_one_where_all_share_it():
    found = calibrate_projector(_seen(np.random.default_rng(2), [130, 180, 240], 0.01, 0.01), LENS, HALF.size)
    assert found.own_half_angle_rad == pytest.approx(HALF, abs=2e-4)


def test_boards_that_disagree_widen_what_is_stated():
    good = _seen(np.random.default_rng(5), [130, 160, 190, 220, 250, 280])
    poses = good.poses.copy()
    poses[::2, 5] += 1.0  # mm: more than their markers say
    sure, unsure = (calibrate_projector(one, LENS, HALF.size) for one in (good, replace(good, poses=poses)))
    assert unsure.half_angle_std_rad.max() > 2 * sure.half_angle_std_rad.max()
    assert sure.weakness == ""
    assert (
        "half angles are known"
        in calibrate_projector(
            replace(good, poses=poses + [0, 0, 0, 0, 0, 1] * np.resize([3.0, -2.0], 6)[:, None]), LENS, HALF.size
        ).weakness
    )


def test_more_poses_leave_less_error_and_the_curve_says_from_where():
    """Over three sessions: in one, three boards may do as well as seven by chance."""
    shrunk: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for seed in (6, 7, 8):
        seen_boards = _seen(np.random.default_rng(seed), np.linspace(120, 290, 7), corner_px=0.3)
        fit, sights = _fit(seen_boards), seen_boards.sights(LENS)
        for true in (RIG, None):
            curve = pose_curve(sights, fit, RIG, true, np.random.default_rng(0))
            assert curve.poses == (3, 4, 6, 7)
            first, last = (np.array(curve.nine_of_ten[k][:3]) for k in (0, -1))
            shrunk[true is not None].append(np.log(last / first))
            needed = curve.needed["half_angle_deg"]
            assert needed in curve.poses
            assert curve.nine_of_ten[curve.poses.index(needed)].half_angle_deg <= LIMITS.half_angle_deg
    for ratios in shrunk.values():
        assert np.exp(np.mean(ratios)) < 0.8
    assert off_from(RIG, RIG) == (0, 0, 0, pytest.approx(0, abs=1e-9))


@pytest.mark.parametrize("jag_deg", [0.0, 0.1])
def test_jaggedness_is_corrected_where_there_is_some_and_only_there(jag_deg):
    boards = _seen(np.random.default_rng(3), [140, 180, 220, 260, 160], jag_rad=np.radians(jag_deg), corner_px=0.05)
    found = calibrate_projector(boards, LENS, HALF.size)
    gain = np.mean(found.corrected_mm) / np.mean(found.plain_mm)
    assert gain < 0.7 if jag_deg else gain < 1.15
    assert found.correction_helps or not jag_deg


def test_boards_that_all_stand_alike_and_too_few_are_refused():
    with pytest.raises(CannotCalibrate, match="mm away"):
        calibrate_projector(_seen(np.random.default_rng(4), [200, 200, 200], tilt_deg=0.5), LENS, HALF.size)
    with pytest.raises(CannotCalibrate, match="at least"):
        _fit(_seen(np.random.default_rng(4), [200]))
