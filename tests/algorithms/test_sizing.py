"""Sizing from a map whose truth is known: background, threshold, extents, depth, and what was not seen."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms import large_arrays
from algorithms.robust import spread
from algorithms.sizing.background import (
    RowNoise,
    deviation_mm,
    noise_of_rows,
    rows_of,
    seen_medians,
    smooth_from,
    spreads_near,
)
from algorithms.sizing.disposition import at_least, disposition
from algorithms.sizing.edges import Edges, extent_of
from algorithms.sizing.measure import SizingSettings, measure_defects
from algorithms.sizing.segment import groups_along, numbered, segment
from algorithms.sizing.thresholds import THRESHOLDS, ThresholdSettings
from algorithms.types import WallMap
from sensor_model.recording import NominalPipe
from twin.pipe import Pipe

NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
STEEPEST = np.radians(36.9)
POCKET = {"kind": "pocket", "distance_mm": 150, "clock_deg": 120, "length_mm": 70, "width_mm": 35, "depth_mm": 7.5}


def _map(pipe, noise=0.03, length=300.0, seed=0, hide=None):
    theta = (np.arange(360) + 0.5) * 2 * np.pi / 360
    z = np.arange(0.5, length, 1.0)
    radius = pipe.radius(theta[:, None], z[None, :])
    radius = radius + np.random.default_rng(seed).normal(0, noise, radius.shape)
    if hide is not None:
        radius[hide(theta[:, None], z[None, :])] = np.nan
    count = np.where(np.isfinite(radius), 4, 0)
    level = np.full(radius.shape, noise)
    return WallMap(theta, z, radius, level, level, count)


def _measure(wall, rule="noise", pipe=NOMINAL):
    deviation = deviation_mm(wall)
    settings = SizingSettings(threshold=ThresholdSettings(rule=rule))
    return measure_defects(wall, deviation, noise_of_rows(wall, deviation), pipe, STEEPEST, settings)


def _even(noise_mm, wall):
    return RowNoise(np.zeros(wall.z_mm.size), np.full(wall.z_mm.size, noise_mm))


def _pipe(*features, **settings):
    return Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=features, **settings)


@pytest.mark.parametrize("rule", sorted(THRESHOLDS))
def test_a_pocket_is_sized_to_a_fraction_of_a_cell(rule):
    (found,) = _measure(_map(_pipe(POCKET)), rule)
    assert found.length_mm == pytest.approx(70, abs=0.5)
    assert found.width_mm == pytest.approx(35, abs=0.7)
    assert found.depth_mm == pytest.approx(7.5, abs=0.1)
    assert found.distance_mm == pytest.approx(150, abs=0.3)
    assert np.degrees(found.theta_rad) == pytest.approx(120, abs=0.3)
    assert found.wall_loss_pct == pytest.approx(100, abs=1.5)
    assert not found.cut_by_scan_end


@pytest.mark.parametrize("clock_deg", [0.0, 3.0, 180.0, 359.0])
def test_the_seam_at_12_oclock_does_not_cut_a_defect(clock_deg):
    (found,) = _measure(_map(_pipe({**POCKET, "clock_deg": clock_deg})))
    assert found.width_mm == pytest.approx(35, abs=0.7)
    turn = (np.degrees(found.theta_rad) - clock_deg + 180) % 360 - 180
    assert turn == pytest.approx(0, abs=0.3)


def test_a_wall_loss_is_no_surer_than_the_wall():
    wall = _map(_pipe({**POCKET, "depth_mm": 3}))
    (known,), (by_standard,) = (
        _measure(wall, pipe=NOMINAL.model_copy(update={"wall_tolerance_pct": t})) for t in (0, 12)
    )
    assert known.wall_loss_pct == by_standard.wall_loss_pct == pytest.approx(40, abs=1)
    assert known.wall_loss_std_pct == pytest.approx(known.depth_std_mm / 7.5 * 100)
    spread = 40 * 0.12 / np.sqrt(12)  # a wall anywhere up to 12 % thicker
    assert by_standard.wall_loss_std_pct == pytest.approx(np.hypot(known.wall_loss_std_pct, spread), rel=0.02)


def test_an_oval_pipe_and_a_wrong_radius_are_no_defects():
    wall = _map(Pipe(inner_radius_mm=77.0, wall_thickness_mm=7.5, ovality_pct=3, ovality_clock_deg=40))
    assert _measure(wall) == ()
    (found,) = _measure(_map(_pipe(POCKET, ovality_pct=3)))
    assert found.depth_mm == pytest.approx(7.5, abs=0.25)


def test_noise_alone_is_no_defect_wherever_it_is_louder():
    theta_noise = _map(_pipe(), noise=0.05)
    radius = theta_noise.radius_mm.copy()
    radius[:, -30:] += np.random.default_rng(5).normal(0, 0.6, (360, 30))
    assert _measure(replace(theta_noise, radius_mm=radius)) == ()


@pytest.mark.parametrize(
    "feature",
    [
        {"kind": "pit", "distance_mm": 150, "clock_deg": 200, "diameter_mm": 24, "depth_mm": 4},
        {"kind": "pit", "distance_mm": 150, "clock_deg": 200, "diameter_mm": 24, "depth_mm": 4, "shape": "conical"},
        {"kind": "scratch", "distance_mm": 150, "clock_deg": 200, "path_length_mm": 80, "width_mm": 8, "depth_mm": 3},
        {**POCKET, "floor": "planar", "depth_mm": 4.0},
    ],
)
def test_every_family_is_found_and_sized(feature):
    pipe = _pipe(feature)
    true = pipe.features[0].size(76.2)
    (found,) = _measure(_map(pipe))
    # a cone's tip is narrower than the cells and their smoothing
    assert found.depth_mm == pytest.approx(true.depth_mm, abs=0.2 * true.depth_mm)
    assert found.length_mm == pytest.approx(true.length_mm, abs=3.0)
    assert found.width_mm == pytest.approx(true.width_mm, abs=3.0)


@pytest.mark.parametrize("rise", [0.4, 0.0], ids=["slope", "step"])
@pytest.mark.parametrize("sharper", [0.0, 0.3], ids=["all blunt", "some sharper"])
def test_a_side_that_blunt_slits_show_in_a_shadow_moves_no_rim(rise, sharper):
    shadow = 7.5 / np.tan(STEEPEST)

    def hidden(theta, z):
        return (np.abs(np.degrees(theta) - 120) < 13.2) & (z > 115 - 2) & (z < 115 + shadow + 2)

    wall = _map(_pipe(POCKET), hide=hidden)
    dark = hidden(wall.theta_rad[:, None], wall.z_mm[None])
    seen, another = np.random.default_rng(1).random((2, *dark.shape))
    side = dark & (wall.z_mm > 115) & (seen < 0.3)
    radius = np.where(side, 76.2 + (3.2 if rise == 0 else rise * (wall.z_mm - 115)), wall.radius_mm)
    blunt = np.where(side, np.where(another < sharper, 1.35, 2.0), 1.0) * wall.sigma_mm
    (found,) = _measure(replace(wall, radius_mm=radius, sigma_mm=blunt, count=np.where(np.isfinite(radius), 2, 0)))
    assert found.length_mm == pytest.approx(70, abs=1.0)


def test_a_side_that_runs_through_a_cell_lies_where_most_lines_have_it_and_a_bulge_counts():
    rng = np.random.default_rng(4)
    start = 13.4 + 0.05 * rng.standard_normal(60)
    end, open_ = np.full(60, 31.6), np.full(60, 0.1)
    bulge = start.copy()
    bulge[20:36] -= 3.0  # one in four lines, side by side
    start[rng.permutation(60)[:14]] = 12.9  # as many here and there, by less than a cell
    straight, bulged = (extent_of(Edges(edge, end, open_, open_), 1.0) for edge in (start, bulge))
    assert straight.start_mm == pytest.approx(13.4, abs=0.05)
    assert bulged.start_mm == pytest.approx(10.4, abs=0.1)


def test_a_few_cells_that_only_blunt_slits_show_make_no_floor_deeper():
    wall = _map(_pipe({**POCKET, "depth_mm": 5.0}), noise=0.2)
    stray = np.zeros(wall.seen.shape, dtype=bool)
    stray[117:119, 165:168] = True
    blunt = np.where(stray, 2.0, 1.0) * wall.sigma_mm
    (found,) = _measure(replace(wall, radius_mm=wall.radius_mm + 1.5 * stray, sigma_mm=blunt))
    assert found.depth_mm == pytest.approx(5.0, abs=0.25)


@pytest.mark.parametrize("margin_mm", [2.5, 4.0])
def test_a_shadow_under_the_near_rim_does_not_move_the_edge(margin_mm):
    start, run = 115.0, 7.5 / np.tan(STEEPEST)

    def hidden(theta, z):
        inside = np.abs(np.degrees(theta) - 120) < 13.2
        return inside & (z > start - margin_mm) & (z < start + run + margin_mm)

    (found,) = _measure(_map(_pipe(POCKET), hide=hidden))
    assert found.start_mm == pytest.approx(start, abs=0.7)
    assert found.length_mm == pytest.approx(70, abs=1.0)
    assert found.length_std_mm < 3.0


def test_a_few_stray_cells_do_not_deepen_a_floor():
    wall = _map(_pipe(POCKET), noise=0.05)
    strayed = wall.radius_mm.copy()
    strayed[118:121, 118:121] = 76.2 + 11.0  # three by three, at the near rim, 3.5 mm below the floor
    for radius in (wall.radius_mm, strayed):
        (found,) = _measure(replace(wall, radius_mm=radius))
        assert found.depth_mm == pytest.approx(7.5, abs=0.1)
        assert found.length_mm == pytest.approx(70, abs=1.5)


def test_a_pit_in_a_floor_is_the_deepest_place():
    pit = {"kind": "pit", "distance_mm": 150, "clock_deg": 120, "diameter_mm": 12, "depth_mm": 5.0}
    (found,) = _measure(_map(_pipe({**POCKET, "depth_mm": 2.5}, pit)))
    assert found.depth_mm == pytest.approx(5.0, abs=0.6)


def test_a_place_that_only_a_blurred_ring_saw_is_no_defect():
    wall = _map(_pipe(), noise=0.05)
    radius, sigma = wall.radius_mm.copy(), wall.sigma_mm.copy()
    place = np.s_[25:45, 140:150]
    radius[place] += np.random.default_rng(1).normal(0.3, 0.3, radius[place].shape)
    assert len(_measure(replace(wall, radius_mm=radius))) == 1
    sigma[place] *= 8  # the map says by whom it was seen
    assert _measure(replace(wall, radius_mm=radius, sigma_mm=sigma)) == ()


def test_a_defect_at_the_scans_end_is_reported_as_cut():
    (found,) = _measure(_map(_pipe({**POCKET, "distance_mm": 290})))
    assert found.cut_by_scan_end


def test_two_defects_are_two_and_come_in_order():
    other = {**POCKET, "distance_mm": 60, "clock_deg": 300, "length_mm": 30, "width_mm": 20, "depth_mm": 2}
    found = _measure(_map(_pipe(POCKET, other)))
    assert [round(d.distance_mm) for d in found] == [60, 150]


def test_an_empty_map_has_no_defect():
    wall = _map(_pipe())
    nothing = np.full(wall.radius_mm.shape, np.nan)
    assert _measure(replace(wall, radius_mm=nothing, count=np.zeros(nothing.shape, np.int64))) == ()


def test_segments_join_over_small_gaps_only():
    wall = _map(_pipe())
    deep = np.zeros(wall.radius_mm.shape, dtype=bool)
    deep[100:110, 50:60] = deep[100:110, 62:70] = deep[100:110, 80:90] = True
    labels = segment(deep, wall, 76.2, join_mm=3.0)
    assert len(np.unique(labels[labels > 0])) == 2
    assert labels[105, 55] == labels[105, 65] != labels[105, 85]


def _speckled(share, shape=(24, 50), seed=0):
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < share, np.nan, rng.normal(0, 1, shape))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.8, 1.0])
@pytest.mark.filterwarnings("ignore:All-NaN slice")
def test_the_compiled_medians_agree_with_numpy(share):
    values, bore = _speckled(share), np.linspace(-1, 1, 24)
    assert np.array_equal(seen_medians(values, 5, 30), np.nanmedian(values[:, 5:30], axis=1), equal_nan=True)

    wide = np.pad(np.pad(values - bore[:, None], ((1, 1), (0, 0)), "wrap"), ((0, 0), (1, 1)), constant_values=np.nan)
    nine = np.lib.stride_tricks.sliding_window_view(wide, (3, 3)).reshape(24, 50, 9)
    expected = np.where(np.isfinite(values), np.nanmedian(nine, axis=2), np.nan)
    smooth = np.full(values.shape, np.nan)
    for first in range(0, 50, 20):  # as blocks come
        smooth_from(values, bore, first, min(first + 20, 50), smooth)
    assert smooth == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True)

    sigma = np.full(values.shape, 0.5)
    middle, wide = rows_of(values.T.copy(), sigma.T.copy())
    for row, got in zip(values.T, zip(middle, wide, strict=True), strict=True):
        known = np.sort(row[np.isfinite(row)])
        half = known.size // 2
        ends = [(known[k + half] - known[k], (known[k] + known[k + half]) / 2) for k in range(known.size - half)]
        width, center = min(ends, default=(np.nan, np.nan))
        assert got == pytest.approx((center, 1.4826 * width), nan_ok=True)
    near = [wide[max(row - 3, 0) : row + 4] for row in range(50)]
    near = [part[np.isfinite(part)] for part in near]
    expected = [[np.median(part) if part.size else np.nan for part in near], [spread(part) for part in near]]
    assert np.array_equal(spreads_near(wide, 3), expected, equal_nan=True)


@pytest.mark.parametrize("seed", range(40))
def test_groups_are_those_that_scipy_labels_on_a_ring(seed):
    rng = np.random.default_rng(seed)
    deep = rng.random(rng.integers(8, 30, 2)) < rng.choice([0.02, 0.05, 0.1, 0.3])
    arc, along = rng.integers(0, 4, 2)
    near = ndimage.grey_dilation(deep.astype(np.uint8), size=(2 * arc + 1, 2 * along + 1), mode=("wrap", "constant"))
    # a row repeated at the far end carries labels over the seam; groups that it links are one
    labels, count = ndimage.label(np.vstack([near, near[:1]]), structure=np.ones((3, 3)))
    links = labels[0] > 0
    graph = coo_array((np.ones(links.sum()), (labels[0][links], labels[-1][links])), shape=(count + 1, count + 1))
    expected = np.where(deep, connected_components(graph, directed=False)[1][labels[:-1]], 0)
    found = numbered(deep, int(arc), int(along))
    pairs = set(zip(expected.ravel(), found.ravel(), strict=True))
    assert len(pairs) == np.unique(expected).size == np.unique(found).size

    cuts = np.unique(rng.integers(1, deep.shape[1], 4))  # as they come piece by piece: no other, and known in order
    came = sorted(groups_along(np.split(deep, cuts, axis=1), (int(arc), int(along)), 1), key=lambda one: one.order)
    assert [set(zip(one.columns, one.rows, strict=True)) for one in came] == [
        set(zip(*np.nonzero(found == number), strict=True)) for number in range(1, found.max() + 1)
    ]
    assert all(np.all(np.diff(one.columns * deep.shape[1] + one.rows) > 0) for one in came)


@pytest.mark.parametrize("rule", sorted(THRESHOLDS))
def test_a_map_sized_in_pieces_has_the_very_defects_of_the_whole(rule, monkeypatch):
    features = [
        {**POCKET, "distance_mm": 90, "length_mm": 20, "depth_mm": 3, "clock_deg": 0},
        {**POCKET, "distance_mm": 225, "length_mm": 180, "width_mm": 8, "depth_mm": 2},  # longer than three pieces
        {"kind": "scratch", "distance_mm": 270, "clock_deg": 250, "path_length_mm": 120, "width_mm": 4, "depth_mm": 1}
        | {"heading_deg": 20},
        {**POCKET, "distance_mm": 360, "length_mm": 12, "clock_deg": 60},
        {"kind": "dent", "distance_mm": 405, "clock_deg": 200, "length_mm": 30, "width_mm": 25, "depth_mm": 4},
    ]

    def hidden(theta, z):
        degrees = np.degrees(theta)
        strut, slot = np.abs(degrees - 300 - z / 50) < 15, (np.abs(degrees - 30) < 6) & (z > 200) & (z < 320)
        return strut | slot | (np.random.default_rng(3).random((degrees + z).shape) < 0.02)

    wall = _map(_pipe(*features), noise=0.05, length=500, hide=hidden)
    whole = _measure(wall, rule)
    assert len(whole) >= 5
    assert {"inward", "through"} < {defect.feature_class for defect in whole}
    for rows in (45, 64):
        monkeypatch.setattr(large_arrays, "PIECE_CELLS", rows * 360)
        assert repr(_measure(wall, rule)) == repr(whole)


def test_sizing_a_longer_pipe_takes_no_more_memory(monkeypatch):
    monkeypatch.setattr(large_arrays, "PIECE_CELLS", 45 * 360)
    monkeypatch.setattr(large_arrays, "LARGE_BYTES", 1000)
    peaks = []
    for length in (300, 1500):
        pits = [{"kind": "pit", "distance_mm": z, "clock_deg": 90, "diameter_mm": 20, "depth_mm": 3} for z in (90, 210)]
        wall = _map(_pipe(*pits), length=length, hide=lambda theta, z: np.degrees(theta) + 0 * z < 37)
        assert len(_measure(wall)) == 2  # compiled by now
        tracemalloc.start()
        _measure(wall)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def _hidden_start(start, run, half_deg=30):
    """Cells that the near rim keeps in the dark, from a start on."""
    return lambda theta, z: (np.abs(np.degrees(theta) - 120) < half_deg) & (z > start) & (z < start + run)


def test_a_floor_that_was_lit_is_said_to_be_so_behind_a_shadow():
    (found,) = _measure(_map(_pipe(POCKET), hide=_hidden_start(114, 12)))
    assert found.floor_seen
    assert found.depth_mm == pytest.approx(7.5, abs=0.05)


def test_a_floor_in_the_dark_has_a_least_depth_only():
    cone = {**CONE, "depth_mm": 6}
    (found,) = _measure(_map(_pipe(cone), hide=_hidden_start(130, 23)))
    assert not found.floor_seen
    assert at_least(found.depth_mm, found.depth_std_mm) < 6
    assert found.depth_mm < 5.8


CONE = {"kind": "pit", "distance_mm": 150, "clock_deg": 120, "diameter_mm": 24, "depth_mm": 4, "shape": "conical"}


@pytest.mark.parametrize("noise", [0.01, 0.03, 0.06])
def test_noise_makes_no_floor_deeper_and_no_pocket_larger(noise):
    flat = {**POCKET, "depth_mm": 3}
    found = [_measure(_map(_pipe(flat), noise=noise, seed=seed))[0] for seed in range(6)]
    assert np.mean([d.depth_mm for d in found]) == pytest.approx(3, abs=0.5 * noise)
    assert np.mean([d.length_mm for d in found]) == pytest.approx(70, abs=0.15)
    assert np.mean([d.width_mm for d in found]) == pytest.approx(35, abs=0.25)


def test_stated_intervals_hold_the_truth_on_plain_maps():
    held = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        pocket = {**POCKET, "distance_mm": 150 + rng.uniform(-1, 1), "clock_deg": 120 + rng.uniform(-1, 1)}
        pipe = _pipe({**pocket, "length_mm": 40 + rng.uniform(-1, 1), "depth_mm": rng.uniform(1.5, 7.5)})
        true = pipe.features[0].size(76.2)
        (d,) = _measure(_map(pipe, noise=0.05, seed=seed))
        error = np.array([d.length_mm, d.width_mm, d.depth_mm]) - true
        held.append(np.abs(error) <= 1.96 * np.array([d.length_std_mm, d.width_std_mm, d.depth_std_mm]))
    assert np.mean(held) > 0.9


def test_a_slanted_scratch_is_as_long_as_from_tip_to_tip():
    scratch = {"kind": "scratch", "distance_mm": 150, "clock_deg": 200, "path_length_mm": 80, "width_mm": 6}
    pipe = _pipe({**scratch, "depth_mm": 2, "heading_deg": 40})
    true = pipe.features[0].size(76.2)
    (found,) = _measure(_map(pipe))
    assert found.length_mm == pytest.approx(true.length_mm, abs=1.5)
    assert found.width_mm == pytest.approx(true.width_mm, abs=1.5)


@pytest.mark.parametrize("seed", range(3))
def test_a_long_shallow_scratch_is_one_though_noise_lifts_parts_of_it(seed):
    rng = np.random.default_rng(seed)
    wall, deviation = _map(_pipe()), rng.normal(0, 0.04, (360, 300))
    deviation[100:103, 100:180] += 0.42 + 0.08 * np.sin(np.arange(80) / 6)
    (found,) = measure_defects(wall, deviation, _even(0.04, wall), NOMINAL, STEEPEST, SizingSettings())
    assert found.length_mm == pytest.approx(80, abs=2)


def test_a_cone_s_tip_lies_where_its_sides_lead_to_and_a_bowl_has_none():
    off = {"conical": [], "spherical": []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        place = {"distance_mm": 150 + rng.uniform(-1, 1), "clock_deg": 120 + rng.uniform(-1, 1)}
        size = {"diameter_mm": rng.uniform(12, 28), "depth_mm": rng.uniform(2.5, 3.5)}
        for shape, errors in off.items():
            (found,) = _measure(_map(_pipe({**CONE, **place, **size, "shape": shape}), noise=0.05, seed=seed))
            errors.append((found.depth_mm - size["depth_mm"]) / np.array([size["depth_mm"], 1.96 * found.depth_std_mm]))
    for errors in off.values():
        share, held = np.transpose(errors)
        assert np.sqrt(np.mean(share**2)) < 0.05, share
        assert np.mean(np.abs(held) <= 1) > 0.9, held


def test_the_lips_of_a_hole_are_no_floor():
    hole = {"kind": "pocket", "distance_mm": 150, "clock_deg": 120, "length_mm": 9, "width_mm": 9, "depth_mm": 2.0}
    wall = _map(_pipe(hole))
    (lit,) = _measure(wall)
    assert lit.floor_seen
    inside = (slice(114, 126), slice(144, 156))
    count = wall.count.copy()
    count[inside] = np.where(np.random.default_rng(1).random((12, 12)) < 0.3, 4, 0)
    dim = replace(wall, count=count, radius_mm=np.where(count > 0, wall.radius_mm, np.nan))
    (lips,) = _measure(dim)
    assert not lips.floor_seen
    assert lips.disposition == "reject"
    assert lips.depth_mm <= lit.depth_mm + 0.1


def test_one_stray_line_moves_no_edge():
    wall = _map(_pipe({**POCKET, "depth_mm": 3}))
    radius = wall.radius_mm.copy()
    radius[118:120, 186:189] += 3.0  # beyond the far edge
    (found,) = _measure(replace(wall, radius_mm=radius))
    assert found.length_mm == pytest.approx(70, abs=1.0)


def test_the_volume_is_what_is_missing():
    (found,) = _measure(_map(_pipe({**POCKET, "depth_mm": 3})))
    assert found.volume_mm3 == pytest.approx(70 * 35 * 3 * (1 + 1.5 / 76.2), rel=0.04)


def test_a_defect_has_its_class_and_what_becomes_of_it():
    deep, shallow = ({**POCKET, "depth_mm": depth} for depth in (3.0, 0.6))
    assert _measure(_map(_pipe(deep)))[0].disposition == "reject"
    (found,) = _measure(_map(_pipe(shallow), noise=0.02))
    assert found.disposition == "accept"
    assert found.feature_class == "general"


@pytest.mark.parametrize(
    ("loss", "std", "seen", "said"),
    [
        (20.0, 2.0, True, "reject"),
        (5.0, 1.0, True, "accept"),
        (10.5, 1.0, True, "undecided"),
        (5.0, 1.0, False, "undecided"),
        (20.0, 2.0, False, "reject"),
    ],
)
def test_a_disposition_is_as_certain_as_the_loss(loss, std, seen, said):
    assert disposition(loss, std, seen, limit_pct=10.0) == said


def _cut(wall, columns):
    parts = (wall.radius_mm, wall.spread_mm, wall.sigma_mm, wall.count)
    return WallMap(wall.theta_rad, wall.z_mm[columns], *(part[:, columns] for part in parts))


def test_a_map_of_nothing_has_no_defect_and_in_one_row_of_cells_it_is_cut():
    wall = _map(_pipe(POCKET))
    assert _measure(_cut(wall, slice(0, 0))) == ()
    (found,) = _measure(_cut(wall, slice(150, 151)))
    assert found.cut_by_scan_end
    assert found.width_mm == pytest.approx(35, abs=1.96 * found.width_std_mm)
    assert found.length_std_mm > 1  # neither end was seen


DENT = {"kind": "dent", "distance_mm": 150, "clock_deg": 120, "length_mm": 40, "width_mm": 30, "depth_mm": 3}
HOLE = {"kind": "hole", "distance_mm": 150, "clock_deg": 120, "diameter_mm": 30, "depth_mm": 7.5}


def test_a_wall_that_stands_in_is_no_loss_and_not_silently_lost():
    wall = _map(_pipe(POCKET))
    (found,) = _measure(replace(wall, radius_mm=2 * 76.2 - wall.radius_mm))
    assert found.inward
    assert found.wall_loss_pct == found.volume_mm3 == 0
    assert found.disposition == ""


def test_a_dent_is_sized_by_its_height_beside_a_pocket():
    dent, pocket = _measure(_map(_pipe(DENT, {**POCKET, "distance_mm": 220, "clock_deg": 250})))
    assert (dent.feature_class, pocket.feature_class) == ("inward", "general")
    assert dent.depth_mm == pytest.approx(3, abs=0.1)
    assert dent.length_mm == pytest.approx(40, abs=0.8)
    assert dent.width_mm == pytest.approx(30, abs=1.0)
    assert pocket.depth_mm == pytest.approx(7.5, abs=0.1)


@pytest.mark.parametrize(("height_mm", "length_mm"), [(1.5, 8.0), (5.0, 20.0)])
def test_a_bead_all_around_is_a_ring(height_mm, length_mm):
    pipe = _pipe(joints=[{"distance_mm": 150, "bead_mm": length_mm, "bead_height_mm": height_mm}])
    (ring,) = _measure(_map(pipe, hide=lambda theta, z: (theta < 0.3) | (theta > 6.0) | (z < -1)))
    assert ring.feature_class == "inward ring"
    assert ring.depth_mm == pytest.approx(height_mm, abs=0.2)
    assert ring.length_mm == pytest.approx(length_mm, abs=0.5)
    assert ring.distance_mm == pytest.approx(150, abs=0.3)


@pytest.mark.parametrize(("length_mm", "arc_deg"), [(4, 360), (20, 360), (40, 360), (20, 180), (8, 270)])
def test_a_groove_around_the_pipe_is_no_noise_however_much_of_it_it_takes(length_mm, arc_deg):
    groove = lambda theta, z: (np.abs(z - 150) < length_mm / 2) & (np.abs(theta - np.pi) < np.radians(arc_deg / 2))  # noqa: E731
    strut = lambda theta, z: np.broadcast_to((theta < 0.32) | (theta > 5.96), (360, z.size))  # noqa: E731
    wall = _map(_pipe(), hide=strut)
    radius = wall.radius_mm + 1.5 * groove(wall.theta_rad[:, None], wall.z_mm[None])
    # cells differ in what they state of themselves, which a groove's depth has nothing to do with
    sigma = wall.sigma_mm * np.random.default_rng(1).choice([1.0, 3.0], radius.shape)
    (found,) = _measure(replace(wall, radius_mm=radius, sigma_mm=sigma))
    assert (found.length_mm, found.depth_mm) == pytest.approx((length_mm, 1.5), abs=0.1)
    assert found.width_mm == pytest.approx(np.radians(arc_deg) * 76.2, abs=1)
    # the strut may hide wall
    assert (found.width_std_mm > 20) == (arc_deg == 360)


def _dark(radius_mm):
    """What a hole of a radius hides of the map."""
    return lambda theta, z: np.hypot(z - 150, 76.2 * (theta - np.radians(120))) < radius_mm


def test_a_long_dark_place_goes_through_and_a_short_one_returned_no_light():
    (hole,) = _measure(_map(_pipe(), hide=_dark(15.0)))
    assert (hole.feature_class, hole.disposition) == ("through", "reject")
    assert hole.wall_loss_pct == 100
    assert hole.length_mm == pytest.approx(30, abs=2)
    assert hole.width_mm == pytest.approx(30, abs=3)
    assert np.degrees(hole.theta_rad) == pytest.approx(120, abs=1)
    (short,) = _measure(_map(_pipe(), hide=_dark(5.0)))
    assert (short.feature_class, short.floor_seen) == ("no light returned", False)
    assert at_least(short.depth_mm, short.depth_std_mm) == 0


def test_a_shadow_of_what_was_sized_is_no_hole():
    deep = {**POCKET, "length_mm": 80}
    hide = lambda theta, z: (np.abs(theta - np.radians(120)) < 0.25) & (np.abs(z - 115) < 6.6)  # noqa: E731
    (pocket,) = _measure(_map(_pipe(deep), hide=hide))
    assert pocket.feature_class == "general"
    (dent,) = _measure(_map(_pipe(DENT), hide=lambda theta, z: hide(theta, z - 62)))
    assert dent.inward


def test_a_sliver_of_a_defect_between_unseen_wall_is_as_long_as_a_cell_at_least():
    hide = lambda theta, z: (np.abs(theta - np.radians(120)) < 0.25) & (np.abs(z - 125) < 14)  # noqa: E731
    found = _measure(_map(_pipe({**POCKET, "length_mm": 80}), hide=hide))
    assert all(defect.length_mm >= 1 for defect in found)
    assert max(defect.length_mm for defect in found) == pytest.approx(51, abs=1)


def test_gaps_of_a_wall_that_few_rings_looked_at_are_no_holes():
    wall = _map(_pipe(), hide=_dark(15.0))
    assert _measure(replace(wall, count=np.minimum(wall.count, 1))) == ()


def test_a_small_hole_is_told_by_the_points_that_its_rows_lack():
    wall = _map(_pipe(), hide=_dark(2.2))
    (hole,) = _measure(wall)
    assert (hole.feature_class, hole.disposition) == ("no light returned", "undecided")
    assert (hole.length_mm, hole.width_mm) == pytest.approx((4.4, 4.4), abs=1.0)
    wall.count[:, 140:160] = np.minimum(wall.count[:, 140:160], 1)  # few rings looked at these rows
    assert _measure(wall) == ()


def test_lines_between_rings_that_cross_are_no_holes():
    slanted = _map(_pipe(), hide=lambda theta, z: np.abs(z - 100 - 76.2 * (theta - 2.0) / 3) < 1.5)
    slanted.radius_mm[:100], slanted.count[:100] = 76.2, 4
    slanted.radius_mm[140:], slanted.count[140:] = 76.2, 4
    assert not slanted.seen.all()
    assert _measure(slanted) == ()


def test_where_everything_is_a_defect_it_is_one_and_cut():
    wall = _map(_pipe(), length=60)
    deep = np.random.default_rng(0).normal(3, 0.03, wall.radius_mm.shape)
    (found,) = measure_defects(wall, deep, _even(0.03, wall), NOMINAL, STEEPEST, SizingSettings())
    assert found.cut_by_scan_end
    assert found.depth_mm == pytest.approx(3, abs=0.05)
    assert found.width_mm == pytest.approx(2 * np.pi * 76.2, abs=2)


def test_overlapping_defects_are_one_of_the_deeper_s_size_and_near_ones_are_two():
    shallow = {**POCKET, "distance_mm": 175, "clock_deg": 140, "depth_mm": 3.0}
    (one,) = _measure(_map(_pipe(POCKET, shallow)))
    assert one.length_mm == pytest.approx(70, abs=0.6)
    assert one.depth_mm == pytest.approx(7.5, abs=0.1)
    beside = [{**POCKET, "depth_mm": 3.0, "length_mm": 30, "distance_mm": place} for place in (150, 186)]
    assert [d.length_mm for d in _measure(_map(_pipe(*beside)))] == pytest.approx([30, 30], abs=0.5)


def test_a_fine_map_sizes_a_narrow_scratch():
    scratch = {"kind": "scratch", "distance_mm": 60, "clock_deg": 200, "path_length_mm": 50, "width_mm": 2}
    pipe = _pipe({**scratch, "depth_mm": 1})
    theta, z = (np.arange(1440) + 0.5) * 2 * np.pi / 1440, np.arange(0.25, 120, 0.5)
    radius = pipe.radius(theta[:, None], z[None, :])
    radius = radius + np.random.default_rng(0).normal(0, 0.05, radius.shape)
    level = np.full(radius.shape, 0.05)
    (found,) = _measure(WallMap(theta, z, radius, level, level, np.full(radius.shape, 2)))
    assert found.width_mm == pytest.approx(2, abs=0.3)
    assert found.depth_mm == pytest.approx(1, abs=0.12)
    assert found.length_mm == pytest.approx(50, abs=0.7)


def test_spikes_that_smoothing_would_take_are_sized_by_what_they_are():
    wall = _map(_pipe(), noise=0.02)
    deviation = deviation_mm(wall)
    deviation[100:112:2, 140:152:2] = 4.0  # every other cell, as frames that do not fit together leave them
    settings = SizingSettings(join_mm=5.0)
    (found,) = measure_defects(wall, deviation, _even(0.02, wall), NOMINAL, STEEPEST, settings)
    assert found.depth_std_mm > 1.0
    assert found.length_mm == pytest.approx(11, abs=3)
