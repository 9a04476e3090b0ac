"""The page of a comparison of fidelities."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenarios.fidelity.compare import SPREADS, Compared, Cost, trusted
from scenarios.report.canvas import BLUE, ORANGE, VERMILION, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from scenarios.study.page import cells, figure_html, html_page, table

ROW_IN = 0.26
SHOWN_SPREADS = 6.0
COLORS = {"agrees": BLUE, "open": ORANGE, "differs": VERMILION}
MARKERS = {"agrees": "o", "open": "s", "differs": "D"}


def write_page(file: Path, found: list[Compared], costs: list[Cost], noise: str) -> None:
    """Write it."""
    sections = {}
    fidelities = list(dict.fromkeys(one.fidelity for one in found))
    lines = [f"{name}: {len(trusted(found, name))} scores agree in every scenario" for name in fidelities]
    for name in fidelities:
        agreed = trusted(found, name)
        sections[f"{name}: what it may be used for"] = f"<p>{', '.join(agreed) or 'nothing'}.</p>"
    for cost in costs:
        own = [one for one in found if (one.scenario, one.fidelity) == (cost.scenario, cost.fidelity)]
        title = f"{cost.scenario}: {cost.fidelity} against pictures, {cost.cheaper:.0f} times cheaper"
        sections[title] = figure_html(in_spreads(own)) + numbers(own)
    lead = (
        f"The same seeds in each; `points` with the noise called {noise}. A score agrees when the 95 % interval of the "
        f"mean difference lies within {SPREADS:g} standard deviations of the pictures' own spread from seed to seed."
    )
    with whole_file(file) as work:
        work.write_text(html_page("Fidelities", lead, "; ".join(lines) + ".", True, sections), encoding="utf-8")


def in_spreads(own: list[Compared]) -> Picture:
    """Difference of every score in units of the pictures' spread, with its interval."""
    shown = [one for one in own if np.isfinite([one.difference, one.half]).all() and one.spread > 0][::-1]
    with drawing(1.4 + ROW_IN * len(shown)) as figure:
        axes = figure.add_subplot()
        axes.axvspan(-SPREADS, SPREADS, color="#eeeeee")
        for row, one in enumerate(shown):
            at, half = one.difference / one.spread, one.half / one.spread
            axes.errorbar(
                np.clip(at, -SHOWN_SPREADS, SHOWN_SPREADS),
                row,
                xerr=half,
                color=COLORS[one.verdict],
                marker=MARKERS[one.verdict],
                markersize=5,
                capsize=2,
            )
        for verdict in COLORS:
            axes.plot([], [], MARKERS[verdict], color=COLORS[verdict], label=verdict)
        axes.set_yticks(np.arange(len(shown)), [one.score for one in shown], fontsize=8)
        axes.set_xlim(-SHOWN_SPREADS - 0.5, SHOWN_SPREADS + 0.5)
        axes.set_xlabel("difference to pictures, in their standard deviations from seed to seed")
        axes.set_title("Cheap minus picture, score by score")
        axes.legend(loc="lower right")
        return to_picture(
            figure,
            "Difference of every score between the cheap fidelity and pictures, with its interval",
            f"Within the grey band a seed does more than the fidelity; what lies beyond {SHOWN_SPREADS:g} is drawn "
            f"there. n = {max((one.n for one in own), default=0)} seeds. Scores that do not vary are in the table.",
        )


def numbers(own: list[Compared]) -> str:
    """The same as a table."""
    head = cells("th", ["score", "pictures, mean", "spread", "difference", "± 95 %", "n", "verdict"])
    rows = "".join(
        cells(
            "td",
            [
                one.score,
                *(f"{v:.4g}" for v in (one.mean, one.spread, one.difference, one.half)),
                str(one.n),
                one.verdict,
            ],
        )
        for one in own
    )
    return table(head, rows, "Mean over the seeds; the difference is cheap minus picture, paired by seed.")
