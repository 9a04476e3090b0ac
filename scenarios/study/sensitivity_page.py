"""The page of a sensitivity study: a bar chart a score, the budget of its variance by cause."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from scenarios.report.canvas import BLUE, SKY, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from scenarios.study.page import cells, figure_html, html_page, table
from scenarios.study.sensitivity import Indices, Sensitivity
from scenarios.study.study import Study

BAR_IN = 0.34


def write_page(file: Path, study: Study, found: Sensitivity) -> None:
    """Write it."""
    sections = {one.score: figure_html(budget(found.causes, one)) + numbers(found.causes, one) for one in found.scores}
    if found.left_out:
        lines = "".join(f"<dt>{escape(name)}</dt><dd>{escape(why)}</dd>" for name, why in found.left_out.items())
        sections["Scores without indices"] = f"<dl>{lines}</dl>"
    failed = found.counts["failed"]
    verdict = f"{len(found.scores)} scores over {len(found.causes)} causes; {found.counts['done']} runs done, "
    verdict += f"{failed} failed."
    lead = study.why or "Which cause makes a score vary, alone and together with the others, over the stated ranges."
    with whole_file(file) as work:
        page = html_page(f"Sensitivity: {study.name}", lead, verdict, not failed, sections)
        work.write_text(page, encoding="utf-8")


def budget(causes: tuple[str, ...], one: Indices) -> Picture:
    """Total and first index of every cause, the largest on top."""
    order = np.argsort(one.total[:, 0])
    place = np.arange(len(order))
    with drawing(1.3 + BAR_IN * len(order)) as figure:
        axes = figure.add_subplot()
        for values, color, height, label in (
            (one.total[order], SKY, 0.8, "total: with what it does together with others"),
            (one.first[order], BLUE, 0.4, "first: alone"),
        ):
            below, above = values[:, 0] - values[:, 1], values[:, 2] - values[:, 0]
            bars = np.maximum([below, above], 0.0)
            axes.barh(place, values[:, 0], height, xerr=bars, color=color, ecolor="#222222", capsize=2, label=label)
        axes.set_yticks(place, [causes[i] for i in order], fontsize=8)
        axes.set_xlabel("share of the score's variance")
        axes.set_title(one.score)
        axes.legend(loc="lower right")
        return to_picture(
            figure,
            f"First and total Sobol index of {one.score} by cause",
            f"{one.score}: mean {one.mean:.4g}, standard deviation {one.std:.3g}; bars with 95 % bootstrap intervals "
            f"over {one.pairs} pairs. First indices sum to {one.first[:, 0].sum():.2f}; what is missing to 1 is what "
            "causes do together.",
        )


def numbers(causes: tuple[str, ...], one: Indices) -> str:
    """The chart as a table, with each cause's own standard deviation."""
    head = cells("th", ["cause", "first", "95 %", "total", "95 %", "of the standard deviation"])
    rows = ""
    for i in np.argsort(-one.total[:, 0]):
        (first, *ends), (total, *total_ends) = one.first[i], one.total[i]
        alone = one.std * np.sqrt(max(first, 0.0))
        text = [f"{first:.3f}", _span(ends), f"{total:.3f}", _span(total_ends), f"{alone:.3g}"]
        rows += cells("td", [causes[i], *text])
    caption = (
        "Indices by cause; the last column is the standard deviation that the cause makes alone, in the score's unit."
    )
    return table(head, rows, caption)


def _span(ends: list[float]) -> str:
    return f"{ends[0]:.3f} to {ends[1]:.3f}".replace("-", "−")
