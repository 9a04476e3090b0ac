"""Standing water along the bottom of the pipe: how its level surface mirrors, bends and weakens light."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field

from sensor_model.glass import Glass, reflected
from sensor_model.rig import Rig
from sensor_model.settings import Settings
from twin.pipe import Pipe
from twin.truth import gravity_direction

CROSSING_STEPS = 8
STEEPEST_DEG = 45.0  # pipes steeper than this hold no water along their bottom
CLEAR_MM = 2.0  # of the surface, for light to leave and arrive in air


class Water(Settings):
    """Clear water with a smooth surface, level whatever the robot's roll; without depth there is none."""

    depth_mm: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Above the bottom of the undamaged bore; in a sloping pipe, at the launch point."""
    index: Annotated[float, Field(gt=1, le=1.6)] = 1.333
    absorption_per_m: Annotated[float, Field(ge=0)] = 0.3
    """Of light on its way through the water, as e^-(this times the way)."""


class WaterSurface(NamedTuple):
    """The surface as compiled code reads it: its upward normal in the pipe frame, and how far along that it lies."""

    up: tuple[float, ...]
    level_mm: float
    refraction: float
    absorption_per_mm: float
    is_there: bool


DRY = WaterSurface((0.0, -1.0, 0.0), -1e9, 1.333, 0.0, False)


@lru_cache(maxsize=8)
def water_surface(water: Water, pipe: Pipe) -> WaterSurface:
    """The surface in the pipe frame.

    Raises:
        ValueError: for a pipe too steep to hold water, or one that bends, where its surface would be no plane.
    """
    is_there = water.depth_mm > 0
    if is_there and abs(pipe.inclination_deg) > STEEPEST_DEG:
        raise ValueError(
            f"water.depth_mm is {water.depth_mm:g} in a pipe inclined by {pipe.inclination_deg:g} degrees; "
            f"beyond {STEEPEST_DEG:g} none stands along its bottom"
        )
    if is_there and pipe.bends:
        raise ValueError("water.depth_mm: standing water is not modelled in a pipe that bends")
    up = -gravity_direction(pipe)
    level_mm = float(up[1] * (pipe.bore_radius_mm - water.depth_mm))
    return WaterSurface(tuple(up.tolist()), level_mm, water.index, water.absorption_per_m / 1000.0, is_there)


def check_dry(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, water: Water, glass: Glass) -> None:
    """See that camera and projector, with the glass tube if there is one, are above the water.

    Raises:
        ValueError: when one of them is not.
    """
    surface = water_surface(water, pipe)
    if not surface.is_there:
        return
    clear_mm = CLEAR_MM + (glass.inner_radius_mm + glass.thickness_mm if glass.thickness_mm > 0 else 0.0)
    apex = (T_pipe_camera @ rig.projector.T_camera_projector)[:3, 3]
    for name, place in (("camera", T_pipe_camera[:3, 3]), ("projector", apex)):
        above_mm = float(place @ surface.up) - surface.level_mm
        if above_mm < clear_mm:
            raise ValueError(
                f"water.depth_mm is {water.depth_mm:g}: the {name} is {above_mm:.1f} mm above the water, and needs "
                f"{clear_mm:g} to look on it from the air"
            )


@njit(cache=True, error_model="numpy", forceinline=True)
def above_mm(surface, place):
    """Height of a place over the water, mm; negative within it."""
    up = surface.up
    return up[0] * place[0] + up[1] * place[1] + up[2] * place[2] - surface.level_mm


@njit(cache=True, error_model="numpy", forceinline=True)
def mirrored_place(surface, place):
    """Where a place seems to be in the mirror."""
    return moved_up(surface, place, -2.0 * above_mm(surface, place))


@njit(cache=True, error_model="numpy", forceinline=True)
def mirrored_way(surface, way):
    """A direction, or a change of one, in the mirror."""
    up = surface.up
    return moved_up(surface, way, -2.0 * (up[0] * way[0] + up[1] * way[1] + up[2] * way[2]))


@njit(cache=True, error_model="numpy", forceinline=True)
def moved_up(surface, v, by):
    """A triple with a multiple of the upward normal added."""
    up = surface.up
    return (v[0] + by * up[0], v[1] + by * up[1], v[2] + by * up[2])


@njit(cache=True, error_model="numpy", forceinline=True)
def range_to_water(surface, origin, direction):
    """Range of a ray from the air to the surface, mm; -1 for one that does not go down."""
    up = surface.up
    down = -(up[0] * direction[0] + up[1] * direction[1] + up[2] * direction[2])
    return above_mm(surface, origin) / down if down > 0.0 else -1.0


@njit(cache=True, error_model="numpy", forceinline=True)
def mirrors(surface, direction):
    """Share of the light of a direction in the air that the surface mirrors (Fresnel)."""
    up = surface.up
    cosine = abs(up[0] * direction[0] + up[1] * direction[1] + up[2] * direction[2])
    return reflected(cosine, 1.0 / surface.refraction)


@njit(cache=True, error_model="numpy", forceinline=True)
def into_water(surface, direction):
    """Which way a ray goes on in the water, by Snell's law."""
    up, eta = surface.up, 1.0 / surface.refraction
    cosine = -(up[0] * direction[0] + up[1] * direction[1] + up[2] * direction[2])
    slower = (eta * direction[0], eta * direction[1], eta * direction[2])
    return moved_up(surface, slower, eta * cosine - np.sqrt(1.0 - eta * eta * (1.0 - cosine * cosine)))


@njit(cache=True, error_model="numpy", forceinline=True)
def change_in_water(surface, direction, change):
    """How a ray's direction in the water changes with that in the air; `direction` is the one in the water."""
    up, eta = surface.up, 1.0 / surface.refraction
    upward = up[0] * direction[0] + up[1] * direction[1] + up[2] * direction[2]
    lost = up[0] * change[0] + up[1] * change[1] + up[2] * change[2]
    level = moved_up(surface, (eta * change[0], eta * change[1], eta * change[2]), -eta * lost)
    turned = direction[0] * level[0] + direction[1] * level[1] + direction[2] * level[2]
    return moved_up(surface, level, -turned / upward)


@njit(cache=True, error_model="numpy")
def crossing(surface, origin, point):
    """Where light between a place in the air and one in the water passes the surface (Snell).

    The unknown is the tangent of the angle in the air. The way that it spans grows with it, ever more slowly, so that
    Newton's steps from below never pass the root.
    """
    n2, high, deep = surface.refraction**2, above_mm(surface, origin), -above_mm(surface, point)
    foot = moved_up(surface, origin, -high)
    x, y, z = point[0] - foot[0], point[1] - foot[1], point[2] - foot[2]
    x, y, z = moved_up(surface, (x, y, z), deep)
    across = np.sqrt(x * x + y * y + z * z)
    if across < 1e-9:
        return foot
    tangent = across / (high + deep / surface.refraction)
    for _ in range(CROSSING_STEPS):
        root = np.sqrt(n2 + (n2 - 1.0) * tangent * tangent)
        missed = across - high * tangent - deep * tangent / root
        tangent += missed / (high + deep * n2 / (root * root * root))
    part = min(high * tangent / across, 1.0)
    return (foot[0] + part * x, foot[1] + part * y, foot[2] + part * z)
