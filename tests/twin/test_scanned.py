"""A scanned bore is its grid, linear between cells, whole around the wall, and fades out beyond its ends."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from sensor_model.wall_rays import near_wall, wall_ranges_mm
from twin.mesh import solid
from twin.pipe import Pipe
from twin.scanned import FADE_MM, MOST_CELLS, ScannedWall, scanned_depth_mm, scanned_wall

AROUND, ALONG, FIRST_MM, CELL_MM, BORE_MM = 72, 50, 100.5, 2.0, 76.2
THETA = (np.arange(AROUND) + 0.5) * 2 * np.pi / AROUND
Z = FIRST_MM + CELL_MM * np.arange(ALONG)
GRID = BORE_MM + 0.5 * np.cos(2 * THETA)[:, None] + 2.0 * np.exp(-((Z - 150) ** 2) / 200)


def _pipe(**more) -> Pipe:
    scan = scanned_wall("spool.npz", FIRST_MM, CELL_MM, GRID)
    return Pipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5, start_mm=0, end_mm=400, scanned=scan, **more)


def test_the_wall_is_the_grid_at_its_cells_and_linear_between():
    pipe = _pipe()
    np.testing.assert_allclose(pipe.radius(THETA[:, None], Z), GRID, atol=0.0006)
    rng = np.random.default_rng(0)
    theta, z = rng.uniform(-7, 7, 500), rng.uniform(Z[0], Z[-1], 500)
    turned = np.mod(theta, 2 * np.pi)
    wide = np.concatenate([THETA[-1:] - 2 * np.pi, THETA, THETA[:1] + 2 * np.pi])
    rows = np.array([np.interp(z, Z, line) for line in GRID])
    rows = np.concatenate([rows[-1:], rows, rows[:1]])
    expected = [np.interp(t, wide, rows[:, k]) for k, t in enumerate(turned)]
    np.testing.assert_allclose(pipe.radius(theta, z), expected, atol=0.001)


def test_compiled_and_plain_agree_and_without_a_scan_there_is_nothing():
    scan = _pipe().wall.scan
    rng = np.random.default_rng(1)
    for theta, z in zip(rng.uniform(-7, 7, 50), rng.uniform(60, 240, 50), strict=True):
        plain = scanned_depth_mm(scan, float(theta), float(z))
        assert _pipe().radius(theta, z) - BORE_MM == pytest.approx(plain, abs=1e-12)
    assert scanned_depth_mm(None, 1.0, 2.0) == 0.0


def test_beyond_its_ends_the_scan_fades_into_the_bore():
    pipe, theta = _pipe(), float(THETA[0])
    at_end = pipe.radius(theta, Z[-1]) - BORE_MM
    assert pipe.radius(theta, Z[-1] + FADE_MM / 2) - BORE_MM == pytest.approx(at_end / 2, abs=1e-6)
    np.testing.assert_allclose(
        pipe.radius(theta, np.array([Z[0] - FADE_MM, Z[-1] + FADE_MM, 10.0])), BORE_MM, atol=1e-9
    )


def test_what_is_carved_into_it_and_what_rays_and_meshes_meet():
    pit = {"kind": "pit", "distance_mm": 180, "clock_deg": 90, "diameter_mm": 16, "depth_mm": 3, "shape": "spherical"}
    pipe = Pipe.model_validate({**_pipe().model_dump(), "features": (pit,)})
    assert pipe.radius(np.pi / 2, 180.0) == pytest.approx(_pipe().radius(np.pi / 2, 180.0) + 3, abs=1e-6)
    rng = np.random.default_rng(2)
    rays = rng.normal(size=(200, 3)) * [1, 1, 0.2]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hit = (
        np.array([3.0, -2.0, 150.0]) + wall_ranges_mm(near_wall(pipe, 150.0), (3.0, -2.0, 150.0), rays)[:, None] * rays
    )
    radius = pipe.radius(np.arctan2(hit[:, 0], -hit[:, 1]), hit[:, 2])
    np.testing.assert_allclose(np.hypot(hit[:, 0], hit[:, 1]), radius, atol=1e-5)
    body = solid(pipe)
    assert body.is_watertight
    bore = body.vertices[np.hypot(*body.vertices[:, :2].T) < BORE_MM + 5]
    wall = pipe.radius(np.arctan2(bore[:, 0], -bore[:, 1]), bore[:, 2])
    np.testing.assert_allclose(np.hypot(bore[:, 0], bore[:, 1]), wall, atol=1e-6)


def test_settings_round_trip_and_are_not_believed():
    scan = _pipe().scanned
    again = ScannedWall.model_validate_json(scan.model_dump_json())
    np.testing.assert_array_equal(again.radius_mm, scan.radius_mm)
    for change, words in (
        ({"cells": ""}, "read from its file when a scenario file is loaded"),
        ({"cells": "no base 64!"}, "cannot be unpacked"),
        ({"along": ALONG + 1}, "must unpack to"),
        ({"along": ALONG - 1}, "must unpack to"),
        ({"along": MOST_CELLS}, "at most"),
        ({"middle_radius_mm": 1.0}, "must be greater than 0"),
    ):
        with pytest.raises(ValidationError, match=words):
            ScannedWall.model_validate({**scan.model_dump(), **change})
    with pytest.raises(ValidationError, match="give no ovality_pct"):
        _pipe(ovality_pct=1.0)
    with pytest.raises(ValueError, match="at most 65 mm may lie between"):
        scanned_wall("x", 0.0, 1.0, np.linspace(20, 90, 80).reshape(8, 10))
