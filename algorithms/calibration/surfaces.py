"""What the slits were seen on: where camera rays meet a board or a pipe's wall, and how that moves as those do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

POSE_STEP = 1e-6


class Surface(Protocol):
    """Something that slits were seen on. Its own unknowns are changes of where it is believed to be."""

    @property
    def held(self) -> Float[np.ndarray, "own own"]:
        """What is known of its unknowns beforehand: information about 0."""

    def range_mm(
        self, ray: Float[np.ndarray, "n 3"], own: Float[np.ndarray, "own"], common: Float[np.ndarray, "common"], /
    ) -> Float[np.ndarray, "n"]:
        """How far rays from the camera go until they meet it."""

    def slopes(
        self,
        ray: Float[np.ndarray, "n 3"],
        range_mm: Float[np.ndarray, "n"],
        own: Float[np.ndarray, "own"],
        common: Float[np.ndarray, "common"],
        /,
    ) -> tuple[Float[np.ndarray, "n own"], Float[np.ndarray, "n common"]]:
        """How these ranges change with its own unknowns and with those that all surfaces have in common."""


@dataclass(frozen=True)
class Places:
    """Places known already, one a ray."""

    ranges_mm: Float[np.ndarray, "n"]

    @property
    def held(self) -> Float[np.ndarray, "0 0"]:
        """Nothing is unknown."""
        return np.zeros((0, 0))

    def range_mm(self, _ray: Float[np.ndarray, "n 3"], _own: np.ndarray, _common: np.ndarray) -> Float[np.ndarray, "n"]:
        """The known ranges."""
        return self.ranges_mm

    def slopes(
        self, ray: Float[np.ndarray, "n 3"], _range_mm: Float[np.ndarray, "n"], _own: np.ndarray, common: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """None."""
        return np.zeros((len(ray), 0)), np.zeros((len(ray), common.size))


@dataclass(frozen=True)
class FlatBoard:
    """A board's plane z = 0; its pose (rotation vector and translation, camera frame) is held by its markers."""

    pose: Float[np.ndarray, "6"]
    held: Float[np.ndarray, "6 6"]

    def range_mm(self, ray: Float[np.ndarray, "n 3"], own: np.ndarray, _common: np.ndarray) -> Float[np.ndarray, "n"]:
        """Float[np.ndarray, "n 3"] to the plane."""
        plane = plane_of(self.pose + own)
        return plane[3] / (ray @ plane[:3])

    def slopes(
        self, ray: Float[np.ndarray, "n 3"], range_mm: Float[np.ndarray, "n"], own: np.ndarray, common: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """By the pose: n . (t ray) = d, differentiated."""
        pose = self.pose + own
        plane = plane_of(pose)
        change = np.array([(plane_of(pose + POSE_STEP * unit) - plane) / POSE_STEP for unit in np.eye(6)])
        by_own = (change[:, 3] - range_mm[:, None] * (ray @ change[:, :3].T)) / (ray @ plane[:3])[:, None]
        return by_own, np.zeros((len(ray), common.size))


def plane_of(pose: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4"]:
    """Normal of a board's plane and its distance from the camera."""
    normal = Rotation.from_rotvec(pose[:3]).as_matrix()[:, 2]
    return np.append(normal, normal @ pose[3:])


@dataclass(frozen=True)
class Bore:
    """A pipe's wall around the camera: where its axis crosses the camera's plane, its slope, how oval it is.

    Nothing of these is known beforehand, but that the bore is as round as `oval_std_mm` says. The radius is as stated,
    or the one common unknown is how much larger it is.
    """

    axis: Float[np.ndarray, "4"]
    radius_mm: float
    oval_std_mm: float

    @property
    def held(self) -> Float[np.ndarray, "6 6"]:
        """Only the oval is held."""
        return np.diag([0.0] * 4 + [self.oval_std_mm**-2] * 2)

    def range_mm(self, ray: Float[np.ndarray, "n 3"], own: np.ndarray, common: np.ndarray) -> Float[np.ndarray, "n"]:
        """Float[np.ndarray, "n 3"] to the wall."""
        range_mm, outward, towards = self._on_circle(ray, own, common)
        return range_mm + _twofold(outward) @ own[4:] / towards

    def slopes(
        self, ray: Float[np.ndarray, "n 3"], range_mm: Float[np.ndarray, "n"], own: np.ndarray, common: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """By the axis, the oval and the radius; the oval is so small that it changes no slope."""
        _, outward, towards = self._on_circle(ray, own, common)
        x, y, slope_x, slope_y = self.axis + own[:4]
        axis = np.array([slope_x, slope_y, 1.0])
        ahead = (range_mm[:, None] * ray - [x, y, 0.0]) @ axis / (axis @ axis)
        moved = np.column_stack([outward[:, :2], ahead[:, None] * outward[:, :2], _twofold(outward)])
        return moved / towards[:, None], np.repeat(1.0 / towards[:, None], common.size, axis=1)

    def _on_circle(
        self, ray: Float[np.ndarray, "n 3"], own: np.ndarray, common: np.ndarray
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """Range to the round bore, outward there, and how fast a ray gets further from the axis."""
        x, y, slope_x, slope_y = self.axis + own[:4]
        axis = np.array([slope_x, slope_y, 1.0]) / np.sqrt(1.0 + slope_x**2 + slope_y**2)
        across, start = ray - np.outer(ray @ axis, axis), -np.array([x, y, 0.0])
        start -= (start @ axis) * axis
        radius_mm = self.radius_mm + common.sum()
        a, b = np.einsum("ni,ni->n", across, across), across @ start
        root = np.sqrt(np.maximum(b * b - a * (start @ start - radius_mm**2), 1e-12))
        range_mm = (root - b) / a
        return range_mm, (start + range_mm[:, None] * across) / radius_mm, root / radius_mm


def _twofold(outward: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    twice = 2 * np.arctan2(outward[:, 0], -outward[:, 1])
    return np.stack([np.cos(twice), np.sin(twice)], axis=1)
