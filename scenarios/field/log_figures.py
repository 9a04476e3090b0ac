"""The figures of a log by which it is compared with another: each as a row of values, one a stretch of time."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from algorithms.calibration.pipe_view import view_pipe
from algorithms.decode import DecodeSettings
from algorithms.identification.estimate import BLOCKS, blocks_of
from algorithms.identification.identify import imu_of
from algorithms.identification.inertial import Imu
from algorithms.identification.scan import Walk
from algorithms.identification.shaking import BAND_EDGES_HZ
from algorithms.identification.way import angles_rad
from algorithms.identification.wheels import rolled_mm, wheel_figures
from algorithms.localisation.wheels import count_mm
from scenarios.calibration.look import look_of
from sensor_model.recording import Recording

LOOKS = 4  # pictures whose look is measured
LOOK_FIGURES = ("contrast_pct", "width_px", "jitter_px", "noise_levels", "haze_red", "haze_green", "haze_blue")
DEG = float(np.degrees(1.0))
Blocks = dict[str, np.ndarray]


def log_figures(recording: Recording, walked: Walk) -> Blocks:
    """Every figure by stretches of time; not a number in a stretch that does not show it."""
    out: Blocks = {"frames_per_s": _block_rate(recording.frame_stamps_ns)}
    pictures = recording.frame_files[0].endswith(".png")
    out |= _of_frames(walked)
    if pictures:
        del out["pixel_noise_px"]  # there it is the slide's print, whose roughness stands below
    out |= _of_wheels(recording)
    out |= _of_imu(recording)
    if walked.found is not None:
        way = walked.found.trajectory
        out["diameter_mm"] = _means(2 * way.radius_mm[way.registered])
    return out | (_looks(recording) if pictures else {})


class WayFigure(NamedTuple):
    """One figure of the way: its mean in each stretch of time, and how far single values lie off by themselves."""

    blocks: Float[np.ndarray, "blocks"]
    std: float


def way_figures(recording: Recording, walked: Walk) -> dict[str, WayFigure]:
    """What changes along the drive, and is compared stretch by stretch: speed by the wheels, offset, roll and tilt."""
    rolled, time_s = _middle_wheel(recording)
    stride = max(round(0.1 / float(np.median(np.diff(time_s)))), 1)
    speed = np.diff(rolled[::stride]) / np.diff(time_s[::stride])
    out = {"speed_mm_s": _way_figure(speed, 0.0)}
    if walked.found is None:
        return out
    way = walked.found.trajectory
    seen, angles = way.registered, np.degrees(angles_rad(way))
    stds = np.sqrt(np.maximum(np.diagonal(way.covariance, axis1=1, axis2=2), 0)) * [1, 1, 1, DEG, DEG, DEG]
    columns = {
        "offset_x_mm": (way.T_pipe_camera[:, 0, 3], 0),
        "offset_y_mm": (way.T_pipe_camera[:, 1, 3], 1),
        "roll_deg": (angles[:, 0], 5),
        "tilt_x_deg": (angles[:, 1], 3),
        "tilt_y_deg": (angles[:, 2], 4),
    }
    return out | {
        name: _way_figure(values[seen], float(np.median(stds[seen, axis]))) for name, (values, axis) in columns.items()
    }


def _way_figure(values: Float[np.ndarray, "n"], stated_std: float) -> WayFigure:
    """The scatter about a straight line in each stretch, or what the measurement states if that is more."""
    scatter = []
    for part in blocks_of(values.size):
        piece = values[part]
        if piece.size > 4:
            line = np.linspace(-1, 1, piece.size)
            off = piece - piece.mean() - line * (line @ piece) / (line @ line)
            scatter.append(off.std())
    own = float(np.median(scatter)) if scatter else float("nan")
    return WayFigure(_means(values), max(own, stated_std))


def _middle_wheel(recording: Recording) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Way of the live wheels on average, and the times of it."""
    rolled = rolled_mm(recording)
    time_s = (recording.encoder_stamps_ns - recording.encoder_stamps_ns[0]) / 1e9
    live = ~wheel_figures(rolled, float(np.median(np.diff(time_s))), count_mm(recording.rig)).dead
    return rolled[:, live].mean(axis=1), time_s


def _means(values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "blocks"]:
    return np.array([values[part].mean() if values[part].size else np.nan for part in blocks_of(values.size)])


def _block_rate(stamps_ns: np.ndarray) -> Float[np.ndarray, "blocks"]:
    edges = np.linspace(stamps_ns[0], stamps_ns[-1], BLOCKS + 1)
    count = np.diff(np.searchsorted(stamps_ns, edges))
    return count / np.diff(edges) * 1e9


def _of_frames(walked: Walk) -> Blocks:
    figures = walked.slits
    missing, present = (np.array([getattr(one, name) for one in figures], float) for name in ("missing", "present"))
    powers = [one.jag_rad2[np.isfinite(one.jag_rad2[:, 0]), 0] for one in figures]
    jitter = np.array([np.sqrt(power.mean()) if power.size else np.nan for power in powers])
    return {
        "decode_yield": _means(walked.yields),
        "residual_mm": _means(walked.residual_mm),
        "pixel_noise_px": _means(np.array([one.noise_px for one in figures])),
        "drop_out_share": _means(missing / np.maximum(missing + present, 1)),
        "edge_jitter_deg": _means(np.degrees(jitter)),
    }


def _of_wheels(recording: Recording) -> Blocks:
    """How far each wheel rolls ahead of their mean, as the encoders say it."""
    rolled = rolled_mm(recording)
    middle, _ = _middle_wheel(recording)
    spans = [(part.start, part.stop) for part in blocks_of(middle.size - 1)]
    went = np.array([middle[b] - middle[a] for a, b in spans])
    out: Blocks = {}
    for k in range(rolled.shape[1]):
        own = np.array([rolled[b, k] - rolled[a, k] for a, b in spans])
        out[f"wheel{k}_ahead_of_mean_pct"] = np.where(
            np.abs(went) > 1, 100 * (own / np.where(went == 0, 1, went) - 1), np.nan
        )
    return out


def _of_imu(recording: Recording) -> Blocks:
    """RMS about the mean of each axis, noise from sample to sample, and bands of all axes together."""
    rolled = rolled_mm(recording)
    imu = imu_of(recording, rolled)
    out: Blocks = {}
    for name, values in (("gyro_deg_s", np.degrees(imu.gyro_rad_s)), ("force_m_s2", imu.force_m_s2)):
        parts = [values[part] for part in blocks_of(values.shape[0])]
        for axis, letter in enumerate("xyz"):
            out[f"{name.replace('_', '_rms_', 1)}_{letter}"] = np.array([part[:, axis].std() for part in parts])
        third = [np.sqrt(np.mean(np.diff(part, 3, axis=0) ** 2) / 20) for part in parts]
        out[name.replace("_", "_noise_", 1)] = np.array(third)
        for low, high, rms in _bands(imu, values):
            out[f"{name.replace('_', f'_{low:g}_to_{high:.3g}_hz_', 1)}"] = rms
    force = [np.linalg.norm(imu.force_m_s2[part], axis=1).mean() for part in blocks_of(imu.time_s.size)]
    out["force_mean_m_s2"] = np.array(force)
    if np.array_equal(recording.orientation_stamps_ns, recording.imu_stamps_ns):
        q = Rotation.from_quat(recording.q_world_imu_wxyz[:, [1, 2, 3, 0]])
        steps = np.degrees((q[:-1].inv() * q[1:]).as_rotvec())
        jumps = np.diff(steps, axis=0)
        out["attitude_noise_deg"] = np.array([np.sqrt(np.mean(jumps[part] ** 2) / 6) for part in blocks_of(len(jumps))])
    return out


def _bands(imu: Imu, values: Float[np.ndarray, "n 3"]) -> Iterator[tuple[float, float, Float[np.ndarray, "blocks"]]]:
    """RMS over octaves, all axes together, a value a stretch."""
    nyquist = 0.5 / imu.step_s
    edges = [edge for edge in BAND_EDGES_HZ if edge < 0.95 * nyquist] + [nyquist]
    rows = []
    for part in blocks_of(values.shape[0]):
        piece = values[part] - values[part].mean(axis=0)
        taper = np.hanning(len(piece))
        power = (
            (np.abs(np.fft.rfft(piece * taper[:, None], axis=0)) ** 2).sum(axis=1) * 2 / (len(piece) * np.sum(taper**2))
        )
        hz = np.fft.rfftfreq(len(piece), imu.step_s)
        rows.append([np.sqrt(power[(hz >= a) & (hz < b)].sum()) for a, b in pairwise(edges)])
    for k, (low, high) in enumerate(pairwise(edges)):
        yield low, high, np.array(rows)[:, k]


def _looks(recording: Recording) -> Blocks:
    """The look of some pictures along the drive."""
    chosen = np.unique(np.linspace(0, len(recording) - 1, LOOKS).round().astype(int)).tolist()
    rows = []
    for index in chosen:
        picture = recording[index].picture
        if picture is None:
            continue
        view = view_pipe(picture, recording.rig, DecodeSettings())
        if view.alignment.converged:
            rows.append(look_of(picture, view, recording.rig).figures())
    return {f"look_{name}": np.array([row[name] for row in rows]) for name in LOOK_FIGURES} if rows else {}
