"""Pictures over distance: how the sensor truly moved, how well that was measured, and what each frame gave."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from scenarios.report.canvas import BLACK, BLUE, SERIES, VERMILION, Picture, drawing, to_picture
from scenarios.run import Run, Scan
from scenarios.score import pose_errors
from sensor_model.geometry import rotation_from_wxyz, twist_about_z_rad

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_SAMPLES = 900
DISTANCE = "true distance of the camera (mm)"


def errors_over_distance(run: Run) -> Picture:
    """Errors of the registered poses, each within twice its stated standard deviation or not."""
    errors, path = pose_errors(run.found, run.truth), run.found.trajectory
    std = np.sqrt(np.diagonal(path.covariance[path.registered], axis1=1, axis2=2))
    z, score = errors.z_true_mm, run.score
    with drawing(8.2) as figure:
        center, tilt, roll, distance = figure.subplots(4, 1, sharex=True)
        center.set_title(f"Camera centre across the pipe: {score.center_rms_mm:.3g} mm RMS")
        _series(center, z, errors.center_mm[:, 0], BLUE, "to the right", std[:, 0])
        _series(center, z, errors.center_mm[:, 1], VERMILION, "downward", std[:, 1])
        tilt.set_title(f"Pipe axis: {score.tilt_rms_deg:.3g} degrees RMS")
        _series(tilt, z, errors.tilt_deg, BLUE, "angle between true and measured axis")
        roll.set_title(f"Roll: {score.roll_rms_deg:.3g} degrees RMS, largest {score.roll_max_deg:.3g}")
        _series(roll, z, errors.roll_deg, BLUE, "clockwise", np.degrees(std[:, 5]))
        distance.set_title(f"Distance: {score.distance_error_pct:.3g} % of travel at the end")
        _series(distance, z, errors.distance_mm, BLUE, "downstream", std[:, 2])
        for axes, unit in ((center, "mm"), (tilt, "degrees"), (roll, "degrees"), (distance, "mm")):
            axes.set_ylabel(f"error ({unit})")
            axes.axhline(0, color=BLACK, linewidth=0.7)
            _at_least(axes, 0.04)
            _key(axes)
        distance.set_xlabel(DISTANCE)
        return to_picture(
            figure,
            f"Four plots of pose error over distance: centre {score.center_rms_mm:.3g} mm RMS, tilt "
            f"{score.tilt_rms_deg:.3g} degrees RMS, roll {score.roll_rms_deg:.3g} degrees RMS, distance "
            f"{score.distance_error_pct:.3g} % of travel.",
            "Measured less true pose of every registered frame. Bands: twice the standard deviation that the "
            "measurement states of itself, about zero.",
        )


def _series(axes: Axes, x: np.ndarray, y: np.ndarray, color: str, words: str, std: np.ndarray | None = None) -> None:
    axes.plot(x, y, color=color, label=words)
    if std is not None and np.isfinite(std).all():
        axes.fill_between(x, -2 * std, 2 * std, color=color, alpha=0.13, linewidth=0)


def _key(axes: Axes) -> None:
    """Legend beside the title, clear of the curves."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4, borderaxespad=0.1)


def _at_least(axes: Axes, span: float) -> None:
    """Widen the vertical axis to a span that matters, so that nothing looks large for being magnified."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = (low + high) / 2
        axes.set_ylim(middle - span / 2, middle + span / 2)


def true_path(run: Run) -> Picture:
    """What the sensor truly did: offset, tilt, roll, and how far the wheels slipped."""
    truth = run.truth
    every = slice(None, None, max(truth.time_s.size // MOST_SAMPLES, 1))
    z, rotation = truth.position_mm[every, 2], rotation_from_wxyz(truth.q_pipe_camera_wxyz[every])
    nose = np.degrees(np.arctan2(rotation[:, :2, 2], rotation[:, 2:, 2]))
    turn = np.degrees(np.unwrap(twist_about_z_rad(rotation)))
    with drawing(8.2) as figure:
        offset, tilt, roll, slip = figure.subplots(4, 1, sharex=True)
        panels = (
            (offset, "Offset from the pipe's axis", "offset (mm)", truth.position_mm[every, :2], ("right", "down")),
            (tilt, "Tilt against the pipe's axis", "tilt (degrees)", nose, ("nose right", "nose down")),
            (roll, "Roll, clockwise looking downstream", "roll (degrees)", turn[:, None], ("roll",)),
        )
        for axes, title, label, values, words in panels:
            axes.set_title(title)
            axes.set_ylabel(label)
            for k, word in enumerate(words):
                axes.plot(z, values[:, k], color=SERIES[k], label=word)
        _key(offset)
        _key(tilt)
        slipped = slipped_mm(run)
        slip.set_title("Wheel slip: rolled less travelled distance")
        slip.set_ylabel("slip so far (mm)")
        for k, wheel in enumerate(slipped.T):
            slip.plot(z, wheel[every], color=SERIES[k % len(SERIES)], label=f"encoder wheel {k + 1}")
        _key(slip)
        for axes, span in ((offset, 1.0), (tilt, 0.5), (roll, 1.0), (slip, 0.5)):
            _at_least(axes, span)
        slip.set_xlabel(DISTANCE)
        return to_picture(
            figure,
            f"Four plots of the true path over distance from {z.min():.0f} to {z.max():.0f} mm: offset, tilt, roll and "
            "the slip of each encoder wheel.",
            "The true path of the camera, which the measurement never sees."
            + (" A prescribed path has no wheel slip." if not np.any(truth.slip_mm_s) else ""),
        )


def slipped_mm(run: Run) -> Float[np.ndarray, "n wheels"]:
    """How much further each encoder's wheel has rolled than the robot travelled."""
    step = np.diff(run.truth.time_s, prepend=run.truth.time_s[0])
    return np.cumsum(run.truth.slip_mm_s * step[:, None], axis=0)


def yield_over_distance(run: Scan) -> Picture:
    """Share of the slits' azimuths decoded in each frame, and the frames that could not be registered."""
    path = run.found.trajectory
    z, share, lost = path.T_pipe_camera[:, 2, 3], 100 * path.decode_yield, ~path.registered
    with drawing(2.9) as figure:
        axes = figure.subplots()
        axes.plot(z, share, color=BLUE, label="frame")
        if lost.any():
            axes.plot(z[lost], share[lost], "x", color=VERMILION, label=f"not registered ({int(lost.sum())})")
            _key(axes)
        axes.set_ylim(0, 105)
        axes.set_title("Slit pixels found in each frame")
        axes.set_ylabel("of all slits and azimuths (%)")
        axes.set_xlabel("measured distance of the camera (mm)")
        return to_picture(
            figure,
            f"Decode yield of each frame over distance, {share.mean():.0f} % on average; {int(lost.sum())} of "
            f"{lost.size} frames not registered.",
            f"Decode yield, {share.mean():.1f} % on average. The strut's sector and slits beyond the picture's edge "
            "count as not found.",
        )
