"""Gaps in a log and jumps of its clock: named, so that nobody takes what was made up across them for measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from algorithms.types import Episode
from sensor_model.recording import Recording

IMU_GAP_S, FRAME_GAP_S = 0.25, 0.5
ODD_TIMES = 4.0


def imu_gaps(begin_ns: int, end_ns: int, stamps_ns: Int[np.ndarray, "n"]) -> tuple[Episode, ...]:
    """Stretches between two times without a sample of the IMU."""
    return _silences("imu0", np.concatenate([[begin_ns], stamps_ns, [end_ns]]), IMU_GAP_S)


def log_gaps(recording: Recording) -> tuple[Episode, ...]:
    """Every silence in a log: of the camera, of the encoders and IMU, and of the clock where all fall silent at once.

    The reader fills such stretches by interpolation; a silence is one of several times the usual step.
    """
    logs = {
        "cam0": recording.frame_stamps_ns,
        "imu0": recording.imu_stamps_ns,
        "orientation0": recording.orientation_stamps_ns,
        "encoders0": recording.encoder_stamps_ns,
    }
    found: list[Episode] = []
    for who, stamps in logs.items():
        usual_s = float(np.median(np.diff(stamps))) / 1e9 if stamps.size > 2 else FRAME_GAP_S
        found += _silences(who, stamps, max(IMU_GAP_S, ODD_TIMES * usual_s))
    return _clock(found, len(logs))


def _silences(who: str, stamps_ns: Int[np.ndarray, "n"], least_s: float) -> tuple[Episode, ...]:
    steps = np.diff(stamps_ns) / 1e9
    return tuple(
        Episode("gap", who, int(stamps_ns[k]), int(stamps_ns[k + 1]), float(steps[k]))
        for k in np.flatnonzero(steps > least_s)
    )


def _clock(found: list[Episode], logs: int) -> tuple[Episode, ...]:
    """A silence that all logs share is the clock's, or the whole log's: it stands once, under that name."""
    kept: list[Episode] = []
    for one in sorted(found, key=lambda episode: episode.start_ns):
        same = {o.who for o in found if o.start_ns < one.end_ns and one.start_ns < o.end_ns}
        if len(same) < logs:
            kept.append(one)
        elif one.who == "encoders0":
            kept.append(replace(one, who="the clock, or all of the log"))
    return tuple(kept)
