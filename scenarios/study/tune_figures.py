"""The tuning page's pictures: what one objective costs another, and how each searched setting bears on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.canvas import BLUE, ORANGE, UNSEEN, VERMILION, Picture, drawing, to_picture
from scenarios.study.tune_file import is_number_range

if TYPE_CHECKING:
    from scenarios.study.tune import Trial, Tuned
    from scenarios.study.tune_file import Tuning

PANEL_IN = 3.0
MOST_COLUMNS = 4


def objectives_picture(tuned: Tuned, objectives: tuple[str, ...]) -> Picture:
    """Every trial, one objective over another: the front, and the winner on it."""
    pairs = [(a, b) for a in range(len(objectives)) for b in range(a + 1, len(objectives))]
    values = _values(tuned.trials)
    front = {one["trial"] for one in tuned.front}
    on_front = np.array([trial.number in front for trial in tuned.trials])
    winner = np.array([trial.settings == tuned.settings for trial in tuned.trials]) & on_front
    with drawing(PANEL_IN + 0.4, max(PANEL_IN * len(pairs), 2 * PANEL_IN)) as figure:
        for axes, (a, b) in zip(figure.subplots(1, len(pairs), squeeze=False)[0], pairs, strict=True):
            axes.plot(values[~on_front, a], values[~on_front, b], "o", color=ORANGE, ms=4, label="not on it")
            axes.plot(values[on_front, a], values[on_front, b], "s", color=BLUE, ms=5, label="Pareto front")
            axes.plot(values[winner, a], values[winner, b], "*", color=VERMILION, ms=13, label="winner")
            axes.set_xlabel(objectives[a])
            axes.set_ylabel(objectives[b])
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return to_picture(
            figure,
            f"Trials over {', '.join(objectives)}, with the Pareto front and the winner",
            f"Means over the scans tuned on, less is better; n = {len(tuned.trials)} trials that ran to the end.",
        )


def settings_picture(tuning: Tuning, tuned: Tuned) -> Picture:
    """The first objective over each searched setting, a dot a trial, the winner's value marked."""
    paths = list(tuning.search)
    columns = min(len(paths), MOST_COLUMNS)
    lines = -(-len(paths) // columns)
    name = tuning.file.objectives[0]
    values = _values(tuned.trials)[:, 0]
    with drawing((PANEL_IN - 0.3) * lines, max(PANEL_IN * columns, 2 * PANEL_IN)) as figure:
        grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
        for axes, path in zip(grid.ravel(), paths, strict=False):
            _over_setting(axes, tuning, tuned, path, values)
        for axes in grid[:, 0]:
            axes.set_ylabel(name)
        for axes in grid.ravel()[len(paths) :]:
            axes.set_visible(False)
        return to_picture(
            figure,
            f"{name} of every trial over each searched setting",
            f"{name} over each searched setting, a dot a trial; the band is where the winner is. Trials crowd where "
            "the search expected more.",
        )


def _over_setting(axes: Any, tuning: Tuning, tuned: Tuned, path: str, values: np.ndarray) -> None:
    settings = [trial.settings[path] for trial in tuned.trials]
    if is_number_range(tuning.search[path]):
        places, at = np.array(settings, dtype=float), float(tuned.settings[path])
        if tuning.search[path].scale == "log":  # type: ignore[attr-defined]
            axes.set_xscale("log")
    else:
        words = sorted({str(value) for value in settings})
        places, at = (
            np.array([words.index(str(value)) for value in settings], dtype=float),
            float(words.index(str(tuned.settings[path]))),
        )
        axes.set_xticks(range(len(words)), words)
    axes.axvline(at, color=UNSEEN, linewidth=5, zorder=0)
    axes.plot(places, values, "o", color=BLUE, ms=4, alpha=0.6)
    axes.set_xlabel(path if len(path) < 34 else "..." + path[-31:], fontsize=8)


def _values(trials: list[Trial]) -> np.ndarray:
    return np.array([trial.values for trial in trials], dtype=float)
