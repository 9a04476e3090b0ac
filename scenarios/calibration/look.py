"""How a picture of the rings looks, in numbers, and the twin drawn at the same place beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from algorithms.calibration.pipe_view import PipeView
from algorithms.calibration.slide import with_jag
from algorithms.decoding.dips import find_dips
from algorithms.decoding.lines import directions, pixel_noise, polar_lines, radial_range_px
from algorithms.decoding.settings import DecodeSettings
from algorithms.robust import MAD_TO_SIGMA
from sensor_model.focus import nearness_per_mm
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.raycast import draw
from sensor_model.rig import Rig
from twin.pipe import Pipe

BAND_PX = 2  # half of what is averaged of a band or a slit
SMOOTH_LINES = 31
LEAST_ROW = 30
STRUT_LINES = 12  # either side of 12 o'clock


@dataclass(frozen=True)
class Look:
    """The measures of one picture: levels of the file (0 to 255), px of the picture, degrees of azimuth."""

    contrast_pct: Float[np.ndarray, "slits"]
    width_px: Float[np.ndarray, "slits"]
    jitter_px: Float[np.ndarray, "slits"]
    jitter_length_deg: float
    band_rgb: Float[np.ndarray, "bands 3"]
    noise_levels: float
    haze_rgb: Float[np.ndarray, "3"]

    def figures(self) -> dict[str, float]:
        """One number a measure: means over the slits and the bands that were found."""
        named = {
            "contrast_pct": self.contrast_pct,
            "width_px": self.width_px,
            "jitter_px": self.jitter_px,
            "jitter_length_deg": np.array([self.jitter_length_deg]),
            "noise_levels": np.array([self.noise_levels]),
        }
        for k, channel in enumerate(("red", "green", "blue")):
            named[f"bands_{channel}"] = self.band_rgb[:, k]
            named[f"haze_{channel}"] = self.haze_rgb[k : k + 1]
        return {name: float(np.mean(values[np.isfinite(values)])) for name, values in named.items()}


def look_of(picture: UInt8[np.ndarray, "height width 3"], view: PipeView, rig: Rig) -> Look:
    """Measure a decoded picture."""
    settings = DecodeSettings()
    lines = polar_lines(picture, rig, directions(settings.azimuths))
    first = radial_range_px(rig)[0]
    radius = _radii(view, rig, settings.azimuths)
    slits = len(radius)
    dips = find_dips(lines, first, settings)
    smooth = np.array([_running_median(row) for row in radius])
    rough = radius - smooth
    middles = [0.5 * (smooth[j] + smooth[j + 1]) for j in range(slits - 1)]
    bands = [_sampled(lines.rgb, middle - first) for middle in middles]
    contrast = np.full(slits, np.nan)
    for j in range(slits):
        floor = _sampled(lines.rgb, radius[j] - first).sum(axis=1)
        beside = [bands[k].sum(axis=1) for k in (j - 1, j) if 0 <= k < slits - 1]
        if np.isfinite(floor).any():
            level = np.mean(np.array(beside), axis=0)
            contrast[j] = 100 * np.nanmedian(1 - floor / level)
    strut = np.r_[-STRUT_LINES:STRUT_LINES]
    return Look(
        contrast,
        _widths(dips.radius_px, dips.width_px, radius),
        np.array([_rms(row) for row in rough]),
        _length_deg(rough, 360 / settings.azimuths),
        np.array([np.nanmean(band, axis=0) if np.isfinite(band).any() else np.full(3, np.nan) for band in bands]),
        pixel_noise(lines.light) / np.sqrt(3),
        np.nanmean(lines.rgb[strut][:, 100:300], axis=(0, 1)),
    )


def twin_of(view: PipeView, rig: Rig, optics: Optics, rng: np.random.Generator) -> UInt8[np.ndarray, "height width 3"]:
    """The twin's picture of a clean pipe of the same radius from the same place."""
    pipe = Pipe(inner_radius_mm=view.alignment.radius_mm, wall_thickness_mm=7.5)
    smooth = with_jag(rig, np.zeros((len(rig.projector.slits), 0)))
    T_pipe_camera = view.alignment.T_pipe_camera
    nearness = nearness_per_mm(pipe, T_pipe_camera, rig.camera, optics)
    return expose(draw(pipe, T_pipe_camera, smooth, optics), optics, rng, rig.camera, nearness)


def _radii(view: PipeView, rig: Rig, lines: int) -> Float[np.ndarray, "slits lines"]:
    """Distance of each slit from the principal point on each line, px; NaN where it was not found."""
    off = view.points.pixel - np.array([rig.camera.cx_px, rig.camera.cy_px])
    line = np.rint(np.arctan2(off[:, 0], -off[:, 1]) / (2 * np.pi) * lines).astype(np.int64) % lines
    out = np.full((len(rig.projector.slits), lines), np.nan)
    out[view.points.ring[view.right], line[view.right]] = np.hypot(off[:, 0], off[:, 1])[view.right]
    return out


def _running_median(row: Float[np.ndarray, "lines"]) -> Float[np.ndarray, "lines"]:
    half = SMOOTH_LINES // 2
    wrapped = np.concatenate([row[-half:], row, row[:half]])
    windows = np.lib.stride_tricks.sliding_window_view(wrapped, SMOOTH_LINES)
    known = np.isfinite(windows).sum(axis=1) > half
    out = np.full(row.size, np.nan)
    out[known] = np.nanmedian(windows[known], axis=1)
    return out


def _sampled(lines: Float[np.ndarray, "azimuths radii 3"], place: Float[np.ndarray, "azimuths"]) -> np.ndarray:
    """Mean colour about a place on each line; NaN where there is none."""
    out = np.full((place.size, 3), np.nan)
    for k in np.flatnonzero(np.isfinite(place)):
        low = round(float(place[k])) - BAND_PX
        piece = lines[k, max(low, 0) : low + 2 * BAND_PX + 1]
        if low >= 0 and len(piece) and np.isfinite(piece).all():
            out[k] = piece.mean(axis=0)
    return out


def _widths(dip_px: np.ndarray, width_px: np.ndarray, radius: np.ndarray) -> Float[np.ndarray, "slits"]:
    out = []
    for row in radius:
        same = np.abs(dip_px - row[:, None]) < 0.5
        out.append(float(np.median(width_px[same])) if same.any() else float("nan"))
    return np.array(out)


def _rms(row: np.ndarray) -> float:
    known = row[np.isfinite(row)]
    return float(MAD_TO_SIGMA * np.median(np.abs(known))) if known.size > LEAST_ROW else float("nan")


def _length_deg(rough: Float[np.ndarray, "slits lines"], step_deg: float) -> float:
    """Azimuth over which the jitter stays alike: where its mean autocorrelation falls to 1/e."""
    sound = np.where(np.isfinite(rough), rough, 0.0)
    power = np.mean(sound * sound)
    for lag in range(1, 40):
        alike = np.mean(sound * np.roll(sound, lag, axis=1)) / power if power > 0 else 0.0
        if alike < np.exp(-1):
            return lag * step_deg
    return 40 * step_deg
