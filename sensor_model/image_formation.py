"""From the drawn picture to the stored one: dirt, inter-reflection, haze, defocus, bleed, noise, tone, storage."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numba import njit

from sensor_model.dirt import seen_through
from sensor_model.optics import Optics
from sensor_model.processing import processed
from sensor_model.rig import Camera

CELL_PX = 8  # inter-reflection is gathered from cells of this size
HAZE_CELL_PX = 16
HAZE_SPREAD_PX = 110.0
RINGS = np.arange(-1.5, 24.0, 0.125)  # of wall, by their distance ahead of the camera in bore radii
REFLECTIONS = 60
TONES = 1 << 16


def expose(
    linear_rgb: Float[np.ndarray, "h w 3"],
    optics: Optics,
    rng: np.random.Generator,
    camera: Camera,
    nearness_per_mm: Float[np.ndarray, "h w"] | None = None,
) -> UInt8[np.ndarray, "h w 3"]:
    """The stored picture, RGB.

    Args:
        linear_rgb: What was drawn: direct light, linear, float32.
        optics: The settings of lens, air and chip; with both noises zero, `rng` is left alone.
        rng: The source of noise, one stream for one picture.
        camera: Tells how far off the axis a pixel looks, for defocus and inter-reflection.
        nearness_per_mm: One over the wall's distance, which `focus_mm` asks for: `focus.nearness_per_mm` gives it.

    Raises:
        ValueError: when the optics blur by distance, and there is none.
    """
    if optics.focus_mm > 0 and optics.defocus_px > 0 and nearness_per_mm is None:
        raise ValueError(f"focus_mm is {optics.focus_mm:g}, and the wall's distance is not known here")
    linear = seen_through(np.ascontiguousarray(linear_rgb, dtype=np.float32), optics.dirt, camera)
    haze = 1 - (1 - optics.haze) * (1 - optics.dirt.film) if optics.dirt.film > 0 else optics.haze
    noisy = optics.shot_noise > 0 or optics.read_noise > 0
    noise = rng.standard_normal(linear.shape, dtype=np.float32) if noisy else np.zeros((1, 1, 3), dtype=np.float32)
    blurred = cv2.GaussianBlur(linear, (0, 0), optics.defocus_px) if optics.defocus_px > 0 else linear
    blur_share = _blur_share(optics, camera)
    if optics.focus_mm > 0 and nearness_per_mm is not None:
        share = np.minimum((np.float32(optics.focus_mm) * nearness_per_mm - 1) ** 2, 1)
        blurred, blur_share = linear + share[..., None] * (blurred - linear), np.ones_like(blur_share)
    stored = np.empty(linear.shape, dtype=np.uint8)
    _finish(
        linear,
        blurred,
        blur_share,
        inter_reflection(linear, optics, camera),
        _veil(linear) if haze > 0 else np.zeros((1, 1, 3), dtype=np.float32),
        noise,
        _tone_curve(optics.gamma, optics.lost_bits),
        np.array([camera.cx_px, camera.cy_px]),
        np.array(
            [haze, optics.color_bleed, optics.exposure, optics.shot_noise**2, optics.read_noise**2],
            dtype=np.float32,
        ),
        stored,
    )
    return processed(stored, optics.processing)


def inter_reflection(linear: Float[np.ndarray, "h w 3"], optics: Optics, camera: Camera) -> Float[np.ndarray, "r 3"]:
    """Indirect light by distance from the picture's centre, one row a pixel.

    The wall is taken as a matt cylinder about the optical axis whose rings of wall exchange light, all orders of
    reflection summed: a bore is so nearly closed that what arrives hardly depends on the clock position.
    """
    radii = _angles_rad(camera).size
    if optics.inter_reflection == 0:
        return np.zeros((radii, 3), dtype=np.float32)
    height, width = linear.shape[0] // CELL_PX, linear.shape[1] // CELL_PX
    cells = cv2.resize(linear[: height * CELL_PX, : width * CELL_PX], (width, height), interpolation=cv2.INTER_AREA)
    v, u = (np.mgrid[:height, :width] + 0.5) * CELL_PX - 0.5
    annulus = (np.hypot(u - camera.cx_px, v - camera.cy_px) / CELL_PX).astype(int).ravel()
    count = np.bincount(annulus)
    ahead = 1 / np.tan(np.maximum(_angles_rad(camera), 1e-3))
    direct = np.empty((RINGS.size, 3))
    for channel in range(3):
        mean = np.bincount(annulus, weights=cells[..., channel].ravel()) / np.maximum(count, 1)
        radius_px = (np.arange(mean.size) + 0.5) * CELL_PX
        direct[:, channel] = np.interp(_radius_px(RINGS, camera), radius_px, mean, right=0.0)
    indirect = optics.inter_reflection * _reflected(direct, np.array(optics.wall_reflectance))
    columns = [np.interp(ahead, RINGS, column, right=0.0) for column in indirect.T]
    return np.stack(columns, axis=-1).astype(np.float32)


def _reflected(
    direct: Float[np.ndarray, "rings 3"], reflectance: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "rings 3"]:
    """What rings of wall pass on to each other, order after order: x = rho K (direct + x)."""
    passed_on = np.zeros_like(direct)
    for _ in range(REFLECTIONS):
        # no BLAS here: its threads would fight the other workers, and its sums depend on their number
        passed_on = reflectance * np.einsum("ij,jc->ic", _ring_exchange(), direct + passed_on)
    return passed_on


@lru_cache(maxsize=1)
def _ring_exchange() -> Float[np.ndarray, "rings rings"]:
    """Share of a ring's light that comes from each other ring: the form factors of a cylinder's inner wall."""
    x = np.abs(RINGS[:, None] - RINGS) / 2
    return (1 - (2 * x**3 + 3 * x) / (2 * (x**2 + 1) ** 1.5)) * (RINGS[1] - RINGS[0]) / 2


@lru_cache(maxsize=4)
def _angles_rad(camera: Camera) -> Float[np.ndarray, " r"]:
    """Angle from the optical axis by distance from the picture's centre, one entry a pixel."""
    angles = np.linspace(0, 2.2, 4000)
    corner = np.hypot(
        max(camera.cx_px, camera.width_px - camera.cx_px), max(camera.cy_px, camera.height_px - camera.cy_px)
    )
    return np.interp(np.arange(int(corner) + 3), _fisheye_radius_px(angles, camera), angles)


def _radius_px(ahead: np.ndarray, camera: Camera) -> np.ndarray:
    return _fisheye_radius_px(np.arctan2(1.0, ahead), camera)


def _fisheye_radius_px(angle: np.ndarray, camera: Camera) -> np.ndarray:
    t2 = angle * angle
    k = camera
    return k.fx_px * angle * (1 + t2 * (k.k1 + t2 * (k.k2 + t2 * (k.k3 + t2 * k.k4))))


def _blur_share(optics: Optics, camera: Camera) -> Float[np.ndarray, " r"]:
    """Share of the blurred picture that has the blur's variance at each distance from the centre.

    In a bore the depth along a ray is R / sin(angle), and defocus goes with the difference of inverse depths.
    """
    focus = np.sin(np.radians(optics.focus_deg))
    return (((np.sin(_angles_rad(camera)) - focus) / max(focus, 1e-3)) ** 2).clip(0, 1).astype(np.float32)


def _veil(linear: np.ndarray) -> np.ndarray:
    """The picture scattered widely."""
    height, width = linear.shape[:2]
    size = (max(width // HAZE_CELL_PX, 1), max(height // HAZE_CELL_PX, 1))
    small = cv2.GaussianBlur(
        cv2.resize(linear, size, interpolation=cv2.INTER_AREA), (0, 0), HAZE_SPREAD_PX / HAZE_CELL_PX
    )
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)


@lru_cache(maxsize=4)
def _tone_curve(gamma: float, lost_bits: int) -> UInt8[np.ndarray, " tones"]:
    """Stored value of each of evenly spaced levels of light."""
    levels = 2 ** (8 - lost_bits) - 1
    value = np.rint((np.arange(TONES) / (TONES - 1)) ** (1 / gamma) * levels)
    return np.rint(value * 255 / levels).astype(np.uint8)


@njit(cache=True, error_model="numpy")
def _finish(linear, blurred, blur_share, indirect, veil, noise, tones, center, dials, stored):
    haze, bleed, exposure, shot_variance, read_variance = dials[0], dials[1], dials[2], dials[3], dials[4]
    height, width, _ = linear.shape
    noisy, one = noise.shape[0] > 1, np.float32(1)
    top = np.float32(tones.size - 1)
    light = np.empty(3, dtype=np.float32)
    for row in range(height):
        for col in range(width):
            radius = np.float32(np.sqrt((col - center[0]) ** 2 + (row - center[1]) ** 2))
            ring = int(radius)
            part = radius - np.float32(ring)
            share = blur_share[ring]
            total = np.float32(0)
            for c in range(3):
                value = linear[row, col, c]
                value += share * (blurred[row, col, c] - value)
                value += indirect[ring, c] + part * (indirect[ring + 1, c] - indirect[ring, c])
                if haze > 0:
                    value += haze * (veil[row, col, c] - value)
                light[c] = value
                total += value
            for c in range(3):
                value = exposure * ((one - bleed) * light[c] + bleed * np.float32(0.5) * (total - light[c]))
                if noisy:
                    value += np.sqrt(shot_variance * max(value, np.float32(0)) + read_variance) * noise[row, col, c]
                stored[row, col, c] = tones[int(min(max(value, np.float32(0)), one) * top + np.float32(0.5))]
