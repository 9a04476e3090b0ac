"""Laws of every feature family: what it states of its size is what the wall radius shows."""

from __future__ import annotations

import numpy as np
import pytest

from twin.features import CODES, FAMILIES, feature_depth_mm
from twin.pipe import CATALOGUE, Pipe

R = 76.2
EXAMPLES = [
    {"kind": "pocket", "length_mm": 70, "width_mm": 35, "depth_mm": 7.5},
    {"kind": "pocket", "length_mm": 20, "width_mm": 40, "depth_mm": 3, "corner_radius_mm": 8, "edge_width_mm": 4},
    {"kind": "pocket", "length_mm": 40, "width_mm": 35, "depth_mm": 4, "floor": "planar"},
    {"kind": "pit", "diameter_mm": 20, "depth_mm": 5},
    {"kind": "pit", "diameter_mm": 12, "depth_mm": 6},
    {"kind": "pit", "diameter_mm": 20, "depth_mm": 5, "shape": "conical"},
    {"kind": "scratch", "path_length_mm": 60, "width_mm": 4, "depth_mm": 2},
    {"kind": "scratch", "path_length_mm": 60, "width_mm": 4, "depth_mm": 2, "heading_deg": 35},
    {"kind": "scratch", "path_length_mm": 60, "width_mm": 4, "depth_mm": 2, "heading_deg": -90},
    {"kind": "scratch", "path_length_mm": 60, "width_mm": 4, "depth_mm": 2, "heading_deg": 20, "end_depth_mm": 0.4},
    {"kind": "scratch", "path_length_mm": 60, "width_mm": 4, "depth_mm": 2, "branch_length_mm": 25},
    {"kind": "pit", "diameter_mm": 3, "depth_mm": 1.5},
    {"kind": "corrosion", "length_mm": 60, "width_mm": 40, "depth_mm": 3},
    {"kind": "dent", "length_mm": 30, "width_mm": 20, "depth_mm": 4},
    {"kind": "hole", "diameter_mm": 12, "depth_mm": 7.5},
    {"kind": "corrosion", "length_mm": 30, "width_mm": 50, "depth_mm": 4, "grain_mm": 5, "seed": 7},
]
IDS = [f"{e['kind']}-{i}" for i, e in enumerate(EXAMPLES)]


def _pipe(example, clock_deg=0.0, **settings):
    feature = {**example, "distance_mm": 100, "clock_deg": clock_deg}
    settings = {"backed": example["kind"] != "hole", **settings}
    return Pipe(inner_radius_mm=R, wall_thickness_mm=7.5, features=[feature], **settings)


def _depths(pipe, clock_deg):
    """Depth on a grid of 0.1 mm around the feature's middle; of a dent the height."""
    arc, z = np.arange(-45, 45, 0.1), np.arange(55, 145, 0.1)
    depth = pipe.radius(np.radians(clock_deg) + arc[:, None] / R, z[None, :]) - R
    return arc, z, -depth if pipe.features[0].inward else depth


def test_every_family_has_an_example():
    assert {example["kind"] for example in EXAMPLES} == set(FAMILIES) == set(CODES)


@pytest.mark.parametrize("clock_deg", [0.0, 120.0, 359.0])
@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_the_stated_size_is_the_wall_s(example, clock_deg):
    pipe = _pipe(example, clock_deg)
    arc, z, depth = _depths(pipe, clock_deg)
    size = pipe.features[0].size(R)
    deep = depth >= size.depth_mm / 2
    assert depth.max() == pytest.approx(size.depth_mm, rel=0.02)  # the grid may miss a cone's tip
    # a planar floor is deeper at its sides, where half of the largest depth lies a little inside the outline
    assert np.ptp(z[deep.any(axis=0)]) == pytest.approx(size.length_mm, abs=0.45)
    assert np.ptp(arc[deep.any(axis=1)]) == pytest.approx(size.width_mm, abs=0.45)
    assert z[deep.any(axis=0)].mean() == pytest.approx(100, abs=0.2)
    assert arc[deep.any(axis=1)].mean() == pytest.approx(0, abs=0.2)


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_a_feature_is_smooth_and_ends_inside_its_box(example):
    pipe = _pipe(example)
    _, _, depth = _depths(pipe, 0.0)
    assert depth.min() >= 0
    assert np.abs(np.diff(depth, axis=1)).max() < 2.0  # mm per 0.1 mm: steep, but no cliff
    row = pipe.features[0].row()
    code = CODES[example["kind"]]
    for dz, arc in ((row[2] + 1e-6, 0.0), (0.0, row[3] + 1e-6), (-row[2] - 1e-6, row[3])):
        assert feature_depth_mm(code, dz, arc, row, R) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_turning_and_moving_a_feature_turns_and_moves_the_wall(example):
    here, there = _pipe(example), _pipe({**example}, 77.0)
    theta, z = np.meshgrid(np.linspace(0, 6.28, 300), np.linspace(60, 140, 200), indexing="ij")
    assert np.allclose(here.radius(theta, z), there.radius(theta + np.radians(77), z), atol=1e-9)


def test_overlapping_features_take_the_deeper():
    both = Pipe(
        inner_radius_mm=R,
        wall_thickness_mm=7.5,
        features=[{**EXAMPLES[0], "distance_mm": 100, "depth_mm": 2}, {**EXAMPLES[3], "distance_mm": 100}],
    )
    assert both.radius(0.0, 100.0) == pytest.approx(R + 5)
    assert both.radius(0.0, 125.0) == pytest.approx(R + 2)


def test_dents_narrow_the_bore_and_what_touches_adds_up():
    dent = {"kind": "dent", "length_mm": 30, "width_mm": 20, "depth_mm": 4, "clock_deg": 90}

    def pipe(*distances_mm):
        features = [{**dent, "distance_mm": z} for z in distances_mm]
        return Pipe(inner_radius_mm=R, wall_thickness_mm=7.5, features=features)

    assert pipe(0, 200).wall.smallest_radius == R - 4
    assert pipe(0, 20, 200).wall.smallest_radius == R - 8
    both = pipe(0, 20)
    assert both.radius(np.radians(90), np.linspace(-40, 60, 501)).min() >= both.wall.smallest_radius
    assert both.radius(np.radians(90), 10.0) < pipe(0).radius(np.radians(90), 10.0)
    with pytest.raises(ValueError, match="leave no bore"):
        Pipe(inner_radius_mm=R, wall_thickness_mm=7.5, features=[{**dent, "distance_mm": 0, "depth_mm": 77}])


def test_a_hole_needs_the_whole_wall_and_no_backing():
    hole = {"kind": "hole", "diameter_mm": 12, "depth_mm": 7.5, "distance_mm": 100}
    for wrong, said in (
        ({"depth_mm": 5}, "whole wall, 7.5 mm"),
        ({"edge_width_mm": 20}, "must not exceed the diameter"),
    ):
        with pytest.raises(ValueError, match=said):
            Pipe(inner_radius_mm=R, wall_thickness_mm=7.5, backed=False, features=[{**hole, **wrong}])
    with pytest.raises(ValueError, match="needs backed: false"):
        Pipe(inner_radius_mm=R, wall_thickness_mm=7.5, features=[hole])


def test_a_wall_taken_whole_is_backed_or_a_hole():
    for backed in (True, False):
        pipe = _pipe(EXAMPLES[0], backed=backed)
        assert pipe.radius(0.0, 100.0) == pytest.approx(R + 7.5)
        assert bool(pipe.through(0.0, 100.0)) is not backed
        assert not pipe.through(0.0, 200.0)


def test_compiled_radius_agrees_with_plain_numpy():
    pipe = _pipe(EXAMPLES[0], 120.0, ovality_pct=3, ovality_clock_deg=30)
    rng = np.random.default_rng(0)
    theta, z = rng.uniform(0, 2 * np.pi, 5000), rng.uniform(50, 150, 5000)
    bore = R * (1 + 0.015 * np.cos(2 * (theta - np.radians(30))))
    arc = R * ((theta - np.radians(120) + np.pi) % (2 * np.pi) - np.pi)
    along, across = np.abs(z - 100) - 35 + 3, np.abs(arc) - 17.5 + 3
    outside = np.hypot(np.maximum(along, 0), np.maximum(across, 0)) + np.minimum(np.maximum(along, across), 0) - 3
    t = np.clip(0.5 - outside / 2, 0, 1)
    plain = np.minimum(bore + 7.5 * t * t * (3 - 2 * t), R + 7.5)
    assert np.allclose(pipe.radius(theta, z), plain, atol=1e-9)


@pytest.mark.parametrize(
    ("material", "series", "size", "outer_mm", "wall_mm"),
    [
        ("PVC", "Sch 40", 6, 168.28, 7.11),  # ASTM D1785: 6.625 in, 0.280 in
        ("PVC", "Sch 40", 4, 114.30, 6.02),
        ("PE", "SDR 11", 6, 168.28, 15.30),
        ("PE", "SDR 13.5", 8, 219.08, 16.23),
    ],
)
def test_the_catalogue_gives_bore_and_wall(material, series, size, outer_mm, wall_mm):
    pipe = Pipe(standard={"material": material, "series": series, "nominal_size_in": size})
    assert 2 * pipe.outer_radius_mm == pytest.approx(outer_mm, abs=0.01)
    assert pipe.wall_mm == pytest.approx(wall_mm, abs=0.01)
    assert len(CATALOGUE) == 3


def test_a_copy_forgets_what_was_cached():
    pipe = _pipe(EXAMPLES[0])
    assert pipe.radius(0.0, 100.0) > R
    assert pipe.model_copy(update={"features": ()}).radius(0.0, 100.0) == R
    with pytest.raises(ValueError, match="ovality_pct"):
        pipe.model_copy(update={"ovality_pct": -1})
