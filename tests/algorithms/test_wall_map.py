"""The wall map: the weighted median of each cell's points, and nothing where none fell."""

from __future__ import annotations

import errno
import os
from dataclasses import replace

import numpy as np
import pytest

from algorithms import closed_blocks, large_arrays, wall_map
from algorithms.hindsight import straightened
from algorithms.types import Alignment, RingPoints
from algorithms.wall_map import FEW, MapBuilder, MapSettings, _reduce, add_points, finish_map, on_a_wall
from sensor_model.geometry import wall_direction
from sensor_model.recording import NominalPipe

NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
HERE = Alignment(np.eye(4), np.eye(6))


def _ring(theta, z, radius, sigma=0.2):
    xyz = wall_direction(theta) * np.broadcast_to(radius, theta.shape)[:, None]
    xyz[:, 2] = z
    light = wall_direction(theta) * 0.5 + [0, 0, 0.8]
    n = theta.size
    return RingPoints(xyz, np.zeros(n, np.int64), np.zeros((n, 2)), light, np.broadcast_to(float(sigma), n).copy())


def _everything(points):
    return np.ones(points.sigma_mm.size, dtype=bool)


def test_cells_hold_the_wall_and_what_was_not_seen_stays_empty():
    theta = np.radians(np.arange(0.25, 300, 0.5))
    builder = MapBuilder(MapSettings())
    for z in np.arange(0.1, 30, 0.25):
        points = _ring(theta, np.full(theta.size, z), 76.2 + 2 * np.cos(theta))
        add_points(builder, points, _everything(points), HERE)
    wall = finish_map(builder)
    row = np.searchsorted(wall.z_mm, 10)
    assert np.allclose(wall.radius_mm[:299, row], 76.2 + 2 * np.cos(wall.theta_rad[:299]), atol=0.02)
    assert not wall.seen[301:].any()
    assert np.isnan(wall.radius_mm[301:]).all()
    assert wall.z_mm[wall.scanned()][[0, -1]] == pytest.approx([0.5, 29.5])


def test_a_few_wild_points_do_not_move_a_cell():
    theta = np.full(9, np.radians(10.5))
    radius = np.array([76.2] * 7 + [83.0, 60.0])
    points = _ring(theta, np.full(9, 5.5), radius)
    builder = MapBuilder(MapSettings())
    add_points(builder, points, _everything(points), HERE)
    wall = finish_map(builder)
    assert np.nanmax(wall.radius_mm) == pytest.approx(76.2, abs=1e-4)


def test_points_beyond_the_wall_are_no_wall():
    theta = np.radians([10.0, 20.0, 30.0, 40.0])
    points = _ring(theta, np.zeros(4), np.array([76.2, 83.7, 90.0, 20.0]))
    assert on_a_wall(points, np.eye(4), NOMINAL).tolist() == [True, True, False, False]


def test_noise_on_a_floor_as_deep_as_the_wall_is_kept_on_both_sides():
    noise = np.random.default_rng(0).normal(0, 1.5, 360)
    points = _ring(np.radians(np.arange(360.0)), np.zeros(360), 83.7 + noise, sigma=2.8)  # along light at 32 degrees
    radius = np.hypot(*points.xyz_mm[on_a_wall(points, np.eye(4), NOMINAL), :2].T)
    assert np.median(radius) == pytest.approx(np.median(83.7 + noise), abs=0.1)


def test_compiled_reduction_agrees_with_plain_numpy():
    rng = np.random.default_rng(0)
    cell = np.append(rng.integers(0, 40, 400), np.full(2 * FEW, 7))  # one that many points fell into
    slope = rng.uniform(0.3, 0.8, cell.size)
    points = np.column_stack([cell, rng.normal(76, 1, cell.size), rng.uniform(0.5, 3, cell.size), slope])
    kinds = [("cell", "i4"), ("radius", "f8"), ("weight", "f8"), ("slope", "f8")]
    radius, spread, sigma, count, steepest = _reduce(np.array(list(map(tuple, points)), dtype=kinds), 50)
    for c in range(50):
        mine = points[cell == c]
        assert count[c] == len(mine)
        if len(mine) == 0:
            assert np.isnan(radius[c])
            assert np.isnan(steepest[c])
            continue
        assert steepest[c] == mine[:, 3].max()
        order = mine[np.argsort(mine[:, 1])]
        weight = order[:, 2] * order[:, 1] ** 4
        half = np.searchsorted(np.cumsum(weight), weight.sum() / 2)
        assert radius[c] == order[half, 1]
        assert sigma[c] == pytest.approx(np.mean(mine[:, 2]) ** -0.5)
        assert spread[c] == pytest.approx(1.4826 * np.median(np.abs(mine[:, 1] - radius[c])))


def test_a_floor_counts_as_much_as_the_wall_beside_it_seen_by_the_same_slits():
    radius = np.repeat([76.2, 83.7], [3, 4])
    ring = _ring(np.radians(np.full(7, 90.5)), np.full(7, 0.5), radius)
    ring = replace(ring, sigma_mm=0.2 * (radius / 76.2) ** 2)
    builder = MapBuilder(MapSettings())
    add_points(builder, ring, _everything(ring), HERE)
    wall = finish_map(builder)
    assert np.nanmax(wall.radius_mm) == pytest.approx(83.7)
    assert np.nanmax(wall.sigma_mm) == pytest.approx(0.5 * np.mean(ring.sigma_mm**-2.0) ** -0.5)  # across the wall


def test_memory_stays_flat_and_late_points_still_count():
    theta = np.radians(np.arange(0.5, 360, 1.0))
    builder = MapBuilder(MapSettings())
    for z in np.arange(0.5, 3000, 1.0):
        points = _ring(theta, np.full(theta.size, z), 76.2)
        add_points(builder, points, _everything(points), HERE)
        assert len(builder.waiting) <= 3
    late = _ring(theta, np.full(theta.size, 200.5), 78.2)
    add_points(builder, late, _everything(late), HERE)
    wall = finish_map(builder)
    assert wall.seen.all()
    row = np.searchsorted(wall.z_mm, 200.4)
    assert np.allclose(wall.radius_mm[:, row], 77.2, atol=1e-3)  # one early, one late
    assert wall.count[0, row] == 2


def _there_and_back():
    theta, rng = np.radians(np.arange(0.5, 360, 2.0)), np.random.default_rng(0)
    builder = MapBuilder(MapSettings())
    for z in [*np.arange(0.5, 1200, 5.0), *np.arange(1150.5, 0, -35.0), 2000.5]:
        points = _ring(theta, np.full(theta.size, z), rng.normal(76.2, 0.1, theta.size))
        add_points(builder, points, _everything(points), HERE)
    return builder


def test_blocks_and_maps_in_files_are_those_in_memory(monkeypatch):
    whole = finish_map(_there_and_back())
    monkeypatch.setattr(closed_blocks, "MOST_CELLS", 3 * 360 * 100)
    monkeypatch.setattr(large_arrays, "LARGE_BYTES", 1000)
    monkeypatch.setattr(large_arrays, "PIECE_CELLS", 4 * 360 * 100)
    builder = _there_and_back()
    assert len(builder.done.latest) == 3
    in_files = finish_map(builder)
    for name in ("z_mm", "radius_mm", "spread_mm", "sigma_mm", "count"):
        assert np.array_equal(getattr(in_files, name), getattr(whole, name), equal_nan=True)
    z_mm, ahead = np.arange(0.0, 2000, 50), 0.0
    move = np.column_stack([0.01 * z_mm, 1e-4 * z_mm])
    both = [straightened(wall, z_mm, move, ahead) for wall in (whole, in_files)]
    assert np.array_equal(both[0].radius_mm, both[1].radius_mm, equal_nan=True)
    assert both[0].scanned() == both[1].scanned()


@pytest.mark.parametrize("pct", [0.5, 40.0, 50.0, 99.5])
def test_a_percentile_line_by_line_is_numpys(pct):
    rng = np.random.default_rng(0)
    for shape in [(1, 1), (3, 7), (20, 301)]:
        values = rng.normal(0, 1, shape)
        values[rng.random(shape) < 0.3] = np.nan
        values[0, 0] = 0.1
        assert large_arrays.percentile(values, pct) == np.nanpercentile(values, pct)
    assert np.isnan(large_arrays.percentile(np.full((2, 3), np.nan), pct))


def test_a_full_disk_is_said_before_anything_is_written(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match=r"no room for 80 MB of the wall map \(No space left on device\); TMPDIR may"):
        large_arrays.room((100, 100_000), np.float64)


def test_a_robot_that_goes_to_and_fro_fills_no_memory(monkeypatch):
    monkeypatch.setattr(wall_map, "MOST_WAITING", 2000)
    builder, theta = MapBuilder(MapSettings()), np.radians(np.arange(0.5, 360, 1.0))
    for z in [50.5, 150.5, 250.5] * 20:
        points = _ring(theta, np.full(theta.size, z), 76.2)
        add_points(builder, points, _everything(points), HERE)
        held = sum(part.size for block in builder.waiting.values() for part in block)
        assert builder.held == held <= 2000
    wall = finish_map(builder)
    assert builder.held == 0
    assert wall.count.sum() == 60 * theta.size
