"""False slits in the map: what no light can have reached is dropped, and what it can have stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from algorithms.robust import MAD_TO_SIGMA
from algorithms.sizing.background import deviation_mm, noise_of_rows, seen_medians
from algorithms.sizing.measure import SizingSettings, measure_defects
from algorithms.sizing.unlit import (
    AGREE_SHARE,
    FLOOR_CELLS,
    MARGIN_MM,
    MARGIN_SIGMAS,
    SPIKE,
    SPIKE_SHARE,
    drop_unlit,
    unlit,
)
from algorithms.types import WallMap
from sensor_model.recording import NominalPipe
from twin.pipe import Pipe

STEEPEST = np.radians(36.9)
NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)


def _scanned(feature, noise=0.03):
    """A map of a defect in the middle of 300 mm, in which nothing lies where no light falls."""
    pipe = Pipe.model_validate({
        "inner_radius_mm": 76.2, "wall_thickness_mm": 7.5, "end_mm": 600,
        "features": [{"distance_mm": 150, "clock_deg": 120} | feature],
    })  # fmt: skip
    theta, z = (np.arange(360) + 0.5) * 2 * np.pi / 360, np.arange(0.5, 300.0, 1.0)
    depth = pipe.radius(theta[:, None], z[None, :]) - 76.2
    # the steepest light that passes all that stands before a place
    slope = np.tan(STEEPEST)
    lowest = np.minimum.accumulate(depth - slope * z, axis=1) + slope * z
    radius = 76.2 + depth + np.random.default_rng(0).normal(0, noise, depth.shape)
    radius[depth > lowest + 1e-9] = np.nan
    level = np.where(np.isfinite(radius), noise, np.nan)
    return WallMap(theta, z, radius, level, level.copy(), np.where(np.isfinite(radius), 2, 0))


def _astray(wall, columns, row, depth_mm):
    """One slit, taken for another in one picture: some lines long, seen once."""
    wall.radius_mm[columns, row], wall.count[columns, row] = 76.2 + depth_mm, 1
    wall.sigma_mm[columns, row] = wall.spread_mm[columns, row] = 0.1


def _sized(wall):
    deviation = deviation_mm(wall)
    (found,) = measure_defects(wall, deviation, noise_of_rows(wall, deviation), NOMINAL, STEEPEST, SizingSettings())
    return found


@pytest.mark.parametrize(
    "feature",
    [
        {"kind": "pocket", "length_mm": 70, "width_mm": 35, "depth_mm": 7.5},
        {"kind": "pocket", "length_mm": 10, "width_mm": 10, "depth_mm": 4},
        {"kind": "pit", "diameter_mm": 12, "depth_mm": 3.5, "shape": "conical"},
        {"kind": "pit", "diameter_mm": 9, "depth_mm": 2.5, "shape": "spherical"},
        {"kind": "scratch", "path_length_mm": 40, "width_mm": 3, "depth_mm": 2, "heading_deg": 60},
    ],
)
def test_what_light_reaches_stays(feature):
    wall = _scanned(feature)
    before = wall.count.copy()
    drop_unlit(wall, STEEPEST)
    np.testing.assert_array_equal(wall.count, before)


def test_false_slits_in_a_pit_and_behind_it_change_nothing():
    feature = {"kind": "pit", "diameter_mm": 12, "depth_mm": 1.9}
    clean, spoiled = _scanned(feature), _scanned(feature)
    places = ((117, 146, 5.9), (121, 151, 7.9), (118, 154, 7.0))
    for column, row, depth in places:
        _astray(spoiled, slice(column, column + 3), row, depth)
        _astray(spoiled, slice(column, column + 3), row + 1, 0.98 * depth)  # and again in the next picture
    assert np.nansum(spoiled.radius_mm > 76.2 + 3) == 18
    drop_unlit(spoiled, STEEPEST)
    assert not np.any(spoiled.radius_mm > 76.2 + 3)
    true, found = _sized(clean), _sized(spoiled)
    sizes = np.array([[one.length_mm, one.width_mm, one.depth_mm] for one in (true, found)])
    assert np.abs(sizes[1] - sizes[0]).max() < 0.5


def test_what_two_pictures_show_alike_out_of_a_floor_is_dropped():
    feature = {"kind": "pocket", "length_mm": 35, "width_mm": 18, "depth_mm": 2}
    clean, spoiled = _scanned(feature), _scanned(feature)
    _astray(spoiled, slice(112, 128), 148, 6.4)
    spoiled.count[112:128, 148] = 2
    drop_unlit(spoiled, STEEPEST)
    assert not spoiled.count[112:128, 148].any()
    true, found = _sized(clean), _sized(spoiled)
    assert found.floor_seen
    assert found.depth_mm == pytest.approx(true.depth_mm, abs=0.05)


def test_in_a_map_that_saw_each_cell_once_a_spike_is_told_by_more_of_the_floor():
    spoiled = _scanned({"kind": "pocket", "length_mm": 40, "width_mm": 25, "depth_mm": 3.5})
    rng = np.random.default_rng(0)
    spoiled.count[:] = np.where(rng.random(spoiled.count.shape) < 0.5, spoiled.count > 0, 0)
    _astray(spoiled, slice(112, 128), 138, 7.5)
    empty = spoiled.count == 0
    for values in (spoiled.radius_mm, spoiled.spread_mm, spoiled.sigma_mm):
        values[empty] = np.nan
    drop_unlit(spoiled, STEEPEST)
    assert not np.any(spoiled.radius_mm > 76.2 + 5)
    assert np.count_nonzero(spoiled.radius_mm > 76.2 + 3) > 300


def test_a_side_that_runs_within_a_line_keeps_its_floor():
    wall = _scanned({"kind": "pocket", "length_mm": 70, "width_mm": 35, "depth_mm": 7.5})
    floor = np.flatnonzero(wall.count.any(axis=1) & (np.nanmax(wall.radius_mm, axis=1) > 76.2 + 7))
    column, first, last = floor[0] - 1, 150, 180  # the robot rolls, and the line begins to see more floor than wall
    wall.radius_mm[column, first:last] = wall.radius_mm[floor[0], first:last]
    before = wall.count.copy()
    assert np.all(wall.radius_mm[column, first:last] > 76.2 + 7)
    drop_unlit(wall, STEEPEST)
    np.testing.assert_array_equal(wall.count, before)


def test_light_of_a_flatter_slit_reaches_less_deep():
    steep, flat = (_scanned({"kind": "pocket", "length_mm": 70, "width_mm": 35, "depth_mm": 7}) for _ in range(2))
    known = np.full(flat.count.shape, np.tan(STEEPEST), dtype=np.float32)
    row = 122  # 7.5 mm behind the rim, where the steepest light is 5.6 mm deep, and no floor was seen yet
    for wall in (steep, flat):
        _astray(wall, slice(112, 128), row, 5)
        wall.count[112:128, row] = 4
    known[112:128, row] = np.tan(np.radians(20))
    drop_unlit(steep, STEEPEST)
    drop_unlit(replace(flat, light_slope=known), STEEPEST)
    assert steep.count[112:128, row].all()
    assert not flat.count[112:128, row].any()


def test_the_compiled_search_is_the_plain_one():
    rng = np.random.default_rng(1)
    radius = 50 + rng.normal(0, 0.05, (24, 60)) + np.where(rng.random((24, 60)) < 0.15, rng.uniform(0, 6, (24, 60)), 0)
    radius[rng.random(radius.shape) < 0.2] = np.nan
    count = np.where(np.isfinite(radius), rng.integers(1, 4, radius.shape), 0)
    rows, cell, reach, wide = (10, 50), 2.0, 2, 4
    assert np.median(count[count > 0]) > 1  # else it would look further
    slope = rng.uniform(0.2, 0.4, radius.shape).astype(np.float32)
    level = seen_medians(radius, *rows)
    depth = radius - level[:, None]
    inside = slice(*rows)
    off = np.abs(depth[:, inside][count[:, inside] > 0])
    margin = MARGIN_MM + MARGIN_SIGMAS * MAD_TO_SIGMA * np.median(off)
    usual = np.median(count[:, inside][count[:, inside] > 0])

    def heard(m, i, j):
        """Points that are as deep, points against them, whether they are astray, whether line m sees a floor."""
        rise, near, own = cell * slope[i, j], slice(j - reach, j + reach + 1), slice(j - wide, j + wide + 1)
        alike = depth[m] >= AGREE_SHARE * depth[i, j]
        agree, beside = count[m, own][alike[own]], count[m, own][depth[m, own] < AGREE_SHARE * depth[i, j]].sum()
        spike = depth[m, own] > SPIKE_SHARE * depth[i, j]
        floor = count[m, own][~spike & (depth[m, own] > margin)].sum()
        before = np.arange(max(j - int(np.ceil(depth[i, j] / rise)), 0), j)
        against = count[m, before][depth[m, before] < depth[i, j] - (j - before + 1) * rise - margin].sum()
        stray = (agree.size == 1 and agree.sum() < min(usual, beside)) or SPIKE * count[m, own][spike].sum() <= floor
        with_it = count[m, near][alike[near]].sum()
        is_floor = agree.sum() >= max(beside, FLOOR_CELLS * usual) and against < with_it and not stray
        return with_it, against if with_it else 0, stray, is_floor

    expected = []
    for i in range(24):
        for j in range(*rows):
            if depth[i, j] > 2 * cell * slope[i, j] + margin:
                lines = [heard(m, i, j) for m in (i - 1, i, (i + 1) % 24)]
                with_it, against = np.sum([line[:2] for line in lines], axis=0)
                floor = lines[0][3] or lines[2][3]
                if (lines[1][2] or against >= with_it) and not floor:
                    expected.append((i, j))
    found = list(zip(*unlit(radius, level, count, slope, rows, cell, (reach, wide, 10)), strict=True))
    assert found == expected
    assert 20 < len(expected) < 0.15 * radius.size
