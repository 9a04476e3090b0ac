"""Finding the way by the wall: lags are recovered, a bare wall and the slide's jaggedness tell nothing, joints tie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from algorithms.hindsight import moved, straightened
from algorithms.localisation.joints import joint_mm
from algorithms.localisation.lags import SHADE_MM, Profile, lag_about_bins, lag_along_mm, misfits
from algorithms.method import Method
from algorithms.reconstruct import begin, finish, step
from algorithms.types import Alignment, WallMap
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import Frame, NominalPipe, SlitPixels
from sensor_model.rig import preset_rig
from sensor_model.streams import stream
from twin.pipe import Pipe

RIG = preset_rig()
BORE_MM = 76.2
NOMINAL = NominalPipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5)
WORN_PCT = 2.0
POCKETS = [
    {
        "kind": "pit",
        "distance_mm": 180 + 60 * k,
        "clock_deg": 90 + 40 * k,
        "diameter_mm": 40,
        "depth_mm": 4,
        "shape": "conical",
    }
    for k in range(4)
]


def _bell(z, middle, width=12.0):
    return 2.0 * np.where(np.abs(z - middle) < width, np.cos(0.5 * np.pi * (z - middle) / width) ** 2, 0.0)


def _profile(rng, shift_mm=0.0, shift_bins=0.0, low=0.0, high=60.0, step_mm=3.3, phase=0.0):
    """A lump as a ring sees it: samples a step apart, each bin at its own phase."""
    bins = np.arange(180)
    z = np.arange(low + phase, high, step_mm)[:, None] + 2.0 * np.sin(2 * np.pi * bins / 180)[None, :]
    around = np.exp(-0.5 * ((bins[None, :] - 90 - shift_bins) / 6) ** 2)
    height = _bell(z, 30.0 + shift_mm) * around + 0.02 * rng.standard_normal(z.shape)
    return Profile(z, height)


@pytest.mark.parametrize("shift", [-3.0, 0.4, 5.2])
def test_a_lag_along_the_pipe_is_recovered_below_a_cell(shift):
    rng = np.random.default_rng(1)
    lag = lag_along_mm(
        _profile(rng, low=-30, high=90), _profile(rng, shift, low=-30, high=90, phase=1.7), (0.0, 60.0), 7.0, 0.05
    )
    assert lag.lag == pytest.approx(shift, abs=0.25)
    assert 0 < lag.std < 1.0


def test_a_lag_about_the_pipe_is_recovered():
    rng = np.random.default_rng(2)
    one, other = _profile(rng, low=-30, high=90), _profile(rng, 0.0, 2.6, low=-30, high=90, phase=1.0)
    lag = lag_about_bins(one, other, (0.0, 60.0), 7.0, 0.05, 0.0)
    assert lag.lag == pytest.approx(2.6, abs=0.3)


def test_what_does_not_change_along_the_pipe_tells_nothing_of_it():
    rng = np.random.default_rng(3)
    z = np.arange(-30, 90, 3.3)[:, None] + np.zeros((1, 180))
    groove = 2.0 * np.exp(-0.5 * ((np.arange(180) - 90) / 6) ** 2)[None, :]
    for wall in (groove, 0 * groove):
        one, other = (wall + 0.02 * rng.standard_normal(z.shape) for _ in range(2))
        assert lag_along_mm(Profile(z, one), Profile(z, other), (3.0, 50.0), 7.0, 0.05).std == np.inf


def test_the_compiled_misfit_is_the_plain_one():
    rng = np.random.default_rng(4)
    reference, other = _profile(rng, low=-20, high=80, step_mm=5.0), _profile(rng, 1.0, step_mm=6.0)
    reference.height_mm[rng.random(reference.height_mm.shape) < 0.1] = np.nan
    lags = np.array([-1.5, 500.0, 0.1, 2.25])  # one beyond all that was seen
    square, power, count = misfits(*reference, *other, lags, np.zeros(4), 7.0)
    for k, lag in enumerate(lags):
        gaps, both = [], []
        for j in range(180):
            seen = np.isfinite(reference.height_mm[:, j])
            z, h = reference.z_mm[seen, j], reference.height_mm[seen, j]
            at = other.z_mm[:, j] - lag
            after = np.searchsorted(z, at)
            inside = (after > 0) & (after < z.size)
            inside[inside] &= z[after[inside]] - z[after[inside] - 1] <= 7.0
            inside[inside] &= h[after[inside]] - h[after[inside] - 1] <= SHADE_MM
            there = np.interp(at[inside], z, h)
            gaps += list(other.height_mm[inside, j] - there)
            both += list(0.5 * (other.height_mm[inside, j] ** 2 + there**2))
        assert count[k] == len(gaps)
        assert square[k] == pytest.approx(np.sum(np.square(gaps)))
        assert power[k] == pytest.approx(np.sum(both))


def test_a_joint_stands_all_around_at_one_place():
    rng = np.random.default_rng(5)
    z = np.arange(0, 60, 5.0)[:, None] + 3.0 * np.sin(2 * np.pi * np.arange(180) / 180)[None, :]
    joint = _bell(z, 31.0) + 0.05 * rng.standard_normal(z.shape)
    joint[:, :18] = np.nan  # the strut
    assert joint_mm(Profile(z, joint), 0.4) == pytest.approx(31.0, abs=1.0)
    assert joint_mm(_profile(rng), 0.4) is None


def _drive(pipe, settings, frames=112, step_mm=5.0, jag=None, worn_pct=WORN_PCT, told=NOMINAL):
    """A robot on the axis with exact sensors but worn wheels; the slide may be jagged. The state at the end."""
    method = Method.model_validate({"localisation": settings})
    state = begin(RIG, told, method)
    per_mm = RIG.wheels.counts_per_turn / (np.pi * np.array(RIG.wheels.diameters_mm))
    up = RIG.imu.R_camera_imu.T @ np.array([0.0, -9.80665, 0.0])
    attitude = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(frames):
        T = np.eye(4)
        T[:3, 3] = 1.5, -1.0, step_mm * k
        stamp, noise = int(k * 1e8), PointNoise(pixel_noise_px=0.1, drop_out_share=0.0, azimuths=240)
        seen = see_slits(pipe, T, RIG, noise, stream(0, "points", k))
        if jag is not None:
            seen = _jagged(seen, jag)
        imu = np.tile(np.concatenate([np.zeros(3), up]), (8, 1))
        stamps = stamp - 10_000_000 * np.arange(7, -1, -1, dtype=np.int64)
        counts = T[2, 3] * (1 + worn_pct / 100) * per_mm
        step(
            state,
            Frame(
                k, stamp, None, None, attitude, counts, stamps[-1:] if k == 0 else stamps, imu[-1:] if k == 0 else imu
            ),
            seen,
        )
    return state


def _jagged(seen: SlitPixels, jag: np.ndarray) -> SlitPixels:
    """Every slit pixel moved outward by what the slide has at its place, the same in every frame."""
    out = seen.pixel - [RIG.camera.cx_px, RIG.camera.cy_px]
    around = np.floor((np.arctan2(out[:, 0], -out[:, 1]) / (2 * np.pi) % 1) * jag.shape[1]).astype(int)
    shift = jag[seen.slit, around] / np.linalg.norm(out, axis=1)
    return replace(seen, pixel=seen.pixel + shift[:, None] * out)


def test_on_a_bare_wall_a_jagged_slide_makes_no_travel():
    pipe = Pipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5, end_mm=1200)
    jag = 1.0 * np.random.default_rng(6).standard_normal((len(RIG.projector.slits), 90))
    fused, featured = (_drive(pipe, {"kind": kind}, 60, jag=jag) for kind in ("fused", "featured"))
    assert featured.where.filter.x[:2] == pytest.approx(fused.where.x[:2], abs=1e-9)
    found = finish(featured)
    assert np.isinf(found.trajectory.axis_std[:, [2, 5]]).all()
    assert np.isfinite(found.trajectory.axis_std[:, [0, 1, 3, 4]]).all()


@pytest.mark.parametrize("worn_pct", [WORN_PCT, 0.0])
def test_features_of_the_wall_show_whether_the_wheels_are_worn(worn_pct):
    pipe = Pipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5, end_mm=1200, features=POCKETS)
    state = _drive(pipe, {"kind": "featured", "wheels": {"common_scale_std_pct": 2.0}}, worn_pct=worn_pct)
    found = finish(state)
    true_mm = 5.0 * np.arange(112)
    error = found.trajectory.T_pipe_camera[:, 2, 3] - true_mm
    assert abs(error[-1]) < 1e-3 * true_mm[-1]
    assert abs(error[-1]) < 4 * np.sqrt(found.trajectory.covariance[-1, 2, 2])
    measured = np.isfinite(found.trajectory.axis_std[:, 2])
    assert 0 < measured.sum() < 100
    assert not measured[:10].any()


def test_a_joint_of_the_list_ties_the_distance_and_the_map():
    pipe = Pipe(
        inner_radius_mm=BORE_MM,
        wall_thickness_mm=7.5,
        end_mm=1200,
        joints=[{"distance_mm": 400, "gap_depth_mm": 2, "gap_mm": 6}],
    )
    settings = {"kind": "featured", "wheels": {"common_scale_std_pct": 2.0}}
    state = _drive(pipe, settings, told=NOMINAL.model_copy(update={"joints_mm": (400.0, 5000.0)}))
    found = finish(state)
    assert {episode.who for episode in found.episodes if episode.kind == "joint"} == {"joint at 400 mm"}
    error = found.trajectory.T_pipe_camera[:, 2, 3] - 5.0 * np.arange(112)
    assert np.abs(error[[60, 90, -1]]).max() < 2.5
    rows = np.nanmax(np.nan_to_num(found.wall.radius_mm), axis=0)
    assert found.wall.z_mm[np.argmax(rows)] == pytest.approx(400, abs=4)


def test_a_map_goes_with_the_frames_that_made_it():
    theta, z = (np.arange(36) + 0.5) * np.pi / 18, np.arange(200) + 0.5
    radius = np.full((36, 200), BORE_MM)
    radius[9, 100] = 80.0
    wall = WallMap(theta, z, radius, radius * 0, radius * 0, np.ones((36, 200), dtype=np.int32))
    at = np.arange(0.0, 100.0)
    move = np.column_stack([np.full(100, 5.0), np.full(100, np.radians(20.0))])
    found = straightened(wall, at, move, 60.0)
    row, column = np.argwhere(found.radius_mm == 80.0)[0]
    assert (row, found.z_mm[column]) == (11, pytest.approx(105.5))
    assert np.count_nonzero(found.radius_mm == 80.0) == 1


def test_a_moved_pose_keeps_its_fit():
    T = np.eye(4)
    T[:3, 3] = 3.0, -2.0, 50.0
    information = np.diag([4.0, 9.0, 1.0, 1e6, 2e6, 1e4])
    found = moved(Alignment(T, information), 7.0, np.pi / 2, np.diag([0.25, 1e-4]))
    assert found.T_pipe_camera[:3, 3] == pytest.approx([2.0, 3.0, 57.0])
    assert np.diag(found.information) == pytest.approx([9.0, 4.0, 4.0, 2e6, 1e6, 1e4])
