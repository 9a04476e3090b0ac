"""How the robot shakes, from the IMU's log: power in octaves, free of what the IMU itself makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from algorithms.identification.estimate import LEAST_BLOCKS, NORMAL_95, Estimate
from algorithms.identification.inertial import WINDOW_S, Imu
from sensor_model.rig import ImuMount

BAND_EDGES_HZ = (2.5, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0)
FINE_BINS = 16  # to a bin, in which the taper's leakage is taken
HANN_BINS = 1.5  # neighbouring bins of a tapered window that tell as much as one
SWING_STD = 0.15  # of what turning is taken to do to the forces: the band is taken for evenly filled


@dataclass(frozen=True)
class Band:
    """Shaking between two frequencies: RMS by axis in the camera's frame."""

    from_hz: float
    to_hz: float
    force_m_s2: tuple[Estimate, ...]
    rate_rad_s: tuple[Estimate, ...]


def vibration(imu: Imu, mount: ImuMount, gyro_noise: Estimate, force_noise: Estimate) -> list[Band]:
    """Shaking of the camera in motion by octaves; nothing for a log that is too short.

    What the white noise gives is taken off, what a window's taper carries over from the neighbouring bands, and from
    the forces what turning the IMU about the camera does to them.
    """
    nyquist = 0.5 / imu.step_s
    edges = [edge for edge in BAND_EDGES_HZ if edge < 0.95 * nyquist]
    windows = _windows(imu)
    if len(windows) < LEAST_BLOCKS or not edges:
        return []
    edges.append(nyquist)
    gyro, force = (values @ mount.R_camera_imu.T for values in (imu.gyro_rad_s, imu.force_m_s2))
    lever_m = np.array(mount.position_camera_mm) / 1e3
    mixing = _mixing(windows[0].stop - windows[0].start, imu.step_s, edges)
    powers = [_powers(values, windows, imu.step_s, edges) for values in (force, gyro)]
    shown = [np.mean(power, axis=0) for power in powers]
    own = [np.linalg.solve(mixing, power) for power in shown]
    bands = []
    for k, (low, high) in enumerate(pairwise(edges)):
        swing = _swing(low, high, lever_m, force[imu.moving].mean(axis=0))
        words = f"{low:g} to {high:.3g} Hz in motion, white noise taken off"
        bins = (high - low) * WINDOW_S / HANN_BINS
        white = [_white(noise, high - low) for noise in (force_noise, gyro_noise)]
        swung = swing @ np.maximum(own[1][k] - white[1][0], 0)
        mixed = [all_shown[k] - power[k] for all_shown, power in zip(shown, own, strict=True)]
        leaks = [_leaked(power, k, mixing) / np.sqrt(len(windows)) for power in own]
        taken = [
            (white[0][0] + mix + one, float(np.linalg.norm([white[0][1], SWING_STD * one, leak])))
            for one, mix, leak in zip(swung, mixed[0], leaks[0], strict=True)
        ]
        forces = tuple(_rms(powers[0][:, k, axis], bins, *taken[axis], words) for axis in range(3))
        about_axes = [
            (white[1][0] + mix, float(np.hypot(white[1][1], leak)))
            for mix, leak in zip(mixed[1], leaks[1], strict=True)
        ]
        rates = tuple(_rms(powers[1][:, k, axis], bins, *about_axes[axis], words) for axis in range(3))
        bands.append(Band(low, high, forces, rates))
    return bands


def _windows(imu: Imu) -> list[slice]:
    """Stretches of a second, wholly in motion."""
    length, out, begin = round(WINDOW_S / imu.step_s), [], 0
    while begin + length <= imu.time_s.size:
        if imu.moving[begin : begin + length].all():
            out.append(slice(begin, begin + length))
            begin += length
        else:
            begin += 1
    return out


def _mixing(samples: int, step_s: float, edges: list[float]) -> Float[np.ndarray, "bands bands"]:
    """Which share of the power of each band (columns), evenly filled, a tapered window shows in each (rows)."""
    fine = 2 * FINE_BINS * samples
    spread = np.abs(np.fft.fft(np.hanning(samples), fine)) ** 2
    hz = np.fft.rfftfreq(samples, step_s)
    # every other fine frequency, so that none lies on an edge
    fine_hz = np.arange(1, fine // 2, 2) / (fine * step_s)
    offset = np.round((hz[:, None] - fine_hz) * fine * step_s).astype(np.int64)
    shown = spread[offset % fine]
    shown /= shown.sum(axis=0)
    inside = [(hz >= a) & (hz < b) for a, b in pairwise(edges)]
    filled = [(fine_hz >= a) & (fine_hz < b) for a, b in pairwise(edges)]
    return np.array([[shown[np.ix_(rows, columns)].sum(axis=0).mean() for columns in filled] for rows in inside])


def _leaked(power: Float[np.ndarray, "bands 3"], k: int, mixing: np.ndarray) -> Float[np.ndarray, "3"]:
    """Power that a window's own share of the neighbours' bins nearest to a band differs by from what is taken off."""
    others = np.arange(len(power)) != k
    return np.sqrt(np.sum((mixing[k, others, None] * power[others]) ** 2, axis=0))


def _white(noise: Estimate, width_hz: float) -> tuple[float, float]:
    """Power that white noise has in a band, and its standard deviation."""
    # a density of n per root hertz is n^2 on both sides of the spectrum, 2 n^2 on one
    power = 2 * noise.value**2 * width_hz
    return power, 4 * noise.value * width_hz * (noise.high - noise.low) / (2 * NORMAL_95)


def _swing(low_hz: float, high_hz: float, lever_m: np.ndarray, force_m_s2: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """Power that a rate's power about each axis (columns) makes of force along each (rows), by lever and by gravity."""
    omega = 2 * np.pi * np.linspace(low_hz, high_hz, 21)
    out = np.zeros((3, 3))
    for j, axis in enumerate(np.eye(3)):
        # a turn by a accelerates the IMU by -w^2 a (axis x lever), and turns the force the other way
        gain = -np.outer(omega, np.cross(axis, lever_m)) - np.outer(1 / omega, np.cross(axis, force_m_s2))
        out[:, j] = np.mean(gain**2, axis=0)
    return out


def _powers(
    values: Float[np.ndarray, "n 3"], windows: list[slice], step_s: float, edges: list[float]
) -> Float[np.ndarray, "windows bands 3"]:
    """Mean square of each band in each window."""
    out = []
    for window in windows:
        part = values[window]
        line, taper = np.linspace(-1, 1, len(part)), np.hanning(len(part))
        part = part - part.mean(axis=0) - np.outer(line, line @ part / (line @ line))
        power = np.abs(np.fft.rfft(part * taper[:, None], axis=0)) ** 2 * 2 / (len(part) * np.sum(taper**2))
        hz = np.fft.rfftfreq(len(part), step_s)
        out.append([power[(hz >= a) & (hz < b)].sum(axis=0) for a, b in pairwise(edges)])
    return np.array(out)


def _rms(power: Float[np.ndarray, "windows"], bins: float, taken: float, taken_std: float, source: str) -> Estimate:
    """RMS from powers of windows of so many independent bins each, less what is known to be none of it.

    Noise has two degrees of freedom a bin; where the windows differ by more than that, as many as their scatter has.
    """
    mean, n = float(power.mean()), power.size
    freedom = 2 * bins * n
    scatter = float(power.var(ddof=1)) / mean**2 if mean > 0 else 0.0
    freedom = min(freedom, 2 * n / scatter) if scatter > 0 else freedom
    low, high = (freedom * mean / float(chi2.ppf(q, freedom)) for q in (0.975, 0.025))
    more, value = NORMAL_95 * taken_std, mean - taken
    bounds = value, value - float(np.hypot(mean - low, more)), value + float(np.hypot(high - mean, more))
    at, least, most = (float(np.sqrt(max(bound, 0.0))) for bound in bounds)
    return Estimate(at, least, most, n, source)
