"""The page of a comparison of fidelities."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenarios.fidelity.agreed import SPREADS, Compared, Comparison, looks, trusted
from scenarios.report.canvas import BLUE, ORANGE, VERMILION, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from scenarios.study.page import cells, figure_html, html_page, table

ROW_IN = 0.26
SHOWN_SPREADS = 6.0
COLORS = {"agrees": BLUE, "open": ORANGE, "differs": VERMILION}
MARKERS = {"agrees": "o", "open": "s", "differs": "D"}


def write_page(file: Path, found: list[Comparison], noise: str) -> None:
    """Write it."""
    sections, lines = {}, []
    fidelities = list(dict.fromkeys(cost.fidelity for one in found for cost in one.costs))
    for name in fidelities:
        for group in looks(found):
            scenarios, agreed = ", ".join(one.scenario for one in group), trusted(group, name)
            lines.append(f"{name} over {scenarios}: {len(agreed)} scores agree")
            sections[f"{name} over {scenarios}: what it may be used for"] = f"<p>{', '.join(agreed) or 'nothing'}.</p>"
        sections[f"{name}, scenario by scenario"] = figure_html(all_verdicts(found, name))
    sections["What was compared"] = what_was_compared(found)
    for one in found:
        for cost in one.costs:
            own = [row for row in one.scores if row.fidelity == cost.fidelity]
            title = f"{one.scenario}: {cost.fidelity} against pictures, {cost.cheaper:.0f} times cheaper"
            sections[title] = figure_html(in_spreads(own)) + numbers(own)
    lead = (
        f"The same seeds in each; `points` with the noise called {noise}. A score agrees when the 95 % interval of the "
        f"mean difference lies within {SPREADS:g} standard deviations of the pictures' own spread from seed to seed. "
        "Scenarios of the same optics and bore are trusted together, in what agrees over them all and differs in none."
    )
    with whole_file(file) as work:
        work.write_text(html_page("Fidelities", lead, "; ".join(lines) + ".", True, sections), encoding="utf-8")


def what_was_compared(found: list[Comparison]) -> str:
    """How many seeds of every scenario, by which version, how shortened, and what a run costs."""
    head = cells("th", ["scenario", "seeds", "version, code", "shortened by", "times cheaper"])
    rows = "".join(
        cells(
            "td",
            [
                one.scenario,
                str(one.seeds),
                f"{one.version}, {one.code}",
                ", ".join(f"{path} {value}" for path, value in one.changes.items()) or "whole",
                ", ".join(f"{cost.fidelity} {cost.cheaper:.0f}" for cost in one.costs),
            ],
        )
        for one in found
    )
    return table(head, rows, "What shortens a scenario shortens it in every fidelity.")


def all_verdicts(found: list[Comparison], fidelity: str) -> Picture:
    """Every score's verdict in every scenario."""
    scores = list(dict.fromkeys(row.score for one in found for row in one.scores if row.n))[::-1]
    with drawing(2.4 + ROW_IN * len(scores)) as figure:
        axes = figure.add_subplot()
        for verdict, color in COLORS.items():
            places = [
                (column, scores.index(row.score))
                for column, one in enumerate(found)
                for row in one.scores
                if row.n and (row.fidelity, row.verdict) == (fidelity, verdict)
            ]
            x, y = zip(*places, strict=True) if places else ((), ())
            axes.plot(x, y, MARKERS[verdict], color=color, markersize=6, label=verdict)
        axes.set_xticks(np.arange(len(found)), [one.scenario for one in found], rotation=60, ha="right", fontsize=8)
        axes.set_yticks(np.arange(len(scores)), scores, fontsize=8)
        axes.set_xlim(-0.5, max(len(found), 6) - 0.5)
        axes.set_xlabel("scenario")
        axes.set_ylabel("score")
        axes.set_title(f"Where {fidelity} stands for pictures")
        figure.legend(loc="outside upper right", ncols=len(COLORS))
        return to_picture(
            figure,
            f"Verdict of every score of {fidelity} in every scenario",
            "Open: too few seeds to tell. A score without a mark is none of that scenario.",
        )


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
