"""The wall as triangles: a solid that a workshop can use, and surfaces that lie on r(theta, z)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin.features.pit import Pit
from twin.features.pocket import Pocket
from twin.features.scratch import Scratch
from twin.mesh import BACKING_MM, DRAWN, bore_surface, feature_surface, save_stl, solid
from twin.pipe import Pipe

BORE_MM, WALL_MM = 76.2, 7.5
POCKET = Pocket(distance_mm=30, clock_deg=355, depth_mm=WALL_MM, length_mm=70, width_mm=35)
OTHERS = (
    Pit(distance_mm=60, clock_deg=70, depth_mm=6, diameter_mm=18),
    Pit(distance_mm=66, clock_deg=80, depth_mm=20, diameter_mm=20, shape="conical"),
    Scratch(distance_mm=40, clock_deg=200, depth_mm=2, path_length_mm=60, width_mm=3, heading_deg=50),
)


def pipe(*features: Pocket | Pit | Scratch, backed: bool = True) -> Pipe:
    return Pipe(
        inner_radius_mm=BORE_MM, wall_thickness_mm=WALL_MM, start_mm=-50, end_mm=110, features=features, backed=backed
    )


def carved_mm3(carved: Pipe) -> float:
    """Volume that the features took, integrated from the radius."""
    theta = (np.arange(3600) + 0.5) * 2 * np.pi / 3600
    z = np.arange(-49.9, 110, 0.2)
    return float((carved.radius(theta[:, None], z) ** 2 - BORE_MM**2).sum() / 2 * 2 * np.pi / 3600 * 0.2)


@pytest.mark.parametrize("backed", [True, False])
@pytest.mark.parametrize(
    "features", [(), (POCKET,), OTHERS, (POCKET, *OTHERS)], ids=["empty", "pocket", "others", "all"]
)
def test_the_solid_is_watertight_and_has_the_walls_volume(features: tuple, backed: bool) -> None:
    carved = pipe(*features, backed=backed)
    body = solid(carved)
    assert body.is_watertight
    assert body.is_winding_consistent
    ring = np.pi * (carved.outer_radius_mm**2 - BORE_MM**2) * carved.length_mm
    facets = np.sin(2 * np.pi / 360) / (2 * np.pi / 360)  # a polygon's share of its circle
    expected = ring * facets - carved_mm3(carved)
    plate = carved.backed and POCKET in features
    extra = (POCKET.length_mm * POCKET.width_mm * (1 + WALL_MM / BORE_MM) * BACKING_MM) if plate else 0.0
    tolerance = 0.002 * ring if not features else 0.003 * ring
    assert body.volume == pytest.approx(expected + extra, abs=tolerance)
    assert carved_mm3(carved) == pytest.approx(ring * facets + extra - body.volume, rel=0.04, abs=250)


def test_a_backed_pocket_bulges_and_a_hole_opens() -> None:
    backed, unbacked = solid(pipe(POCKET)), solid(pipe(POCKET, backed=False))
    outer = BORE_MM + WALL_MM
    assert np.hypot(*backed.vertices[:, :2].T).max() == pytest.approx(outer + BACKING_MM)
    assert np.hypot(*unbacked.vertices[:, :2].T).max() == pytest.approx(outer)
    assert (backed.euler_number, unbacked.euler_number) == (0, -2)  # a tube, and a tube with a hole in its side


@pytest.mark.parametrize("backed", [True, False])
def test_the_stl_is_watertight_when_read_back(tmp_path: Path, backed: bool) -> None:
    import trimesh

    path = tmp_path / "carved.stl"
    save_stl(pipe(POCKET, backed=backed), path)
    assert trimesh.load(path).is_watertight


def test_surfaces_lie_on_the_wall_and_face_the_axis() -> None:
    carved = pipe(POCKET, *OTHERS)
    pieces = [bore_surface(carved, -50.0, 50.0), *(feature_surface(carved, i) for i in range(4))]
    for piece in pieces:
        x, y, z = piece.positions.T
        np.testing.assert_allclose(np.hypot(x, y), carved.radius(np.arctan2(x, -y), z), atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(piece.normals, axis=1), 1)
        assert (piece.normals[:, 0] * x + piece.normals[:, 1] * y < 0).all()
        corners = piece.positions[piece.faces]
        facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (facets[:, 0] * corners[:, 0, 0] + facets[:, 1] * corners[:, 0, 1] > 0).all()


def test_chords_stay_near_the_wall() -> None:
    carved = pipe(POCKET)
    piece = feature_surface(carved, 0)
    middle = piece.positions[piece.faces].mean(axis=1)
    miss = np.hypot(*middle[:, :2].T) - carved.radius(np.arctan2(middle[:, 0], -middle[:, 1]), middle[:, 2])
    assert np.abs(miss).max() < 4 * DRAWN.error_mm
    assert np.abs(miss).mean() < DRAWN.error_mm


def test_bore_and_patch_cover_the_wall_together() -> None:
    carved = pipe(POCKET)
    bore, patch = bore_surface(carved, -50.0, 110.0), feature_surface(carved, 0)
    whole = 2 * np.pi * BORE_MM * 160
    assert area(bore) < whole - POCKET.length_mm * POCKET.width_mm
    assert area(bore) + area(patch) > whole


def area(piece) -> float:
    corners = piece.positions[piece.faces]
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    )
