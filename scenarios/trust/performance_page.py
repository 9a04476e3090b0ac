"""The page of a set of runs' performance: every number is a link to the rows behind it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from os.path import relpath
from pathlib import Path
from typing import Any

from algorithms.trust.coverage import statement
from algorithms.trust.feature_class import NOTE
from algorithms.trust.performance import unity_words
from scenarios.provenance import write_versions
from scenarios.report.calibration_page import table_html
from scenarios.report.page import figure_html
from scenarios.report.plain_rows import write_rows
from scenarios.report.shell import page_html
from scenarios.run_folder import run_folder
from scenarios.trust.looks import PodQuestion
from scenarios.trust.performance import (
    Performance,
    Row,
    Shuffled,
    depths_pct,
    intervals,
    performance_of,
    sized,
    target_rows,
)
from scenarios.trust.pod import Pod, pod_of
from scenarios.trust.pod_page import curve_picture, curve_rows, facts
from scenarios.trust.pod_page import verdict as pod_verdict
from scenarios.trust.trade import Trade, confusion_table, rate_words, share_words, unity_picture

FOOTER = "Depths in per cent of each pipe's own wall. Intervals are exact (Clopper-Pearson; Poisson for false calls)."
NUMBER = re.compile(r"(?<![\w./-])[+-]{0,2}\d+(?:\.\d+)?(?:e[+-]?\d+)?(?: %)?(?!\w)")
TARGETS, UNITY, LEAST, CALLS, INTERVALS, SCANS = "targets", "sized", "floors", "calls", "intervals", "scans"
QUESTION = PodQuestion(size="true_depth_mm", hit=("found",), target="target")


def run_report(folders: Sequence[Path], out: Path) -> tuple[Performance, Pod | None]:
    """Judge the runs, and write the page and its rows into a folder.

    Raises:
        BadInput: for folders that are no runs, or a folder that cannot be written.
    """
    found = performance_of(folders)
    with run_folder(out) as folder:
        rows = target_rows(found.targets)
        write_rows(rows, folder / "rows")
        pod = pod_of(folder / "rows.csv", QUESTION) if rows else None
        (folder / "performance.json").write_text(json.dumps(figures(found, pod), indent=1, allow_nan=False) + "\n")
        (folder / "report.html").write_text(page(found, pod, out), encoding="utf-8")
        write_versions(folder)
    return found, pod


def statements(found: Performance, pod: Pod | None) -> dict[str, list[tuple[str, str]]]:
    """Each part's sentences, each with the table that it rests on."""
    identified = found.identification.identified
    depth = [(line, UNITY) for line in unity_words(found.unity)] if found.unity else [("no depth to judge", TARGETS)]
    depth.append((share_words("Least depths of floors that no light reached, held", found.least), LEAST))
    detection = [
        (share_words("Detected, on all wall", found.identification.detected), TARGETS),
        (share_words("Detected, on seen wall", found.on_seen_wall), TARGETS),
        (share_words("Identified of those detected (POI)", identified), TARGETS),
        (rate_words(found.false_calls), CALLS),
    ]
    held = [(f"{name.removesuffix('_mm')}: {statement(one)}", INTERVALS) for name, one in found.coverage.items()]
    return {
        "Depth": depth,
        "Classes": [(share_words("Class right", found.confusion.right), TARGETS), (NOTE, TARGETS)],
        "Detection and identification": detection,
        "Probability of detection by depth": [(line, TARGETS) for line in _pod_words(pod)],
        "Do stated intervals hold?": held or [("no interval to judge", INTERVALS)],
        "Truth shuffled": [(line, SCANS) for line in _shuffled_words(found.shuffled)],
    }


def _pod_words(pod: Pod | None) -> list[str]:
    if pod is None:
        return ["no true feature lies in what was scanned"]
    return [pod_verdict(pod), *(f"{name}: {value}" for name, value in facts(pod) if name in ("looks", "a90/95"))]


def _shuffled_words(shuffled: Shuffled) -> list[str]:
    as_is = "no two runs have different features to exchange"
    if shuffled.exchanged.n:
        as_is = share_words("each scan by the next other pipe's truth, found", shuffled.exchanged)
    verdict = (
        "MORE THAN CHANCE: truth leaks into the measurement" if shuffled.leak else "no more than chance, so no leak"
    )
    said = share_words("that truth turned and moved at random, found", shuffled.moved)
    return [
        f"{as_is}; pipes whose features stand in like places share them",
        f"{said}; calls at random places would find {100 * shuffled.by_chance:.1f} %: {verdict}",
    ]


def words(found: Performance, pod: Pod | None) -> str:
    """All sentences for a terminal."""
    parts = statements(found, pod)
    head = f"{len(found.scans)} runs, {sum(s.length_m for s in found.scans):.2f} m scanned"
    return "\n".join([head, *(f"{part}: {line}" for part, lines in parts.items() for line, _ in lines)])


def figures(found: Performance, pod: Pod | None) -> Row:
    """The figures as JSON; what is no number (a share of none, say) is null."""
    return {
        "runs": [str(scan.folder) for scan in found.scans],
        "length_m": sum(scan.length_m for scan in found.scans),
        "unity": _plain(found.unity),
        "least_depths": _plain(found.least),
        "class_right": _plain(found.confusion.right),
        "detected": _plain(found.identification.detected),
        "detected_on_seen_wall": _plain(found.on_seen_wall),
        "identified": _plain(found.identification.identified),
        "false_calls": _plain(found.false_calls),
        "coverage": {name: _plain(one) for name, one in found.coverage.items()},
        "shuffled": _plain(found.shuffled),
        "pod": pod and pod.figures,
    }


def _plain(value: Any) -> Any:
    """Named tuples as dictionaries, all the way down."""
    if hasattr(value, "_asdict"):
        return {key: _plain(part) for key, part in value._asdict().items()}
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and value != value else value


# ---- page


def page(found: Performance, pod: Pod | None, out: Path) -> str:
    """The whole page; links to the runs' own pages are relative to where it lies."""
    pictures: dict[str, str] = {}
    if found.unity:
        measured, true = depths_pct(sized(found.targets))
        trade = Trade(measured, true, 100.0, found.unity, found.confusion, found.identification, found.false_calls)
        pictures["Depth"] = figure_html(unity_picture(trade))
        pictures["Classes"] = table_html(confusion_table(found.confusion))
    if pod is not None and (rows := curve_rows(pod)):
        pictures["Probability of detection by depth"] = figure_html(curve_picture(pod, rows))
    sections = "".join(
        f"<section><h2>{escape(part)}</h2>"
        + "".join(f"<p>{_linked(line, anchor)}.</p>" for line, anchor in lines)
        + f"{pictures.get(part, '')}</section>\n"
        for part, lines in statements(found, pod).items()
    )
    inside = found.unity.inside if found.unity else None
    lead = f"{len(found.scans)} runs, {sum(scan.length_m for scan in found.scans):.2f} m scanned"
    said = share_words("Depths within +-10 % of the wall", inside) if inside else "No depth to judge"
    verdict = f"{_linked(said, UNITY)}; {_linked(rate_words(found.false_calls), CALLS)}."
    good = found.unity is not None and found.unity.certainties[0].verdict == "shown"
    return page_html(
        "Performance of a set of runs",
        f"""<h1>Performance of a set of runs</h1>
<p class="lead">{_linked(lead, SCANS)}. Every number leads to the rows that it rests on.</p>
<p class="verdict {"clean" if good else "faulty"}">{verdict}</p>""",
        sections + _rows(found, out),
        escape(FOOTER),
    )


def _linked(line: str, anchor: str) -> str:
    """A sentence whose numbers are links."""
    said = escape(line.rstrip("."))
    said = said if said.startswith("a90") else said[0].upper() + said[1:]
    return NUMBER.sub(lambda number: f'<a href="#{anchor}">{number.group()}</a>', said)


def _rows(found: Performance, out: Path) -> str:
    """The tables that the numbers lead to."""
    every = target_rows(found.targets)
    for row in every:
        if row.get("floor_seen"):
            row["error_pct"] = row["true_loss_pct"] * (row["depth_mm"] / row["true_depth_mm"] - 1)
            row["inside"] = "yes" if abs(row["error_pct"]) <= 10 else "NO"
    brief = {"run": "run", "feature": "feature", "kind": "kind"}
    depths = brief | {"true_depth_mm": "true depth mm", "depth_mm": "measured mm"}
    tables = {
        TARGETS: (
            "All true features in what was scanned",
            every,
            brief
            | {"distance_mm": "distance mm", "clock_deg": "clock deg", "true_length_mm": "length mm"}
            | {"true_width_mm": "width mm", "true_depth_mm": "depth mm", "seen_share": "seen", "found": "found"}
            | {"true_class": "class", "class": "reported"},
        ),
        UNITY: (
            "Found, with a floor that was seen",
            [row for row in every if row.get("floor_seen")],
            depths | {"true_loss_pct": "true % of wall", "error_pct": "error % of wall", "inside": "within 10 %"},
        ),
        LEAST: ("Found, whose floor no light reached", [row for row in every if row.get("floor_seen") == 0], depths),
        CALLS: (
            "False calls",
            [
                {"run": run, "distance_mm": d.distance_mm, "length_mm": d.length_mm, "depth_mm": d.depth_mm}
                for run, d in found.false
            ],
            {"run": "run", "distance_mm": "distance mm", "length_mm": "length mm", "depth_mm": "depth mm"},
        ),
        INTERVALS: (
            "Stated 95 % intervals",
            [
                row | {"held": "yes" if row["low_mm"] <= row["true_mm"] <= row["high_mm"] else "NO"}
                for row in intervals(found.targets)
            ],
            {"run": "run", "feature": "feature", "dimension": "dimension", "low_mm": "from", "high_mm": "to"}
            | {"true_mm": "true", "held": "held"},
        ),
    }
    parts = [_scans(found, out)]
    parts += [_anchored(anchor, title, _cells(rows, columns)) for anchor, (title, rows, columns) in tables.items()]
    return "".join(parts)


def _scans(found: Performance, out: Path) -> str:
    """The runs, each a link to its own page."""
    head = "<tr><th>run</th><th>scanned from mm</th><th>to mm</th><th>features in its pipe</th><th>calls</th></tr>"
    lines = ""
    for scan in found.scans:
        link = escape(relpath(scan.folder.resolve() / "report.html", out.resolve()), quote=True)
        cells = "".join(f"<td>{mm:.0f}</td>" for mm in scan.scanned_mm)
        count = f"<td>{len(scan.pipe.features)}</td><td>{len(scan.defects)}</td>"
        lines += f'<tr><td><a href="{link}">{escape(scan.folder.name)}</a></td>{cells}{count}</tr>'
    return _anchored(
        SCANS, "Runs", f'<div class="scroll"><table><thead>{head}</thead><tbody>{lines}</tbody></table></div>'
    )


def _anchored(anchor: str, title: str, inside: str) -> str:
    return f'<section id="{anchor}"><h2>{escape(title)}</h2>{inside}</section>\n'


def _cells(rows: Sequence[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    if not rows:
        return "<p>None.</p>"
    return table_html([list(columns.values()), *([_cell(row.get(key)) for key in columns] for row in rows)])


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
