"""What a pixel's piece of a lit surface throws back to the camera: the projector's bands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sensor_model.optics import REFERENCE_RANGE_MM
from sensor_model.slide_print import edge_shift, slit_jag
from sensor_model.wall_rays import wrapped
from sensor_model.ways import dot, turned

BOX_PER_SIGMA = 3.4641016151377544  # width of a box with a standard deviation of one
GRAZING = 0.05  # cosine below which a surface is taken to be seen no flatter


class Spot(NamedTuple):
    """A pixel's piece of a surface on the slide: tangent of its half angle, how much of it, azimuth; and its light.

    `per_mm` is how much the tangent changes with a millimetre on the surface, `mirrored` the light it throws back as a
    mirror does, in the light's own colour.
    """

    tangent: float
    footprint: float
    azimuth: float
    level: float
    per_mm: float
    mirrored: float


@njit(cache=True, error_model="numpy", forceinline=True)
def light_spot(rgb, beam, jag_table_rad, spot):
    """Add the light that a pixel's piece of a surface throws back; the table is the rig's own jaggedness."""
    tangent, footprint, level = spot.tangent, spot.footprint, spot.level
    if beam.jag_rad > 0 or jag_table_rad.shape[1] > 0:
        edge, shift = _nearest_edge(beam, tangent), 0.0
        if beam.jag_rad > 0:
            shift = beam.jag_rad * edge_shift(edge, spot.azimuth, beam.jag_cells)
        if jag_table_rad.shape[1] > 0:  # a larger half angle is found further in
            shift -= slit_jag(jag_table_rad, edge, spot.azimuth)
        tangent += shift * (1 + tangent * tangent)
    spread = 0.0
    if beam.translucency > 0:
        spread = np.hypot(footprint, BOX_PER_SIGMA * beam.translucency_mm * spot.per_mm)
    for band in range(len(beam.lit_from)):
        share = _of_band(beam, band, tangent, footprint, level)
        if beam.translucency > 0:
            under = _of_band(beam, band, tangent, spread, level)
            share += beam.translucency * (under - share)
        if share > 0:
            for channel in range(3):
                rgb[channel] += share * beam.colors[band][channel]
        if spot.mirrored > 0:
            share = _of_band(beam, band, tangent, footprint, spot.mirrored)
            for channel in range(3):
                rgb[channel] += share * beam.lights[band][channel]


@njit(cache=True, error_model="numpy", forceinline=True)
def _of_band(beam, band, tangent, footprint, level):
    begin, end = tangent - footprint / 2, tangent + footprint / 2
    return max(level * (min(end, beam.lit_to[band]) - max(begin, beam.lit_from[band])) / footprint, 0.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def aim(view, beam, path, sight, range_mm, right, down, point, normal):
    """Where a pixel's piece of a surface lies on the slide, and its light."""
    apex, direction = view.apex, sight.direction
    came = (point[0] - path.source[0], point[1] - path.source[1], point[2] - path.source[2])
    facing = -dot(normal, came) / np.sqrt(dot(came, came))
    looking = dot(normal, direction)
    if facing <= 0 or looking >= 0:
        return Spot(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    to = (path.aimed[0] - apex[0], path.aimed[1] - apex[1], path.aimed[2] - apex[2])
    distance = np.sqrt(dot(to, to))
    M = view.R_projector_pipe
    x, y, along = turned(M, to[0], to[1], to[2])
    across = np.sqrt(x * x + y * y)
    tangent = across / along
    # gradient of the tangent on the wall, then per pixel: the footprint of one pixel on the slide
    along_right, along_down, steepness2, along_normal = 0.0, 0.0, 0.0, 0.0
    n_right, n_down = dot(normal, right) / looking, dot(normal, down) / looking
    reach_mm = range_mm + sight.before_mm
    for i in range(3):
        gradient = (path.side * (M[0][i] * x + M[1][i] * y) / across - tangent * M[2][i]) / along
        along_right += gradient * reach_mm * (right[i] - direction[i] * n_right)
        along_down += gradient * reach_mm * (down[i] - direction[i] * n_down)
        steepness2 += gradient * gradient
        along_normal += gradient * normal[i]
    footprint = max(np.sqrt(along_right**2 + along_down**2), 1e-6)
    azimuth = np.arctan2(x, -y)
    level, shine = _strut(beam, azimuth), 0.0
    if level > 0:
        passed, reaches = sight.passed * path.passed, (REFERENCE_RANGE_MM / distance) ** beam.distance_power
        if beam.gloss > 0:
            shine = passed * level * reaches * _mirrored_share(beam, came, direction, normal)
        level *= facing**beam.angle_power * reaches
        level *= passed
    return Spot(tangent, footprint, azimuth, level, np.sqrt(max(steepness2 - along_normal**2, 0.0)), shine)


@njit(cache=True, error_model="numpy")
def dimmed(spot, share):
    """The same on a surface that throws less back."""
    return Spot(spot.tangent, spot.footprint, spot.azimuth, share * spot.level, spot.per_mm, share * spot.mirrored)


@njit(cache=True, error_model="numpy")
def _mirrored_share(beam, came, direction, normal):
    """What a glossy surface throws back towards the eye, a white matt one that faces the light being 1.

    Blinn-Phong's spread of facets, normalised, with Schlick's share of what each of them mirrors.
    """
    length = np.sqrt(dot(came, came))
    half = (
        -came[0] / length - direction[0],
        -came[1] / length - direction[1],
        -came[2] / length - direction[2],
    )
    size = np.sqrt(dot(half, half))
    steep, onto = dot(half, normal) / size, -dot(half, direction) / size
    facets = beam.gloss + (1.0 - beam.gloss) * (1.0 - onto) ** 5
    spread = 0.125 * (beam.gloss_power + 2.0) * max(steep, 0.0) ** beam.gloss_power
    return facets * spread / max(-dot(normal, direction), GRAZING)


@njit(cache=True, error_model="numpy", forceinline=True)
def _strut(beam, azimuth):
    if beam.strut_half_width_rad == 0.0:
        return 1.0
    beyond = abs(wrapped(azimuth - beam.strut_azimuth_rad)) - beam.strut_half_width_rad
    return min(max(beyond / max(beam.strut_softness_rad, 1e-6) + 0.5, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _nearest_edge(beam, tangent):
    """Number of the slit edge nearest to a place of the slide."""
    nearest, edge = 1e9, 0
    for band in range(len(beam.lit_from)):
        if abs(tangent - beam.lit_from[band]) < nearest:
            nearest, edge = abs(tangent - beam.lit_from[band]), 2 * band
        if abs(tangent - beam.lit_to[band]) < nearest:
            nearest, edge = abs(tangent - beam.lit_to[band]), 2 * band + 1
    return edge
