"""The page's curve over the number of board poses, and what `--json` says of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from algorithms.calibration.poses_needed import LIMITS, Off, PoseCurve
from scenarios.report.calibration_page import Section
from scenarios.report.canvas import BLACK, BLUE, VERMILION, Picture, drawing, to_picture

TITLES = {
    "half_angle_deg": "half angle, worst slit (degrees)",
    "axis_deg": "axis (degrees)",
    "baseline_mm": "baseline (mm)",
    "radius_mm": "radius of a 6 inch pipe (mm)",
}
ERROR, SPREAD = "error against the true rig", "spread between subsets"


def curve_figures(curve: PoseCurve, closed_loop: bool) -> dict[str, Any]:
    """What nine of ten subsets stay below, by number of poses, and how many poses meet each limit."""
    return {
        "is": ERROR if closed_loop else SPREAD,
        "limit": LIMITS._asdict(),
        "poses_needed": curve.needed,
        "nine_of_ten_below": [
            {"poses": poses, **{name: _or_none(value) for name, value in row._asdict().items()}, "refused": refused}
            for poses, row, refused in zip(curve.poses, curve.nine_of_ten, curve.refused, strict=True)
        ],
    }


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None


def curve_section(curve: PoseCurve, closed_loop: bool) -> Section:
    """The part of the page."""
    words = [
        "Random subsets of the session's boards, each calibrated by itself. "
        + (
            "The pictures are a twin's, so that the error itself is known."
            if closed_loop
            else "The truth is not known here: the spread says how well such a session repeats, not what all its "
            "pictures have wrong alike. It allows for the boards that subsets share."
        )
    ]
    if not curve.poses:
        return Section("How many poses?", ["More than three boards are needed to say."])
    needed = [("figure", "limit", "poses from which nine of ten subsets stay below")]
    for name, limit in LIMITS._asdict().items():
        poses = curve.needed[name]
        needed.append((TITLES[name], f"{limit:g}", str(poses) if poses else f"more than {curve.poses[-1]}"))
    return Section("How many poses?", words, needed, [_figure(curve, closed_loop)])


def _figure(curve: PoseCurve, closed_loop: bool) -> Picture:
    from matplotlib.ticker import NullLocator

    what = ERROR if closed_loop else SPREAD
    with drawing(5.6) as figure:
        for axes, name in zip(figure.subplots(2, 2, sharex=True).ravel(), Off._fields, strict=True):
            for rows, color, label in ((curve.nine_of_ten, VERMILION, "nine of ten below"),
                                       (curve.middle, BLUE, "middle")):  # fmt: skip
                axes.plot(curve.poses, [getattr(row, name) for row in rows], "o-", ms=4, color=color, label=label)
            axes.axhline(getattr(LIMITS, name), color=BLACK, linestyle="--", linewidth=1.0, label="limit")
            axes.set(xscale="log", yscale="log", title=TITLES[name])
            axes.set_xticks(curve.poses, [str(poses) for poses in curve.poses])
            axes.xaxis.set_minor_locator(NullLocator())
        for axes in figure.axes[2:]:
            axes.set_xlabel("poses of the board")
        figure.axes[0].legend()
        figure.suptitle(f"More poses: {what}", x=0.01, ha="left", fontweight="bold")
        return to_picture(figure, f"Four curves over the number of poses: {what}.", f"{what.capitalize()}.")
