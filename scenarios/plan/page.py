"""The plan as one page: the decision, what is promised, what limits it, and what it does not cover."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.fidelity.agreed import compared_on
from scenarios.plan.findings import Tolerance, false_calls, seen_share_pct
from scenarios.plan.result import Result, contradicted, not_covered, settings_hash
from scenarios.provenance import versions
from scenarios.report.canvas import BLUE, SERIES, VERMILION, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from scenarios.study.gather import Mean
from scenarios.study.page import cells, figure_html, html_page, mean_text, table

NAMES = {
    "depth_error_pct": "depth, % of the wall",
    "length_error_mm": "length, mm",
    "width_error_mm": "width, mm",
    "distance_error_pct": "distance, % of the way",
    "roll_error_deg": "roll, degrees",
}

SIGNERS = ["made by", "approved by", "date", "signature"]


def write_page(file: Path, result: Result) -> None:
    """Write it."""
    plan = result.plan.file
    percent = f"{100 * plan.share:g} % of all, with {100 * plan.confidence:g} % confidence"
    sections = {
        "Limits": limits(result),
        f"Promised: {percent}": tolerances(result) + figure_html(errors(result)),
        "Detection": detections(result) + figure_html(over_depth(result)),
        **({"Speed against quality": speeds(result)} if result.speeds else {}),
        "What limits it most": causes(result),
        "Held against pictures": confirmed(result),
        "Inside which it holds": essential(result),
        "What this plan does not cover": "<ul>"
        + "".join(f"<li>{escape(w)}</li>" for w in not_covered(result))
        + "</ul>",
        "Made by": made_by(result),
        "Signed": table(
            cells("th", SIGNERS), cells("td", ["\u00a0"] * len(SIGNERS)), "For the ranges above, and no others."
        ),
    }
    verdict = {
        "go": "GO: every limit is shown to be kept.",
        "no go": "NO GO: at least one limit is broken.",
        "open": "OPEN: no limit is broken, but not all are shown to be kept.",
        "no limits": "No limits were stated: the figures decide nothing.",
    }[result.decision]
    if result.extrapolated:
        verdict += " EXTRAPOLATED: beyond what the testbench was held against, see below."
    page = html_page(f"Plan: {plan.name}", plan.why, verdict, result.decision == "go", sections)
    with whole_file(file) as work:
        work.write_text(page, encoding="utf-8")


def limits(result: Result) -> str:
    """Every limit with its verdict."""
    if not result.kept:
        return "<p>None were stated.</p>"
    head = cells("th", ["limit", "asked", "found", "with confidence", "verdict"])
    broken, rows = contradicted(result.confirmed, result.plan.file.share), ""
    for one in result.kept:
        contradicts = one.decision == "open" and one.limit in broken
        verdict = "open: pictures break the promise, see below" if contradicts else one.decision
        rows += cells("td", [one.limit, f"{one.asked:g}", _number(one.found), _number(one.bound), verdict])
    return table(head, rows, "A limit is kept when even the bound keeps it, and broken when the estimate does not.")


def tolerances(result: Result) -> str:
    """What is promised of sizes and places."""
    head = cells("th", ["of", "shown in", "n", "bias", "of the sample within", "promised"])
    rows = "".join(
        cells("td", [NAMES[one.what], one.shown_in, str(one.n), *_figures(one)]) for one in result.tolerances
    )
    caption = (
        "Largest error to either side, by order statistics, whatever its distribution; of found defects. A cheap "
        f"fidelity shows only what it was found to agree with pictures in ({compared_on(result.plan.scene)}), where "
        "this plan's own pictures lie inside its promise as often as promised; else they promise by themselves."
    )
    return table(head, rows, caption)


def _figures(one: Tolerance) -> list[str]:
    return [f"{one.bias:+.3g}" if one.n else "-", _number(one.share_within), _number(one.promised)]


def errors(result: Result) -> Picture:
    """Every depth error over depth, with the promise."""
    looks, wall = result.scans.looks, result.plan.scene.pipe.wall_mm
    hit = looks.hit
    error = 100 * (looks.measured_mm - looks.true_mm)[:, 2] / wall
    with drawing(3.2) as figure:
        axes = figure.add_subplot()
        for k, kind in enumerate(result.plan.file.defects):
            own = hit & (looks.kind == kind)
            axes.plot(
                looks.depth_pct[own], error[own], "osD^v<>P"[k % 8], color=SERIES[k % 6], markersize=4, label=kind
            )
        promised = result.tolerances[0].promised
        if promised is not None:
            for side in (-promised, promised):
                axes.axhline(side, color=VERMILION, linestyle="--", label="promised" if side > 0 else None)
        axes.set_xlabel("true depth, % of the wall")
        axes.set_ylabel("depth error, % of the wall")
        axes.set_title("Depth errors of the found defects")
        axes.legend(loc="best")
        return to_picture(figure, "Depth error over true depth", f"n = {int(hit.sum())} found defects.")


def detections(result: Result) -> str:
    """Detection by kind."""
    head = cells("th", ["kind", "shown in", "found", "95 %", "a50, %", "a90, %", "a90/95, %", "convention"])
    rows = ""
    for one in result.detections:
        share, sizes = one.found, (one.a50_pct, one.a90_pct, one.a90_95_pct)
        found = [f"{share.counted} of {share.n}", f"{100 * share.low:.1f} to {100 * share.high:.1f} %"]
        rows += cells("td", [one.kind, one.shown_in, *found, *map(_number, sizes), one.convention])
    rate, seen = false_calls(result.plan, result.scans), seen_share_pct(result.scans)
    caption = (
        f"Depths in percent of the wall, on wall that is seen. False calls: {rate.calls} on {rate.length_m:.1f} m, at "
        f"most {rate.upper_per_m:.3g} a metre with {100 * rate.confidence:g} %. Seen: {mean_text(seen)} % of the wall."
    )
    return table(head, rows, caption)


def over_depth(result: Result) -> Picture:
    """Hits and misses over depth."""
    looks = result.scans.looks
    kinds = list(result.plan.file.defects)
    with drawing(1.0 + 0.6 * len(kinds)) as figure:
        axes = figure.add_subplot()
        for k, kind in enumerate(kinds):
            own = looks.kind == kind
            depth, hit = looks.depth_pct[own], looks.hit[own]
            axes.plot(depth[hit], np.full(hit.sum(), k + 0.12), "o", color=BLUE, markersize=4)
            axes.plot(depth[~hit], np.full((~hit).sum(), k - 0.12), "x", color=VERMILION, markersize=6)
        axes.plot([], [], "o", color=BLUE, label="found")
        axes.plot([], [], "x", color=VERMILION, label="missed")
        axes.set_yticks(range(len(kinds)), kinds)
        axes.set_ylim(-0.6, len(kinds) - 0.4)
        axes.set_xlabel("true depth, % of the wall")
        axes.set_title("Found and missed")
        axes.legend(loc="center right")
        return to_picture(figure, "Found and missed defects over depth, by kind", f"n = {looks.hit.size} defects.")


def speeds(result: Result) -> str:
    """Scan speed against what it costs."""
    head = cells("th", ["speed, mm/s", "minutes a metre", "found", "depth error, mean, % of the wall", "seen, %"])
    rows = ""
    for one in result.speeds:
        found = f"{one.found.counted} of {one.found.n}"
        text = [f"{one.speed_mm_s:g}", f"{one.minutes_per_m:.2f}", found]
        rows += cells("td", [*text, mean_text(one.depth_error_pct), mean_text(one.seen_share_pct)])
    return table(head, rows, "The same defects at every speed.")


def causes(result: Result) -> str:
    """What switching one cause off does to the errors."""
    if not result.without:
        return "<p>No cause that can be switched off is in the scene.</p>"
    names = list(dict.fromkeys(name for one in result.without for name in one.change))
    head = cells("th", ["without", *names])
    rows = ""
    for one in result.without:
        rows += cells("td", [one.cause, *(_change(one.change[n]) if n in one.change else "-" for n in names)])
    n = max((mean.n for one in result.without for mean in one.change.values()), default=0)
    caption = (
        "Mean change of the size of the error, with its 95 % interval, on the same scans (n up to "
        f"{n}); below 0, the cause does harm."
    )
    return table(head, rows, caption)


def _change(mean: Mean) -> str:
    """To a thousandth: what is smaller matters to nobody."""
    return f"{round(mean.mean, 3) + 0.0:+.3f}" + ("" if mean.half is None else f" ± {mean.half:.3f}")


def confirmed(result: Result) -> str:
    """Fresh scans in pictures inside the promise."""
    if not result.confirmed:
        return "<p>Not done: `confirm` says how many scans of other seeds to make in pictures.</p>"
    asked = result.plan.file.share
    head = cells("th", ["of", "promised", "inside", "95 %", "as often as promised"])
    rows = ""
    for one in result.confirmed:
        inside = one.inside
        ends = f"{100 * inside.low:.1f} to {100 * inside.high:.1f} %"
        said = "yes" if inside.share >= asked else "not shown otherwise" if inside.high >= asked else "NO"
        rows += cells("td", [NAMES[one.what], f"{one.promised:.3g}", f"{inside.counted} of {inside.n}", ends, said])
    caption = f"Errors inside the promise, which is for {100 * asked:g} % of all, where it was made without pictures."
    return table(head, rows, caption)


def essential(result: Result) -> str:
    """The ranges in which the scans lay."""
    plan = result.plan.file
    rows = ""
    for name, given in plan.defects.items():
        sizes = ", ".join(f"{key} {_range(value)}" for key, value in given.items() if key != "kind")
        rows += cells("td", [f"defect {name}", f"{given['kind']}: {sizes}"])
    for path, value in {**plan.set, **plan.vary}.items():
        rows += cells("td", [path, _said(value)])
    scene = result.plan.scene
    pipe = f"bore radius {scene.pipe.bore_radius_mm:.4g} mm, wall {scene.pipe.wall_mm:.3g} mm"
    rows += cells("td", ["pipe", pipe])
    return table(cells("th", ["essential variable", "value or range"]), rows, f"All else as in {plan.base}.")


def made_by(result: Result) -> str:
    """Version, seed, n, settings."""
    counts, plan = result.scans.counts, result.plan.file
    facts = {
        "pipetwin": versions()["pipetwin"],
        "seed": plan.seed,
        "settings": settings_hash(result.plan),
        "scans": ", ".join(f"{name} {n}" for name, n in counts.items()),
        "defects": result.scans.looks.hit.size,
    }
    return "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(str(v))}</dd>" for k, v in facts.items()) + "</dl>"


def _said(value: Any) -> str:
    return ", ".join(f"{key} {one}" for key, one in value.items()) if isinstance(value, dict) else str(value)


def _range(value: Any) -> str:
    return f"{value[0]:g} to {value[1]:g}" if isinstance(value, list | tuple) else str(value)


def _number(value: float | None) -> str:
    return "not shown" if value is None else f"{value:.3g}"
