"""The pictures of a POD from signals: the line it is made of, and what each decision would cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from algorithms.trust.curve import to_x
from algorithms.trust.signal_response import SignalCurve
from scenarios.report.canvas import BLACK, BLUE, GREEN, ORANGE, VERMILION, Picture, drawing, to_picture
from scenarios.trust.pod import Pod

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 300


def signal_picture(curve: SignalCurve) -> Picture:
    """Signals over size with the line, its scatter and the decision."""
    data = curve.data
    x = axis_points(float(data.size.min()), float(data.size.max()), curve.scale)
    size = from_axis(x, curve.scale)
    line = curve.intercept + curve.slope * x
    with drawing(4.4) as figure:
        axes = figure.subplots()
        exact = ~(data.below | data.above)
        axes.plot(data.size[exact], data.signal[exact], "o", color=BLACK, markersize=3, label="signal")
        axes.plot(data.size[data.below], data.signal[data.below], "v", color=ORANGE, label="at most (under left limit)")
        axes.plot(data.size[data.above], data.signal[data.above], "^", color=GREEN, label="at least (over right limit)")
        axes.plot(size, from_axis(line, curve.signal_scale), color=BLUE, label="likeliest line")
        for sign in (-1, 1):
            edge = from_axis(line + sign * 1.96 * curve.tau, curve.signal_scale)
            axes.plot(size, edge, color=BLUE, linestyle=":", label="holds 95 % of signals" if sign > 0 else None)
        axes.axhline(curve.decision, color=VERMILION, linestyle="--", label=f"decision {curve.decision:g}")
        size_axis(axes, curve.scale)
        if curve.signal_scale == "log":
            axes.set_yscale("log")
        axes.set_ylabel("signal")
        axes.set_title("Signal over size")
        axes.legend(loc="upper left")
        return to_picture(figure, "Signals over size with the fitted line", "What the curve below is made of.")


def decision_picture(pod: Pod) -> Picture:
    """The size found with 90 % and how often noise is called, over the decision."""
    rows = pod.figures["decisions"]
    decision = [row["decision"] for row in rows]
    with drawing(5.2) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True)
        for key, style, label in (("a90", "-", "a90"), ("a90_95", "--", "a90/95 (likelihood ratio, one-sided 95 %)")):
            sizes = [np.nan if row[key] is None else row[key] for row in rows]
            upper.plot(decision, sizes, color=BLUE, linestyle=style, label=label)
        lower.plot(decision, [row["false_call_probability"] for row in rows], color=BLACK, label="noise called")
        lower.set_yscale("log")
        for axes in (upper, lower):
            axes.axvline(pod.figures["decision"], color=VERMILION, linestyle=":", label="the decision taken")
            axes.legend()
        upper.set_ylabel("size (the table's unit)")
        lower.set_ylabel("probability (log axis)")
        lower.set_xlabel("decision (signal)")
        upper.set_title("A higher decision finds only larger targets, and calls less noise")
        return to_picture(
            figure,
            "a90, a90/95 and false-call probability over the decision",
            "False calls by the law fitted to the noise: far out in its tail they are the law's word, not the data's.",
        )


def axis_points(first: float, last: float, scale: str) -> np.ndarray:
    """Evenly spaced places on a curve's axis, from one size to another."""
    return np.linspace(float(to_x(first, scale)), float(to_x(last, scale)), POINTS)


def from_axis(x: np.ndarray, scale: str) -> np.ndarray:
    """An axis' values as sizes or signals."""
    return np.exp(x) if scale == "log" else x


def size_axis(axes: Axes, scale: str) -> None:
    """The axis of sizes as the curve has it."""
    if scale == "log":
        from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(f"size ({scale} axis, the table's unit)")
