"""The picture along lines that leave its principal point, and its noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from numba import njit

from algorithms.robust import MAD_TO_SIGMA
from sensor_model.geometry import fisheye_project
from sensor_model.rig import Rig


class Lines(NamedTuple):
    """Colours along lines that leave the picture's centre, and their sums; NaN outside the picture."""

    rgb: Float[np.ndarray, "azimuths radii 3"]
    light: Float[np.ndarray, "azimuths radii"]


def radial_range_px(rig: Rig) -> tuple[int, int]:
    """First and last radius at which a slit can appear: no wall is so far that its ray is flatter than the cone."""
    flattest = rig.projector.slit_half_angles_rad[0] - np.radians(3.0)
    camera = rig.camera
    ray = np.array([0.0, np.sin(flattest), np.cos(flattest)])
    first = fisheye_project(ray, camera.intrinsics)[1] - camera.cy_px
    last = np.hypot(max(camera.cx_px, camera.width_px - camera.cx_px), 0.5 * camera.height_px)
    return int(first), int(last)


def directions(azimuths: int, turn: float = 0.0) -> Float[np.ndarray, "azimuths 2"]:
    """Direction of each line in the picture: from `turn` steps past 12 o'clock, clockwise (u right, v down)."""
    angle = (np.arange(azimuths) + turn) * 2 * np.pi / azimuths
    return np.stack([np.sin(angle), -np.cos(angle)], axis=1)


def polar_lines(
    picture: UInt8[np.ndarray, "height width 3"], rig: Rig, along: Float[np.ndarray, "azimuths 2"]
) -> Lines:
    """The picture resampled from the principal point along lines of these directions, one pixel a step."""
    first, last = radial_range_px(rig)
    return Lines(*_polar(picture.ravel(), picture.shape, rig.camera.cx_px, rig.camera.cy_px, along, first, last))


@njit(cache=True)
def _polar(levels, shape, cx, cy, directions, first, last):
    """Bilinear samples with exact fractions (a library's fixed-point map errs by 1/64 px).

    Places before levels, and unsigned: several are then done at a time, and none is looked at for being negative.
    """
    height, width = shape[0], shape[1]
    n, row = last - first, np.uint64(3 * width)
    rgb = np.empty((directions.shape[0], n, 3), dtype=np.float32)
    light = np.empty((directions.shape[0], n), dtype=np.float32)
    place = np.empty(n, dtype=np.uint64)
    right, down = np.empty(n, dtype=np.float32), np.empty(n, dtype=np.float32)
    for k in range(directions.shape[0]):
        along_u, along_v = directions[k, 0], directions[k, 1]
        end = _steps_inside(cx, along_u, width, _steps_inside(cy, along_v, height, last)) - first
        for i in range(end):
            u, v = cx + (first + i) * along_u, cy + (first + i) * along_v
            left, top = int(u), int(v)
            right[i], down[i] = u - left, v - top
            place[i] = 3 * (top * width + left)
        for i in range(end):
            a, b, total = right[i], down[i], np.float32(0)
            for c in range(3):
                here = place[i] + np.uint64(c)
                upper, lower = np.float32(levels[here]), np.float32(levels[here + row])
                upper += a * (np.float32(levels[here + np.uint64(3)]) - upper)
                lower += a * (np.float32(levels[here + row + np.uint64(3)]) - lower)
                value = upper + b * (lower - upper)
                rgb[k, i, c] = value
                total += value
            light[k, i] = total
        rgb[k, max(end, 0) :] = np.nan
        light[k, max(end, 0) :] = np.nan
    return rgb, light


@njit(cache=True)
def _steps_inside(center, along, size, most):
    """How many steps of one pixel from a place stay between the first and the last pixel of a row or column."""
    steps = most
    while steps > 0 and not 0 <= center + (steps - 1) * along < size - 1:
        if along > 0:
            steps = min(steps - 1, int((size - 1 - center) / along) + 1)
        elif along < 0:
            steps = min(steps - 1, int(center / -along) + 1)
        else:
            steps = 0
    return steps


def pixel_noise(light: Float[np.ndarray, "azimuths radii"]) -> float:
    """Standard deviation of the noise of one sample, from second differences, which the slow picture hardly enters."""
    thin = light[::8]
    second = (thin[:, 2:] - 2 * thin[:, 1:-1] + thin[:, :-2])[:, ::2]
    second = second[np.isfinite(second)]
    return MAD_TO_SIGMA * float(np.median(np.abs(second))) / np.sqrt(6) if second.size else 0.0
