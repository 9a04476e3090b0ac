"""A log over time: what each frame gave and how it was exposed, and what each wheel rolled."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from algorithms.localisation.wheels import wheel_distances_mm
from scenarios.field.replay import Replay
from scenarios.report.canvas import BLACK, BLUE, GREEN, SERIES, VERMILION, Picture, drawing, to_picture
from sensor_model.recording import Recording

MOST_SAMPLES = 2000


def light_over_time(replay: Replay) -> Picture:
    """Decode yield, level and glare of every frame; frames that gave nothing are marked."""
    recording, watched = replay.recording, replay.watched
    at_s = (recording.frame_stamps_ns - recording.frame_stamps_ns[0]) / 1e9
    share = 100 * np.array(watched.slits).mean(axis=1)
    level, full, _ = 100 * np.array(watched.exposure).T
    lost = np.array([bool(fault) for fault in watched.fault])
    with drawing(2.9) as figure:
        axes = figure.subplots()
        line_s = _broken(at_s)
        axes.plot(line_s, share, color=BLUE, label="slits found")
        if np.isfinite(level).any():
            axes.plot(line_s, level, color=GREEN, label="mean level of the picture")
            axes.plot(line_s, full, color=VERMILION, label="pixels that are full")
        if lost.any():
            axes.plot(at_s[lost], share[lost], "x", color=BLACK, label=f"not readable ({int(lost.sum())})")
        axes.set_ylim(0, 105)
        axes.set_title("What each frame gave")
        axes.set_ylabel("share (%)")
        axes.set_xlabel("time since the first frame (s)")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4, borderaxespad=0.1)
        return to_picture(
            figure,
            f"Decode yield over time, {float(np.median(share)):.0f} % in the middle frame, with the exposure of each.",
            "Share of all slits and azimuths found in each frame, and how the frame was exposed. Where frames "
            "are missing the lines are broken.",
        )


def _broken(at_s: Float[np.ndarray, "frames"]) -> Float[np.ndarray, "frames"]:
    """Times with a hole at the frame after a gap, so that no line is drawn across it."""
    steps = np.diff(at_s, prepend=at_s[0])
    usual = np.median(steps[1:]) if steps.size > 1 else np.inf
    return np.where(steps > 2.5 * usual, np.nan, at_s)


def wheels_over_time(recording: Recording) -> Picture:
    """How far each wheel rolled."""
    every = slice(None, None, max(recording.counts.shape[0] // MOST_SAMPLES, 1))
    at_s = (recording.encoder_stamps_ns - recording.frame_stamps_ns[0])[every] / 1e9
    rolled = wheel_distances_mm((recording.counts - recording.counts[0]).astype(float), recording.rig)[every]
    with drawing(2.9) as figure:
        axes = figure.subplots()
        for k, wheel in enumerate(rolled.T):
            # one over the other where they agree: each thinner than the last
            axes.plot(
                at_s, wheel, color=SERIES[k % len(SERIES)], linewidth=max(4.0 - 1.4 * k, 1.0), label=f"wheel {k + 1}"
            )
        axes.set_title("What the wheels rolled")
        axes.set_ylabel("distance (mm)")
        axes.set_xlabel("time since the first frame (s)")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=6, borderaxespad=0.1)
        ends = ", ".join(f"{way:.0f}" for way in rolled[-1])
        return to_picture(
            figure, f"Distance rolled by each wheel over time, at the end {ends} mm.", "By the encoders alone."
        )
