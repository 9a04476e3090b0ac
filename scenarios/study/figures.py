"""The study page's pictures: figures over factors, and measured sizes over true ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.canvas import SERIES, Picture, drawing, to_picture
from scenarios.study.gather import Gathered, levels, mean_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL_IN = 3.0
MOST_DOTS = 5000
MARKERS = "osD^v<>P"
SIZES = ("length", "width", "depth")


def over_factor(found: Gathered, path: str) -> Picture:
    """Each leading figure over one factor, a line a method."""
    names = found.leading
    with drawing(PANEL_IN, max(PANEL_IN * len(names), 2 * PANEL_IN)) as figure:
        for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
            _panel(axes, found, path, name)
        if len(found.methods) > 1:
            figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
        return to_picture(
            figure,
            f"Means of {', '.join(names)} over {path}, a line a method",
            f"Means over {path} with their 95 % intervals; n = {len(found.method)} runs in all, n of each mean is in "
            "the table.",
        )


def _panel(axes: Axes, found: Gathered, path: str, name: str) -> None:
    every = levels(found, path)
    for k, method in enumerate(found.methods):
        means = [mean_of(found.column(name)[level.runs & (found.method == k)]) for level in every]
        place = np.array([level.place for level in every])
        bars = np.array([mean.half or 0.0 for mean in means])
        axes.errorbar(
            place,
            np.array([mean.mean for mean in means]),
            bars,
            color=SERIES[k % len(SERIES)],
            marker=MARKERS[k % len(MARKERS)],
            markersize=4,
            capsize=2,
            label=method,
        )
    if not all(isinstance(v, int | float) for v in found.values[path]):
        axes.set_xticks([level.place for level in every], [level.name for level in every])
    axes.set_title(name, fontsize=9)
    axes.set_xlabel(path if len(path) < 34 else "..." + path[-31:], fontsize=8)


def unity(found: Gathered) -> Picture:
    """Measured sizes of all matched defects over their true ones."""
    n = len(found.defects)
    shown = np.linspace(0, n - 1, min(n, MOST_DOTS)).astype(int)
    with drawing(PANEL_IN + 0.6, 3 * PANEL_IN) as figure:
        for k, axes in enumerate(figure.subplots(1, 3)):
            true, measured = found.defects[shown, k], found.defects[shown, 3 + k]
            ends = [min(true.min(), measured.min()), max(true.max(), measured.max())]
            axes.plot(ends, ends, color="#777777", linewidth=1)
            for m, method in enumerate(found.methods):
                own = found.defect_method[shown] == m
                color, marker = SERIES[m % len(SERIES)], MARKERS[m % len(MARKERS)]
                axes.plot(true[own], measured[own], marker, color=color, markersize=3, alpha=0.6, label=method)
            axes.set_title(f"{SIZES[k]} (mm)", fontsize=9)
            axes.set_xlabel("true")
            axes.set_ylabel("measured")
        if len(found.methods) > 1:
            figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
        part = f", {len(shown)} of them drawn" if len(shown) < n else ""
        return to_picture(
            figure,
            "Measured length, width and depth of the found defects over the true ones",
            f"Sizes of the found defects, measured over true; on the line they agree. n = {n} defects{part}; defects "
            "that were missed are not here.",
        )
