"""The tuning's page: the verdict first, then winner and default side by side, the Pareto front, and what mattered."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from scenarios.document import shown
from scenarios.report.page import figure_html
from scenarios.study.page import cells, html_page, mean_text, table
from scenarios.study.tune_figures import objectives_picture, settings_picture
from scenarios.study.tune_file import OBJECTIVES, Tuning

if TYPE_CHECKING:
    from scenarios.study.tune import Tuned, Verdict


def tuning_page(tuning: Tuning, tuned: Tuned) -> str:
    """The page as HTML."""
    first = tuned.verdicts[0]
    sections = {f"Hold-out, {verdict.fidelity}": _verdict(verdict) for verdict in tuned.verdicts}
    sections["The winner's settings"] = _settings(tuned)
    sections["Pareto front"] = _pictured(tuning, tuned) + _front(tuning, tuned)
    sections["What mattered"] = _importance(tuned)
    clean = "better" in first.words and "WORSE" not in first.words
    return html_page(f"Tuning: {tuning.file.name}", tuning.file.why, f"Hold-out: {first.words}", clean, sections)


def _verdict(verdict: Verdict) -> str:
    head = cells("th", ["objective", "default", "winner", "winner − default, paired"])
    rows = "".join(
        cells("td", [f"{name}: {OBJECTIVES[name]}", *(mean_text(part[name]) for part in _parts(verdict))])
        for name in verdict.default
    )
    return f"<p>{escape(verdict.words)}</p>" + table(head, rows, "On scans that the search never saw; less is better.")


def _parts(verdict: Verdict) -> tuple:
    return verdict.default, verdict.winner, verdict.difference


def _settings(tuned: Tuned) -> str:
    rows = "".join(cells("td", [path, shown(value)]) for path, value in tuned.settings.items())
    return table(cells("th", ["setting", "value"]), rows, "Those below `method` are in method.yaml.")


def _pictured(tuning: Tuning, tuned: Tuned) -> str:
    pictures = [settings_picture(tuning, tuned)]
    if len(tuning.file.objectives) > 1:
        pictures.insert(0, objectives_picture(tuned, tuning.file.objectives))
    return "".join(figure_html(picture) for picture in pictures)


def _front(tuning: Tuning, tuned: Tuned) -> str:
    head = cells("th", ["trial", *tuning.file.objectives, *tuning.search])
    rows = "".join(
        cells(
            "td",
            [
                str(one["trial"]),
                *(f"{value:.4g}" for value in one["objectives"].values()),
                *(shown(one["settings"][path]) for path in tuning.search),
            ],
        )
        for one in tuned.front
    )
    n = tuning.tuning.planned
    return table(head, rows, f"On the scans tuned on, means of n = {n}: what no other trial beats in everything.")


def _importance(tuned: Tuned) -> str:
    head = cells("th", ["setting", *tuned.importance])
    paths = {path for shares in tuned.importance.values() for path in shares}
    rows = "".join(
        cells("td", [path, *(_percent(shares.get(path)) for shares in tuned.importance.values())])
        for path in sorted(paths)
    )
    if not rows:
        return "<p>Too few trials to tell.</p>"
    return table(head, rows, "Share of what sets the best tenth of the trials apart (PED-ANOVA), by objective.")


def _percent(share: float | None) -> str:
    return "n/a" if share is None else f"{100 * share:.0f} %"
