"""What the shaders are told: the slide, where its light can reach, the shadow's crop, and every effect's numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from sensor_model.geometry import inverse, transform
from sensor_model.glass import Glass, tube_of
from sensor_model.optics import REFERENCE_RANGE_MM, Light, Optics
from sensor_model.rig import Camera, Projector, Rig
from sensor_model.ring_renderer import SHADOW_TEXELS
from sensor_model.wall_rays import near_wall, wall_ranges_mm
from sensor_model.water import Water, water_surface
from twin.bends import bent, unbent
from twin.mesh import feature_box
from twin.pipe import Pipe

SLIDE_TEXELS = 8192  # ten to a pixel of the picture
SHADOW_BIAS_MM = 0.25
SHADED_BEYOND_MM = 0.02  # the bore, being convex, shades nothing
NEAREST_MM = 1.0
HOLE_MM = 0.05
LEAST_CROP = 0.01  # half of its side, as a tangent
BENT_MARGIN_MM = 25.0
BENDS_PER_MM, GLASS_REACH = 0.03, 3.0  # of glass: how far light is moved in tangent, at most, and in mm along the pipe
WATER_BENDS_PER_MM = 0.004  # of depth, likewise


def reachable_mm(pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig, optics: Optics) -> tuple[float, float]:
    """Distances along the pipe between which the projector's light can meet the wall or what shades it."""
    T_pipe_projector = T_pipe_camera @ rig.projector.T_camera_projector
    if pipe.bends:
        return _bent_reach_mm(pipe, T_pipe_camera, T_pipe_projector, rig)
    apex, axis = T_pipe_projector[:3, 3], T_pipe_projector[:3, 2]
    tilt = np.arccos(np.clip(axis[2], -1, 1))
    inner, outer = np.radians([rig.projector.inner_half_angle_deg, rig.projector.outer_half_angle_deg])
    farthest = (pipe.outer_radius_mm + np.hypot(*apex[:2])) / np.tan(max(inner - tilt, 0.05))
    nearest = (pipe.wall.smallest_radius - np.hypot(*apex[:2])) / np.tan(min(outer + tilt, 1.5))
    glass, water = optics.glass, optics.water
    if glass.thickness_mm > 0:  # which sends some of it across the tube first
        farthest += 2 * (glass.inner_radius_mm + np.hypot(*glass.offset_mm)) / np.tan(max(inner - tilt, 0.05))
        nearest -= GLASS_REACH * glass.thickness_mm
    if water.depth_mm > 0:  # which mirrors some of it, and bends the rest down
        farthest += 2 * (pipe.outer_radius_mm + np.hypot(*apex[:2])) / np.tan(max(inner - tilt, 0.05))
        nearest -= water.depth_mm
    return float(apex[2] + nearest - 5.0), float(apex[2] + farthest + 5.0)


def _bent_reach_mm(
    pipe: Pipe, T_pipe_camera: np.ndarray, T_pipe_projector: np.ndarray, rig: Rig
) -> tuple[float, float]:
    """`reachable_mm` by following the light's outermost rays."""
    half = np.radians([rig.projector.inner_half_angle_deg, rig.projector.outer_half_angle_deg])
    alpha, turn = (a.ravel() for a in np.meshgrid(half, np.arange(72) * np.pi / 36))
    rays = np.stack([np.sin(alpha) * np.sin(turn), -np.sin(alpha) * np.cos(turn), np.cos(alpha)], axis=-1)
    rays = rays @ T_pipe_projector[:3, :3].T
    wall, apex = near_wall(pipe, float(T_pipe_camera[2, 3])), T_pipe_projector[:3, 3]
    ends = apex + wall_ranges_mm(wall, tuple(apex.tolist()), rays)[:, None] * rays
    z = [unbent(wall.axis, *end)[2] for end in ends.tolist()]
    return min(z) - BENT_MARGIN_MM, max(z) + BENT_MARGIN_MM


def shadow_crop(
    pipe: Pipe,
    features: list[int],
    about_mm: float,
    T_projector_pipe: np.ndarray,
    outer_tangent: float,
    optics: Optics,
) -> tuple[float, float, float, float, float] | None:
    """Square of the projector's tangent plane that holds features: centre x, y, half side; then their depth range.

    None where nothing can be shaded.
    """
    corners = []
    for index in features:
        box = feature_box(pipe, index)
        theta = np.linspace(
            box.theta_from_rad, box.theta_to_rad, 2 + int((box.theta_to_rad - box.theta_from_rad) / 0.05)
        )
        z = np.linspace(box.z_from_mm, box.z_to_mm, 2 + int((box.z_to_mm - box.z_from_mm) / 10))
        for rho in (pipe.wall.smallest_radius, pipe.outer_radius_mm * 1.01):
            t, at = (a.ravel() for a in np.meshgrid(theta, z))
            corners.append(np.stack([rho * np.sin(t), -rho * np.cos(t), at, np.ones_like(at)], axis=-1))
    if not corners:
        return None
    places = np.concatenate(corners)
    if pipe.bends:
        places[:, :3] = bent(pipe.axis, about_mm, places[:, :3])
    place = places @ T_projector_pipe.T
    place = place[place[:, 2] > NEAREST_MM]
    tangents = place[:, :2] / place[:, 2:3]
    seen = np.linalg.norm(tangents, axis=1) <= 1.1 * outer_tangent
    if not seen.any():
        return None
    reach = 1.02 * outer_tangent
    low = np.maximum(tangents[seen].min(axis=0), -reach)
    high = np.minimum(tangents[seen].max(axis=0), reach)
    bends = BENDS_PER_MM * optics.glass.thickness_mm + WATER_BENDS_PER_MM * optics.water.depth_mm
    half = max(float(max(high - low) / 2) * 1.05 + bends, LEAST_CROP)  # one corner alone may be in reach
    middle = (low + high) / 2
    return (
        float(middle[0]),
        float(middle[1]),
        half,
        max(float(place[:, 2].min()) - 5, NEAREST_MM),
        float(place[:, 2].max()) + 5,
    )


def slide_table(beam: Light) -> tuple[Float[np.ndarray, "1 texels 4"], Float[np.ndarray, " 4"]]:
    """The slide as a table over the tangent of the half angle, and where that table and its light begin and end.

    A row has the light of all bands summed up to its tangent, so that the light between any two tangents is a
    difference, and the number of the nearest edge.
    """
    first, last = beam.lit_from[0] * 0.98, beam.lit_to[-1] * 1.02
    tangent = np.linspace(first, last, SLIDE_TEXELS)
    lit = np.array([beam.lit_from, beam.lit_to])
    passed = np.clip(tangent[:, None], *lit) - lit[0]
    edges = lit.T.ravel()
    nearest = np.abs(tangent[:, None] - edges).argmin(axis=1)
    table = np.concatenate([passed @ np.array(beam.colors), nearest[:, None]], axis=1).astype(np.float32)
    return table[None], np.array([first, tangent[1] - first, first, last])


def print_table(projector: Projector) -> Float[np.ndarray, "slits cells 4"]:
    """The rig's own jaggedness, rad, in the first of four channels; a cell of zero where it has none."""
    jag_rad = projector.printed_jag_rad
    table = np.zeros((len(projector.slits), max(jag_rad.shape[1], 1), 4), dtype=np.float32)
    table[:, : jag_rad.shape[1], 0] = jag_rad
    return table


def uniforms_of(
    pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig, optics: Optics, beam: Light, crop: tuple[float, ...]
) -> dict[str, Any]:
    """Every number but the slide's."""
    T_world_projector = T_pipe_camera @ rig.projector.T_camera_projector
    T_world_projector[2, 3] -= T_pipe_camera[2, 3]
    return {
        **_camera_uniforms(rig.camera, pipe, T_pipe_camera),
        **_beam_uniforms(beam),
        **_shadow_uniforms(crop),
        "projector_world": inverse(T_world_projector),
        "camera_projector": rig.projector.T_camera_projector,
        "extent": _extent(pipe, T_pipe_camera),
        **_glass_uniforms(optics.glass, rig.projector.T_camera_projector),
        **_water_uniforms(pipe, T_pipe_camera, rig, optics.water),
        **_finish_uniforms(beam, optics.wall_reflectance),
    }


def _extent(pipe: Pipe, T_pipe_camera: np.ndarray) -> np.ndarray:
    shaded = 0.0 if pipe.bends else pipe.wall.smallest_radius + SHADED_BEYOND_MM
    beyond = 1e6 if pipe.backed else pipe.outer_radius_mm - HOLE_MM
    return np.array([shaded, beyond, pipe.start_mm - T_pipe_camera[2, 3], pipe.end_mm - T_pipe_camera[2, 3]])


def _camera_uniforms(camera: Camera, pipe: Pipe, T_pipe_camera: np.ndarray) -> dict[str, Any]:
    fx, fy, skew, cx, cy = camera.intrinsics[:5]
    farthest = 30 * pipe.outer_radius_mm + abs(T_pipe_camera[:2, 3]).max()
    return {
        "lens": np.array([fx, fy, cx, cy]),
        "lens_k": camera.intrinsics[5:],
        "picture": np.array([skew, camera.width_px, camera.height_px, farthest]),
    }


def _beam_uniforms(beam: Light) -> dict[str, Any]:
    return {
        "strut": np.array([beam.strut_azimuth_rad, beam.strut_half_width_rad, beam.strut_softness_rad, beam.jag_rad]),
        "slide_cells": float(beam.jag_cells),
        "falloff": np.array([beam.distance_power, beam.angle_power, REFERENCE_RANGE_MM, beam.housing_radius_mm]),
    }


def _shadow_uniforms(crop: tuple[float, ...]) -> dict[str, Any]:
    x, y, half, near, far = crop
    return {
        "crop": np.array([x, y, half, 0.0]),
        "depth_range": np.array([near, far, SHADOW_TEXELS, SHADOW_BIAS_MM]),
    }


def _glass_uniforms(glass: Glass, T_camera_projector: np.ndarray) -> dict[str, Any]:
    if glass.thickness_mm == 0:
        return {}
    tube = tube_of(glass)
    T_tube_camera = inverse(transform(np.array(tube.axes).T, np.array(tube.center)))
    return {
        "tube_camera": T_tube_camera,
        "tube_projector": T_tube_camera @ T_camera_projector,
        "tube": np.array([tube.inner, tube.outer, tube.refraction, tube.ghost]),
    }


def _water_uniforms(pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig, water: Water) -> dict[str, Any]:
    surface = water_surface(water, pipe)
    if not surface.is_there:
        return {}

    def seen_from(T_pipe_seer: np.ndarray) -> np.ndarray:
        up = np.array(surface.up)
        return np.append(up @ T_pipe_seer[:3, :3], surface.level_mm - up @ T_pipe_seer[:3, 3])

    return {
        "water_camera": seen_from(T_pipe_camera),
        "water_projector": seen_from(T_pipe_camera @ rig.projector.T_camera_projector),
        "water_world": seen_from(transform(np.eye(3), np.array([0.0, 0.0, T_pipe_camera[2, 3]]))),
        "water": np.array([surface.refraction, surface.absorption_per_mm, 0.0, 0.0]),
        "bore_radius": pipe.bore_radius_mm,
    }


def _finish_uniforms(beam: Light, reflectance: tuple[float, ...]) -> dict[str, Any]:
    if not _is_finished(beam):
        return {}
    return {
        "finish": np.array([beam.gloss, beam.gloss_power, beam.translucency, beam.translucency_mm]),
        "unpainted": np.array([1 / share if share > 0 else 0.0 for share in reflectance]),
    }


def _is_finished(beam: Light) -> bool:
    return beam.gloss > 0 or beam.translucency > 0


def effects_of(rig: Rig, beam: Light, crop: tuple[float, ...] | None, optics: Optics) -> set[str]:
    """What the shader has to reckon with."""
    azimuth = np.linspace(0, 2 * np.pi, 72)
    tangent = beam.lit_from[0]
    rays = np.stack([tangent * np.sin(azimuth), -tangent * np.cos(azimuth), np.ones_like(azimuth)], axis=-1)
    T = rig.projector.T_camera_projector
    rays = rays @ T[:3, :3].T
    at_camera = T[:2, 3] - rays[:, :2] * (T[2, 3] / rays[:, 2])[:, None]
    housed = np.linalg.norm(at_camera, axis=1).min() < beam.housing_radius_mm + 0.1
    cases = {
        "HOUSED": housed,
        "SHADOWED": crop is not None,
        "JAGGED": beam.jag_rad > 0,
        "PRINTED": rig.projector.jag_table_rad.size > 0,
        "GLASS": optics.glass.thickness_mm > 0,
        "WATER": optics.water.depth_mm > 0,
        "BENT": optics.glass.thickness_mm > 0 or optics.water.depth_mm > 0,
        "FINISHED": _is_finished(beam),
    }
    return {name for name, matters in cases.items() if matters}
