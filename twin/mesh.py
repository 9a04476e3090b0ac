"""The wall as triangles: patches that are fine where the wall bends, and the carved pipe as a solid for a workshop."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from twin.bends import bent
from twin.features.base import CENTER_THETA, CENTER_Z, HALF_BOX_ARC, HALF_BOX_Z
from twin.pipe import Pipe
from twin.scanned import SCANNED

if TYPE_CHECKING:
    import trimesh

TURN_LINES = 360
TURN_STEP_RAD = 2 * np.pi / TURN_LINES
BORE_STEP_MM = 4.0
BACKING_MM = 1.0
HOLE_LIP_MM = 0.01  # a hole's rim keeps this thickness: a workshop cannot tell, and the solid stays one manifold
SLOPE_STEP_MM = 0.005


class Surface(NamedTuple):
    """Triangles of the wall; their right-handed normals point into the material, the vertex normals to the axis."""

    positions: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]


class Fineness(NamedTuple):
    """How closely triangles follow the wall where it bends."""

    error_mm: float
    smallest_mm: float
    largest_mm: float


DRAWN = Fineness(0.01, 0.12, 1.5)
PRINTED = Fineness(0.03, 0.25, 3.0)


class Box(NamedTuple):
    """A rectangle of the unrolled wall; theta runs on past a full turn where it must."""

    theta_from_rad: float
    theta_to_rad: float
    z_from_mm: float
    z_to_mm: float


def bore_surface(pipe: Pipe, z_from_mm: float, z_to_mm: float) -> Surface:
    """The plain wall between two distances, without the places that feature patches cover."""
    count = max(int(np.ceil((z_to_mm - z_from_mm) / BORE_STEP_MM)), 1)
    z = np.linspace(z_from_mm, z_to_mm, count + 1)
    theta = np.arange(TURN_LINES + 1) * TURN_STEP_RAD
    covered = np.zeros((TURN_LINES, count), dtype=bool)
    for row in pipe.wall.rows:
        if abs(row[CENTER_Z] - (z_from_mm + z_to_mm) / 2) > row[HALF_BOX_Z] + z_to_mm - z_from_mm:
            continue
        box = _patch_box(pipe, row, steps=1)
        middle = np.mod((theta[:-1] + theta[1:]) / 2 - box.theta_from_rad, 2 * np.pi) + box.theta_from_rad
        inside = (middle < box.theta_to_rad)[:, None] & (z[:-1] >= box.z_from_mm) & (z[1:] <= box.z_to_mm)
        covered |= inside
    return surface(pipe, theta, z, ~covered)


def feature_surface(pipe: Pipe, index: int) -> Surface:
    """The wall around one feature, a little beyond its box, so that it overlaps the plain wall without a seam."""
    row = pipe.wall.rows[index]
    box = _patch_box(pipe, row, steps=2)
    theta_lines, z_lines = [], []
    for other_index, other in enumerate(pipe.wall.rows):
        if not _touch(pipe, row, other):
            continue
        theta, z = _feature_lines(pipe, other_index, DRAWN)
        turn = 2 * np.pi * np.round((row[CENTER_THETA] - other[CENTER_THETA]) / (2 * np.pi))
        theta_lines.append(theta + turn)
        z_lines.append(z)
    theta = _merged(theta_lines, box.theta_from_rad, box.theta_to_rad, TURN_STEP_RAD, 1e-4)
    z = _merged(z_lines, box.z_from_mm, box.z_to_mm, BORE_STEP_MM, 0.01)
    return surface(pipe, theta, z)


def feature_box(pipe: Pipe, index: int) -> Box:
    """Where `feature_surface` reaches."""
    return _patch_box(pipe, pipe.wall.rows[index], steps=2)


def surface(
    pipe: Pipe,
    theta_rad: Float[np.ndarray, " t"],
    z_mm: Float[np.ndarray, " z"],
    keep: Bool[np.ndarray, "t-1 z-1"] | None = None,
) -> Surface:
    """The wall over a grid of lines, two triangles a cell; `keep` leaves cells out."""
    theta, z = (a.ravel() for a in np.meshgrid(theta_rad, z_mm, indexing="ij"))
    rho = pipe.radius(theta, z)
    step = SLOPE_STEP_MM
    slope_z = (pipe.radius(theta, z + step) - pipe.radius(theta, z - step)) / (2 * step)
    turn = step / rho
    slope_arc = (pipe.radius(theta + turn, z) - pipe.radius(theta - turn, z)) / (2 * step)
    sine, cosine = np.sin(theta), np.cos(theta)
    normals = np.stack([-sine + slope_arc * cosine, cosine + slope_arc * sine, slope_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    cells = np.ones((theta_rad.size - 1, z_mm.size - 1), dtype=bool) if keep is None else keep
    return Surface(np.stack([rho * sine, -rho * cosine, z], axis=-1), normals, _cell_faces(cells, z_mm.size))


def solid(pipe: Pipe) -> trimesh.Trimesh:
    """The carved pipe as one watertight body, mm, to print or to machine.

    Where a feature takes the whole wall, a backed pipe carries a plate of `BACKING_MM` on its outside and an unbacked
    one has a real hole.
    """
    import trimesh

    lines = [_feature_lines(pipe, index, PRINTED) for index in range(len(pipe.wall.rows))]
    theta_lines = [np.mod(theta, 2 * np.pi) for theta, _ in lines]
    theta = _merged(theta_lines, 0.0, 2 * np.pi, TURN_STEP_RAD, 0.1 / pipe.bore_radius_mm)[:-1]
    z = _merged([z for _, z in lines], pipe.start_mm, pipe.end_mm, 25.0, 0.1)
    inner = pipe.radius(theta[:, None], z)
    outer = np.full(inner.shape, pipe.outer_radius_mm)
    gone = inner >= pipe.outer_radius_mm - HOLE_LIP_MM
    cells = np.ones((theta.size, z.size - 1), dtype=bool)
    if pipe.backed:
        outer[_grown(gone)] += BACKING_MM
    else:
        inner = np.minimum(inner, pipe.outer_radius_mm - HOLE_LIP_MM)
        cells = _without_pinches(~_cells_of(gone))
    inside, outside = _ring_faces(cells, z.size), _ring_faces(cells, z.size) + inner.size
    edges = _open_edges(outside)
    walls = np.concatenate([edges[:, [1, 0]], edges[:, :1] - inner.size], axis=1)
    closing = np.stack([edges[:, 1], edges[:, 0] - inner.size, edges[:, 1] - inner.size], axis=1)
    direction = np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    vertices = [
        np.concatenate([rho[..., None] * direction[:, None], np.broadcast_to(z[:, None], (*rho.shape, 1))], axis=-1)
        for rho in (inner, outer)
    ]
    faces = np.concatenate([inside[:, ::-1], outside, walls, closing])
    places = np.concatenate(vertices).reshape(-1, 3)
    if pipe.bends:
        places = bent(pipe.axis, pipe.start_mm, places)
    body = trimesh.Trimesh(places, faces, process=False)
    body.remove_unreferenced_vertices()
    return body


def save_stl(pipe: Pipe, path: Path) -> None:
    """Write `solid` as binary STL, mm."""
    solid(pipe).export(path, file_type="stl")


def _patch_box(pipe: Pipe, row: np.ndarray, steps: int) -> Box:
    """A feature's box, widened to the grid lines of the plain wall and `steps` cells beyond."""
    half_turn = row[HALF_BOX_ARC] / pipe.bore_radius_mm
    if half_turn + 3 * TURN_STEP_RAD >= np.pi:
        start = np.floor((row[CENTER_THETA] - np.pi) / TURN_STEP_RAD) * TURN_STEP_RAD
        thetas = (start, start + 2 * np.pi)
    else:
        first = np.floor((row[CENTER_THETA] - half_turn) / TURN_STEP_RAD) - steps
        last = np.ceil((row[CENTER_THETA] + half_turn) / TURN_STEP_RAD) + steps
        thetas = (first * TURN_STEP_RAD, last * TURN_STEP_RAD)
    reach = row[HALF_BOX_Z] + steps * BORE_STEP_MM
    z_from, z_to = max(row[CENTER_Z] - reach, pipe.start_mm), min(row[CENTER_Z] + reach, pipe.end_mm)
    return Box(float(thetas[0]), float(thetas[1]), float(z_from), float(z_to))


def _touch(pipe: Pipe, row: np.ndarray, other: np.ndarray) -> bool:
    margin = 3 * BORE_STEP_MM
    apart_z = abs(row[CENTER_Z] - other[CENTER_Z]) - row[HALF_BOX_Z] - other[HALF_BOX_Z]
    turn = (row[CENTER_THETA] - other[CENTER_THETA] + np.pi) % (2 * np.pi) - np.pi
    return bool(apart_z < margin and abs(turn) * pipe.bore_radius_mm - row[HALF_BOX_ARC] - other[HALF_BOX_ARC] < margin)


def _feature_lines(pipe: Pipe, index: int, fineness: Fineness) -> tuple[np.ndarray, np.ndarray]:
    """Lines in theta and z over one feature's box, spaced so that chords stay within the error; a scan's own cells."""
    row, scan = pipe.wall.rows[index], pipe.scanned
    if scan is not None and pipe.wall.codes[index] == SCANNED:
        turn = (np.arange(scan.around) + 0.5) * 2 * np.pi / scan.around
        return turn, scan.first_z_mm + scan.cell_z_mm * np.arange(scan.along)
    half_turn = min(row[HALF_BOX_ARC] / pipe.bore_radius_mm, np.pi)
    counts = [int(np.clip(2 * row[k] / 0.1, 40, 1000)) for k in (HALF_BOX_ARC, HALF_BOX_Z)]
    theta = row[CENTER_THETA] + np.linspace(-half_turn, half_turn, counts[0])
    z = row[CENTER_Z] + np.linspace(-row[HALF_BOX_Z], row[HALF_BOX_Z], counts[1])
    rho = pipe.radius(theta[:, None], z)
    arc = _spread(theta * pipe.bore_radius_mm, np.abs(np.diff(rho, 2, axis=0)).max(axis=1), fineness)
    return arc / pipe.bore_radius_mm, _spread(z, np.abs(np.diff(rho, 2, axis=1)).max(axis=0), fineness)


def _spread(places_mm: np.ndarray, bends: np.ndarray, fineness: Fineness) -> np.ndarray:
    """Places so spaced that a chord misses a curve of the given second differences by the error at most."""
    step = places_mm[1] - places_mm[0]
    curvature = np.maximum(np.pad(bends, 1, mode="edge"), 1e-12) / step**2
    spacing = np.clip(np.sqrt(8 * fineness.error_mm / curvature), fineness.smallest_mm, fineness.largest_mm)
    density = 1 / np.minimum(spacing, np.minimum(np.roll(spacing, 1), np.roll(spacing, -1)))
    passed = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * step)])
    return np.interp(np.linspace(0, passed[-1], int(np.ceil(passed[-1])) + 1), passed, places_mm)


def _merged(lines: list[np.ndarray], start: float, stop: float, largest: float, smallest: float) -> np.ndarray:
    """Sorted lines from start to stop, none closer than `smallest`, gaps filled to `largest`."""
    inner = np.sort(np.concatenate([*lines, np.empty(0)]))
    kept = [start]
    for line in inner:
        if line - kept[-1] >= smallest and stop - line >= smallest:
            kept.append(float(line))
    kept.append(stop)
    filled = [np.linspace(a, b, int(np.ceil((b - a) / largest - 1e-9)) + 1)[:-1] for a, b in pairwise(kept)]
    return np.concatenate([*filled, [stop]])


def _cell_faces(cells: np.ndarray, z_count: int) -> np.ndarray:
    i, j = np.nonzero(cells)
    corner = i * z_count + j
    return _two_triangles(corner, corner + z_count, corner + 1, corner + z_count + 1)


def _ring_faces(cells: np.ndarray, z_count: int) -> np.ndarray:
    """As `_cell_faces`, the last line of theta being joined to the first."""
    i, j = np.nonzero(cells)
    here, there = i * z_count + j, (i + 1) % cells.shape[0] * z_count + j
    return _two_triangles(here, there, here + 1, there + 1)


def _two_triangles(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    return np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)


def _open_edges(faces: np.ndarray) -> np.ndarray:
    """Directed edges whose opposite no other triangle has."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    span = edges.max() + 1
    return edges[~np.isin(edges[:, 0] * span + edges[:, 1], edges[:, 1] * span + edges[:, 0])]


def _cells_of(vertices: np.ndarray) -> np.ndarray:
    """Cells all four corners of which are marked."""
    around = vertices & np.roll(vertices, -1, axis=0)
    return around[:, :-1] & around[:, 1:]


def _grown(vertices: np.ndarray) -> np.ndarray:
    grown = vertices | np.roll(vertices, 1, axis=0) | np.roll(vertices, -1, axis=0)
    grown[:, 1:] |= grown[:, :-1].copy()
    grown[:, :-1] |= grown[:, 1:].copy()
    return grown


def _without_pinches(cells: np.ndarray) -> np.ndarray:
    """Fill cells until no two holes touch at a mere corner, where a solid would be no manifold."""
    cells = cells.copy()
    while True:
        a, b = cells[:, :-1], cells[:, 1:]
        c, d = np.roll(cells, -1, axis=0)[:, :-1], np.roll(cells, -1, axis=0)[:, 1:]
        pinched = (a & d & ~b & ~c) | (b & c & ~a & ~d)
        if not pinched.any():
            return cells
        cells[:, :-1] |= pinched
        cells[:, 1:] |= pinched
