"""The pipe: one exact wall radius r(theta, z), from which mesh, wheel contact, pictures and scoring are all made."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numba import njit
from pydantic import Field, model_validator

from sensor_model.settings import ClockDeg, Settings
from twin.bends import Axis, Bend, axis_of, bent_rows
from twin.features import CODES, AnyFeature, feature_depth_mm
from twin.features.base import CENTER_THETA, CENTER_Z, HALF_BOX_ARC, HALF_BOX_Z, ROW_LENGTH
from twin.joints import DEBRIS, JOINT, TAPER, Debris, Joint, Taper, obstacle_depth_mm
from twin.scanned import SCANNED, Scan, ScannedWall, scanned_depth_mm
from twin.surfaces import Surface

INCH_MM = 25.4

# (material, wall series) -> {nominal size, inch: (outer diameter, minimum wall), inch}.
# PVC: ASTM D1785, Schedule 40. PE: ASTM D2513 / F714 iron-pipe sizes; wall = outer diameter / SDR.
IPS_OUTER_IN = {4: 4.500, 6: 6.625, 8: 8.625}
CATALOGUE: dict[tuple[str, str], dict[int, tuple[float, float]]] = {
    ("PVC", "Sch 40"): {4: (4.500, 0.237), 6: (6.625, 0.280), 8: (8.625, 0.322)},
    ("PE", "SDR 11"): {size: (od, od / 11) for size, od in IPS_OUTER_IN.items()},
    ("PE", "SDR 13.5"): {size: (od, od / 13.5) for size, od in IPS_OUTER_IN.items()},
}


class Standard(Settings):
    """A pipe by its trade name."""

    material: Literal["PVC", "PE"]
    series: Literal["Sch 40", "SDR 11", "SDR 13.5"]
    nominal_size_in: Literal[4, 6, 8]

    @model_validator(mode="after")
    def _in_catalogue(self) -> Standard:
        if (self.material, self.series) not in CATALOGUE:
            raise ValueError(f"the catalogue has {', '.join(' '.join(key) for key in CATALOGUE)}")
        return self

    @property
    def outer_and_wall_mm(self) -> tuple[float, float]:
        """Outer diameter and minimum wall."""
        outer, wall = CATALOGUE[self.material, self.series][self.nominal_size_in]
        return outer * INCH_MM, wall * INCH_MM


class Wall(NamedTuple):
    """The pipe as compiled code reads it; nothing of the wall is nearer to the axis than `smallest_radius`.

    `axis` has the bends in a frame of reference (`bends.bent_rows`), no rows for a straight pipe; here, in the world's.
    """

    inner_radius: float
    smallest_radius: float
    outer_radius: float
    ovality: float
    ovality_phase: float
    codes: np.ndarray
    rows: np.ndarray
    scan: Scan | None
    axis: np.ndarray


class Pipe(Settings):
    """A pipe along z with what is carved into its wall.

    Its bore comes from a `standard` or from `inner_radius_mm` and `wall_thickness_mm`. A feature that takes the whole
    wall shows its opaque backing when `backed`, and is a hole that returns no light when not. `joints`, `debris`
    and `tapers` are part of the wall that wheels and light meet, but no defects of it; what is nominal is the bore
    before all tapers. `surfaces` change the wheels' grip alone. With `scanned` the bore is as a scan has it, and what
    else is stated is carved into that; of defects that the scan itself shows, nobody knows the true size. `bends` make
    an axis that is no straight line: z then goes along it, and inclination is that of the pipe's start.
    """

    standard: Standard | None = None
    inner_radius_mm: Annotated[float, Field(gt=5)] | None = None
    wall_thickness_mm: Annotated[float, Field(gt=0)] | None = None
    start_mm: float = -400.0
    end_mm: float = 900.0
    ovality_pct: Annotated[float, Field(ge=0, le=20)] = 0.0
    ovality_clock_deg: ClockDeg = 0.0
    inclination_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    backed: bool = True
    features: tuple[AnyFeature, ...] = Field(default=(), max_length=10_000)
    joints: tuple[Joint, ...] = Field(default=(), max_length=10_000)
    debris: tuple[Debris, ...] = Field(default=(), max_length=10_000)
    tapers: tuple[Taper, ...] = Field(default=(), max_length=20)
    surfaces: tuple[Surface, ...] = Field(default=(), max_length=10_000)
    scanned: ScannedWall | None = None
    bends: tuple[Bend, ...] = Field(default=(), max_length=1000)

    @model_validator(mode="after")
    def _bore_is_stated_once(self) -> Pipe:
        plain = (self.inner_radius_mm, self.wall_thickness_mm)
        if (self.standard is None) == (None in plain) or (self.standard is not None and plain != (None, None)):
            raise ValueError("give either standard, or both inner_radius_mm and wall_thickness_mm")
        if self.end_mm <= self.start_mm:
            raise ValueError(f"end_mm must lie beyond start_mm, {self.start_mm}")
        if self.scanned is not None and self.ovality_pct:
            raise ValueError("give no ovality_pct with scanned, which has its own")
        return self

    @model_validator(mode="after")
    def _holes_go_through(self) -> Pipe:
        for feature in self.features:
            if feature.kind != "hole":
                continue
            if self.backed:
                raise ValueError(
                    f"the hole at {feature.distance_mm:g} mm needs backed: false; a backing would show in it"
                )
            if feature.depth_mm < self.wall_mm:
                raise ValueError(f"a hole's depth_mm is the whole wall, {self.wall_mm:g} mm; got {feature.depth_mm:g}")
        return self

    @model_validator(mode="after")
    def _bends_are_possible(self) -> Pipe:
        if self.bends and not self.backed:
            raise ValueError("a pipe with bends must be backed: holes are reckoned in a straight one only")
        _ = self.axis
        return self

    @model_validator(mode="after")
    def _is_open(self) -> Pipe:
        if self.wall.smallest_radius <= 0:
            raise ValueError(
                f"dents, joints, debris, tapers and scan leave no bore of {self.bore_radius_mm:g} mm radius open"
            )
        return self

    @cached_property
    def bore_radius_mm(self) -> float:
        """Nominal inner radius."""
        if self.standard is not None:
            outer, wall = self.standard.outer_and_wall_mm
            return outer / 2 - wall
        assert self.inner_radius_mm is not None  # noqa: S101  the validator saw to it
        return self.inner_radius_mm

    @cached_property
    def wall_mm(self) -> float:
        """Nominal wall thickness."""
        if self.standard is not None:
            return self.standard.outer_and_wall_mm[1]
        assert self.wall_thickness_mm is not None  # noqa: S101  the validator saw to it
        return self.wall_thickness_mm

    @property
    def outer_radius_mm(self) -> float:
        """Nominal outer radius."""
        return self.bore_radius_mm + self.wall_mm

    @property
    def length_mm(self) -> float:
        """Length from end to end."""
        return self.end_mm - self.start_mm

    @cached_property
    def axis(self) -> Axis:
        """The axis in the world, whose frame is the pipe's at its start."""
        return axis_of(self.start_mm, self.inclination_deg, 2 * self.outer_radius_mm, self.bends)

    @cached_property
    def wall(self) -> Wall:
        """The pipe as `wall_radius_mm` and other compiled code read it."""
        changes = [taper.row(self.end_mm) for taper in self.tapers]
        scans = [] if self.scanned is None else [self.scanned.row()]
        rows = np.array([part.row() for part in (*self.features, *self.joints, *self.debris)] + changes + scans)
        of_features = [CODES[feature.kind] for feature in self.features]
        of_others = [JOINT] * len(self.joints) + [DEBRIS] * len(self.debris) + [TAPER] * len(self.tapers)
        codes = np.array(of_features + of_others + [SCANNED] * len(scans), dtype=np.int64)
        phase = float(np.radians(self.ovality_clock_deg))
        bore, ovality = self.bore_radius_mm, self.ovality_pct / 200
        scan = None if self.scanned is None else self.scanned.scan(bore)
        bead = max((joint.bead_height_mm for joint in self.joints), default=0.0)
        lump = max((lump.height_mm for lump in self.debris), default=0.0)
        dents = _highest_mm([feature for feature in self.features if feature.inward])
        # as if all that narrows were in one place, and all that widens
        narrowed = bead + lump + dents - sum(min(taper.radius_change_mm, 0.0) for taper in self.tapers)
        narrowed -= 0.0 if scan is None else min(float(scan.grid.min()), 0.0)
        widened = sum(max(taper.radius_change_mm, 0.0) for taper in self.tapers)
        smallest, outer = bore * (1 - ovality) - narrowed, self.outer_radius_mm + widened
        axis = bent_rows(self.axis, self.start_mm, np.inf, np.eye(4))
        return Wall(bore, smallest, outer, ovality, phase, codes, rows.reshape(-1, ROW_LENGTH), scan, axis)

    def radius(self, theta_rad: np.ndarray | float, z_mm: np.ndarray | float) -> Float[np.ndarray, "*batch"]:
        """Distance from the axis to the wall: THE definition of this pipe, mm; arguments broadcast."""
        theta, z = np.broadcast_arrays(np.asarray(theta_rad, dtype=float), np.asarray(z_mm, dtype=float))
        return _radii(self.wall, theta.ravel(), z.ravel()).reshape(theta.shape)

    def through(self, theta_rad: np.ndarray | float, z_mm: np.ndarray | float) -> Bool[np.ndarray, "*batch"]:
        """Where the wall is gone and nothing backs it, which a radius cannot express."""
        radius = self.radius(theta_rad, z_mm)
        gone = radius >= self.outer_radius_mm - 1e-6
        return np.asarray(np.zeros_like(gone) if self.backed else gone)


def _highest_mm(dents: list[AnyFeature]) -> float:
    """How far dents stand inward at most; those whose boxes touch along the pipe may add up."""
    rows = np.array([dent.row() for dent in dents]).reshape(-1, ROW_LENGTH)
    height = np.array([dent.depth_mm for dent in dents])
    from_mm, to_mm = rows[:, CENTER_Z] - rows[:, HALF_BOX_Z], rows[:, CENTER_Z] + rows[:, HALF_BOX_Z]
    return max(
        (float(height[(a <= to_mm) & (b >= from_mm)].sum()) for a, b in zip(from_mm, to_mm, strict=True)), default=0.0
    )


# put inline, as all that it calls: a call counts references to the wall's arrays, at several times the cost of a radius
@njit(cache=True, error_model="numpy", forceinline=True)
def wall_radius_mm(wall, theta, z):
    """Distance from the axis to the wall at one place, mm."""
    bore = wall.inner_radius
    if wall.ovality != 0.0:
        bore *= 1.0 + wall.ovality * np.cos(2.0 * (theta - wall.ovality_phase))
    depth, obstacle = 0.0, scanned_depth_mm(wall.scan, theta, z)
    for i in range(wall.codes.size):
        dz = z - wall.rows[i, CENTER_Z]
        if abs(dz) > wall.rows[i, HALF_BOX_Z]:
            continue
        turn = theta - wall.rows[i, CENTER_THETA]
        arc = wall.inner_radius * (turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi)))
        if abs(arc) > wall.rows[i, HALF_BOX_ARC]:
            continue
        row = _numbers(wall.rows, i)
        if wall.codes[i] < 0:
            obstacle += obstacle_depth_mm(wall.codes[i], dz, arc, row)
        else:
            own = feature_depth_mm(wall.codes[i], dz, arc, row, wall.inner_radius)
            depth = max(depth, own)
            obstacle += min(own, 0.0)
    return min(bore + depth + obstacle, wall.outer_radius)


@njit(cache=True, error_model="numpy", forceinline=True)
def _numbers(rows, i):
    """One row as numbers: a view of the array would count its references, at several times the cost of a radius."""
    return (
        *(rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5], rows[i, 6]),
        *(rows[i, 7], rows[i, 8], rows[i, 9], rows[i, 10], rows[i, 11], rows[i, 12], rows[i, 13]),
    )


@njit(cache=True, error_model="numpy")
def _radii(wall, theta, z):
    out = np.empty(theta.size)
    for i in range(theta.size):
        out[i] = wall_radius_mm(wall, theta[i], z[i])
    return out
