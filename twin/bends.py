"""Bends of the pipe's axis (coiled pipe, swept bends) as arcs; what turns bent places into straight ones and back.

All that knows the pipe by its wall r(theta, z) goes on doing so, with z along the axis and theta about it. What deals
with straight things in the world, as light and the robot's bodies, asks here where a place of the world lies.
"""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field, model_validator

from sensor_model.geometry import inverse
from sensor_model.settings import Settings

TOWARDS = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "down": (0.0, 1.0), "up": (0.0, -1.0)}
LEVEL_DEG = 1e-6
STEEPEST_DEG = 80.0
FOLLOWED_MM, ANEW_MM = 400.0, 50.0  # the whole robot meets bends within the one, sought anew after the other
PIECE_DEG = 60.0  # arcs are cut in such pieces, so that a place lies beside one of them only
FROM, CURVATURE, TOWARDS_X, TOWARDS_Y, ORIGIN, ROTATION = 0, 1, 2, 3, 4, 7
ROW_LENGTH = 16  # a piece's start, curvature (1/mm), two of its direction, and the frame at its start: origin, rotation


class Bend(Settings):
    """A stretch whose axis is an arc of `radius_od` outer diameters: 25 for coiled pipe, 3 to 10 for a swept bend."""

    from_mm: float
    to_mm: float
    radius_od: Annotated[float, Field(ge=3, le=10_000)] = 25.0
    towards: Literal["right", "left", "up", "down"] = "right"

    @model_validator(mode="after")
    def _has_a_length(self) -> Bend:
        if self.to_mm <= self.from_mm:
            raise ValueError(f"to_mm must lie beyond from_mm, {self.from_mm}")
        return self


class Axis(NamedTuple):
    """The pipe's axis, piece by piece: where each begins along it, its curvature vector, and the frame there."""

    from_mm: Float[np.ndarray, "pieces"]
    curvature_per_mm: Float[np.ndarray, "pieces 2"]
    T_world_start: Float[np.ndarray, "pieces 4 4"]

    def frame(self, z_mm: Float[np.ndarray, "*n"] | float) -> Float[np.ndarray, "*n 4 4"]:
        """`T_world_pipe` at places along the axis: there, with z as its tangent and 12 o'clock up."""
        z = np.asarray(z_mm, dtype=float)
        piece = np.clip(np.searchsorted(self.from_mm, z, side="right") - 1, 0, None)
        return self.T_world_start[piece] @ _arc(np.asarray(z - self.from_mm[piece]), self.curvature_per_mm[piece])


def straight_axis(start_mm: float) -> Axis:
    """The z axis."""
    T = np.eye(4)
    T[2, 3] = start_mm
    return Axis(np.array([start_mm]), np.zeros((1, 2)), T[None])


def axis_of(start_mm: float, inclination_deg: float, outer_diameter_mm: float, bends: tuple[Bend, ...]) -> Axis:
    """The axis of a pipe; the world's frame is the pipe's own at its start.

    Raises:
        ValueError: for bends that overlap, begin before the pipe, or leave 12 o'clock undefined.
    """
    axis, slope_deg = straight_axis(start_mm), inclination_deg
    for bend in sorted(bends, key=lambda bend: bend.from_mm):
        if bend.from_mm < axis.from_mm[-1]:
            raise ValueError(f"the bend at {bend.from_mm:g} mm begins before {axis.from_mm[-1]:g} mm, where it may")
        curvature = 1 / (bend.radius_od * outer_diameter_mm)
        turn_deg = float(np.degrees(curvature * (bend.to_mm - bend.from_mm)))
        sideways = bend.towards in ("right", "left")
        if sideways and abs(slope_deg) > LEVEL_DEG:
            raise ValueError(
                f"the bend at {bend.from_mm:g} mm goes {bend.towards} where the pipe slopes by {slope_deg:g} degrees: "
                "clock positions are told from gravity, and would turn with it; only a level pipe may bend sideways"
            )
        slope_deg += 0.0 if sideways else turn_deg if bend.towards == "down" else -turn_deg
        if not sideways and abs(slope_deg) > STEEPEST_DEG:
            raise ValueError(
                f"the bend at {bend.from_mm:g} mm ends at a slope of {slope_deg:.0f} degrees; beyond {STEEPEST_DEG:g} "
                "there is no 12 o'clock"
            )
        begins = np.linspace(bend.from_mm, bend.to_mm, int(np.ceil(turn_deg / PIECE_DEG)) + 1)
        for begin in begins[:-1].tolist():
            axis = _longer(axis, begin, curvature * np.array(TOWARDS[bend.towards]))
        axis = _longer(axis, bend.to_mm, np.zeros(2))
    return axis


def _longer(axis: Axis, from_mm: float, curvature_per_mm: np.ndarray) -> Axis:
    """One more piece, from a place on."""
    kept = axis.from_mm < from_mm
    T = axis.frame(from_mm)
    return Axis(
        np.append(axis.from_mm[kept], from_mm),
        np.vstack([axis.curvature_per_mm[kept], curvature_per_mm]),
        np.concatenate([axis.T_world_start[kept], T[None]]),
    )


def _arc(way_mm: np.ndarray, curvature_per_mm: np.ndarray) -> np.ndarray:
    """The frame after some way along an arc, as its start has it."""
    bent = np.linalg.norm(curvature_per_mm, axis=-1)
    size = np.where(bent > 0, bent, 1.0)
    towards = curvature_per_mm / size[..., None]
    turn = bent * way_mm
    aside = np.where(bent > 0, 2 * np.sin(turn / 2) ** 2 / size, 0.0)
    ahead = np.where(bent > 0, np.sin(turn) / size, way_mm)
    T = np.zeros((*way_mm.shape, 4, 4))
    x, y, cosine, sine = towards[..., 0], towards[..., 1], np.cos(turn), np.sin(turn)
    T[..., 0, 0], T[..., 0, 1], T[..., 0, 2] = 1 - x * x * (1 - cosine), -x * y * (1 - cosine), x * sine
    T[..., 1, 0], T[..., 1, 1], T[..., 1, 2] = -x * y * (1 - cosine), 1 - y * y * (1 - cosine), y * sine
    T[..., 2, 0], T[..., 2, 1], T[..., 2, 2] = -x * sine, -y * sine, cosine
    T[..., 0, 3], T[..., 1, 3], T[..., 2, 3], T[..., 3, 3] = x * aside, y * aside, ahead, 1.0
    return T


def bent_rows(axis: Axis, about_mm: float, reach_mm: float, T_reference_world: np.ndarray) -> np.ndarray:
    """The axis within reach of a place, in a reference frame, as `unbent` reads it; none where it is all straight."""
    first = int(np.searchsorted(axis.from_mm, about_mm - reach_mm, side="right")) - 1
    last = int(np.searchsorted(axis.from_mm, about_mm + reach_mm, side="right"))
    pieces = np.arange(max(first, 0), max(last, 1))
    if axis.from_mm.size == 1:
        return np.zeros((0, ROW_LENGTH))
    begin = np.maximum(axis.from_mm[pieces], about_mm - reach_mm)
    T, curvature = T_reference_world @ axis.frame(begin), axis.curvature_per_mm[pieces]
    bent = np.linalg.norm(curvature, axis=1)
    towards = curvature / np.where(bent > 0, bent, 1.0)[:, None]
    towards[bent == 0] = TOWARDS["right"]
    return np.column_stack([begin, bent, towards, T[:, :3, 3], T[:, :3, :3].reshape(-1, 9)])


def rows_about(axis: Axis, about_mm: float, reach_mm: float) -> np.ndarray:
    """`bent_rows` in the pipe's own frame at a place, whose origin has that place's distance as its z."""
    T = inverse(axis.frame(about_mm))
    T[2, 3] += about_mm
    return bent_rows(axis, about_mm, reach_mm, T)


@njit(cache=True, error_model="numpy", forceinline=True)
def _piece(rows, x, y, z):
    """The piece of the axis beside which a place lies: the last whose beginning it has passed."""
    k = 0
    for i in range(1, rows.shape[0]):
        ahead = (
            rows[i, ROTATION + 2] * (x - rows[i, ORIGIN])
            + rows[i, ROTATION + 5] * (y - rows[i, ORIGIN + 1])
            + rows[i, ROTATION + 8] * (z - rows[i, ORIGIN + 2])
        )
        if ahead >= 0.0:
            k = i
    return k


@njit(cache=True, error_model="numpy", forceinline=True)
def unbent(rows, x, y, z):
    """Where a place of the reference frame lies beside the axis (x, y) and along it (z); itself without rows."""
    if rows.shape[0] == 0:
        return x, y, z
    return unbent_by(rows, _piece(rows, x, y, z), x, y, z)


@njit(cache=True, error_model="numpy", forceinline=True)
def unbent_by(rows, k, x, y, z):
    """`unbent` by one of the pieces."""
    dx, dy, dz = x - rows[k, ORIGIN], y - rows[k, ORIGIN + 1], z - rows[k, ORIGIN + 2]
    right = rows[k, ROTATION] * dx + rows[k, ROTATION + 3] * dy + rows[k, ROTATION + 6] * dz
    down = rows[k, ROTATION + 1] * dx + rows[k, ROTATION + 4] * dy + rows[k, ROTATION + 7] * dz
    ahead = rows[k, ROTATION + 2] * dx + rows[k, ROTATION + 5] * dy + rows[k, ROTATION + 8] * dz
    curvature, nx, ny = rows[k, CURVATURE], rows[k, TOWARDS_X], rows[k, TOWARDS_Y]
    if curvature == 0.0:
        return right, down, rows[k, FROM] + ahead
    radius = 1.0 / curvature
    inward, beside = nx * right + ny * down, nx * down - ny * right
    inner = radius - inward
    aside = radius - np.sqrt(inner * inner + ahead * ahead)
    along = rows[k, FROM] + radius * np.arctan2(ahead, inner)
    return nx * aside - ny * beside, ny * aside + nx * beside, along


@njit(cache=True, error_model="numpy", forceinline=True)
def crowding(rows, x, y, z):
    """How much way at a place of the reference frame is 1 mm of the axis: less on a bend's inner side."""
    if rows.shape[0] == 0:
        return 1.0
    k = _piece(rows, x, y, z)
    u, v, _ = unbent_by(rows, k, x, y, z)
    return 1.0 - rows[k, CURVATURE] * (rows[k, TOWARDS_X] * u + rows[k, TOWARDS_Y] * v)


@njit(cache=True, error_model="numpy", forceinline=True)
def bent_direction(rows, place, direction):
    """A direction of the pipe's own axes at a place of the reference frame, in the reference's axes."""
    if rows.shape[0] == 0:
        return direction
    x, y, z = place[0], place[1], place[2]
    across_x, across_y, along = direction
    k = _piece(rows, x, y, z)
    dx, dy, dz = x - rows[k, ORIGIN], y - rows[k, ORIGIN + 1], z - rows[k, ORIGIN + 2]
    right = rows[k, ROTATION] * dx + rows[k, ROTATION + 3] * dy + rows[k, ROTATION + 6] * dz
    down = rows[k, ROTATION + 1] * dx + rows[k, ROTATION + 4] * dy + rows[k, ROTATION + 7] * dz
    ahead = rows[k, ROTATION + 2] * dx + rows[k, ROTATION + 5] * dy + rows[k, ROTATION + 8] * dz
    nx, ny = rows[k, TOWARDS_X], rows[k, TOWARDS_Y]
    turn = np.arctan2(rows[k, CURVATURE] * ahead, 1.0 - rows[k, CURVATURE] * (nx * right + ny * down))
    inward, beside = nx * across_x + ny * across_y, nx * across_y - ny * across_x
    turned = np.cos(turn) * inward + np.sin(turn) * along
    right, down = nx * turned - ny * beside, ny * turned + nx * beside
    ahead = np.cos(turn) * along - np.sin(turn) * inward
    return (
        rows[k, ROTATION] * right + rows[k, ROTATION + 1] * down + rows[k, ROTATION + 2] * ahead,
        rows[k, ROTATION + 3] * right + rows[k, ROTATION + 4] * down + rows[k, ROTATION + 5] * ahead,
        rows[k, ROTATION + 6] * right + rows[k, ROTATION + 7] * down + rows[k, ROTATION + 8] * ahead,
    )


def straightened(
    axis: Axis, position_mm: Float[np.ndarray, "n 3"], rotation: Float[np.ndarray, "n 3 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Poses of the world, one after the other on a way, beside and along the axis: as in a straight pipe."""
    place = followed(bent_rows(axis, 0.0, np.inf, np.eye(4)), np.ascontiguousarray(position_mm))
    return place, np.swapaxes(axis.frame(place[:, 2])[:, :3, :3], 1, 2) @ rotation


def bent(axis: Axis, about_mm: float, place_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Places beside and along the axis, in the pipe's own frame at one of them (`rows_about`)."""
    return _turned(axis, about_mm, place_mm, place_mm * [1.0, 1.0, 0.0], 1.0)


def bent_normals(
    axis: Axis, about_mm: float, place_mm: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Directions in the pipe's own axes at places, in the pipe's own frame at one of them."""
    return _turned(axis, about_mm, place_mm, normals, 0.0)


def _turned(axis: Axis, about_mm: float, place_mm: np.ndarray, vectors: np.ndarray, origin: float) -> np.ndarray:
    at, which = np.unique(place_mm[:, 2], return_inverse=True)
    T = inverse(axis.frame(about_mm)) @ axis.frame(at)
    T[:, 2, 3] += about_mm
    return np.einsum("nij,nj->ni", T[which, :3, :3], vectors) + origin * T[which, :3, 3]


class Follower:
    """Where beside and along the axis something lies that moves on through the pipe; `rows` are the bends around it."""

    def __init__(self, axis: Axis, about_mm: float):
        self.axis, self.is_straight = axis, axis.from_mm.size == 1
        self._about(about_mm)

    def _about(self, z_mm: float) -> None:
        self._z_mm, self.rows = z_mm, bent_rows(self.axis, z_mm, FOLLOWED_MM, np.eye(4))

    def place_mm(self, world_mm: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
        """A place of the world beside the axis (x, y) and along it (z)."""
        x, y, z = unbent(self.rows, *world_mm.tolist())
        if not self.is_straight and abs(z - self._z_mm) > ANEW_MM:
            self._about(z)
        return x, y, z

    def heading(self, z_mm: float) -> Float[np.ndarray, "3 3"]:
        """`R_world_pipe` at a place along the axis."""
        return self.axis.frame(z_mm)[:3, :3]


@njit(cache=True, error_model="numpy")
def followed(rows, points_mm):
    """`unbent` of places one after the other, each near the last: an axis may come back to where it was."""
    out, k = np.empty_like(points_mm), 0
    for i in range(points_mm.shape[0]):
        x, y, z = points_mm[i, 0], points_mm[i, 1], points_mm[i, 2]
        while k + 1 < rows.shape[0] and _is_past(rows, k + 1, x, y, z):
            k += 1
        while k > 0 and not _is_past(rows, k, x, y, z):
            k -= 1
        out[i, 0], out[i, 1], out[i, 2] = unbent_by(rows, k, x, y, z)
    return out


@njit(cache=True, error_model="numpy")
def _is_past(rows, k, x, y, z):
    dx, dy, dz = x - rows[k, ORIGIN], y - rows[k, ORIGIN + 1], z - rows[k, ORIGIN + 2]
    return rows[k, ROTATION + 2] * dx + rows[k, ROTATION + 5] * dy + rows[k, ROTATION + 8] * dz >= 0.0
