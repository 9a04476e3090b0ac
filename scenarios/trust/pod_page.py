"""What a POD says: in words for a terminal, and as a page with the curve and its bound."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr, ndtri

from algorithms.trust.curve import NoCurve, one_sided_drop, to_size, to_x
from algorithms.trust.detection import CONFIDENCE, POD, lower_curve
from algorithms.trust.exact_bounds import share_of
from algorithms.trust.signal_response import SignalCurve
from scenarios.document import BadInput, shown
from scenarios.provenance import write_versions
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import BLACK, BLUE, GREEN, VERMILION, Picture, drawing, to_picture
from scenarios.report.plain_rows import text_table, write_rows
from scenarios.run_folder import run_folder
from scenarios.trust.looks import PodQuestion, Row
from scenarios.trust.pod import Pod, pod_of
from scenarios.trust.scan_looks import looks_of
from scenarios.trust.signal_figures import axis_points, decision_picture, signal_picture, size_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BOUND_PODS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98, 0.99, 0.995, 0.999]
BINS, FEWEST_A_BIN = 8, 5
FOOTER = (
    "Sizes and signals in the table's own units. Bounds come from likelihood-ratio regions. After MIL-HDBK-1823A; one "
    "target is worth one look."
)
OTHERS = {"model": "model", "deviance": "deviance", "a50": "a50", "a90": "a90", "a90_95": "a90/95 (2.706)"}
OTHERS |= {"a90_95_handbook": "a90/95 (3.841)", "outcome": "outcome"}
SIGNALS = {"straight": "p straight", "one_spread": "p one spread", "normal": "p normal"}


def run_pod(source: Path, question: PodQuestion, out: Path, method: str | None = None) -> Pod:
    """Fit, and write the page, the figures as JSON and the curve with its bound as CSV into a folder.

    `source` is a table of looks, or a folder of scans (a study, a run, runs), whose looks are written there, too.

    Raises:
        BadInput: for a table or scans that cannot be used, or a folder that cannot be written.
    """
    if method is not None and not source.is_dir():
        raise BadInput([f"--method: got {shown(method)}; {source} is a table, not a study"])
    with run_folder(out) as folder:
        if scans := source.is_dir():
            write_rows(looks_of(source, method), folder / "looks")
        pod = pod_of(folder / "looks.csv" if scans else source, question)
        rows = curve_rows(pod)
        (folder / "pod.json").write_text(json.dumps(json_figures(pod), indent=1, allow_nan=False) + "\n")
        if rows:
            with (folder / "curve.csv").open("w", newline="") as target:
                table = csv.DictWriter(target, ["size", "pod", "pod_lower_95"])
                table.writeheader()
                table.writerows(rows)
        (folder / "report.html").write_text(page(source, pod, rows), encoding="utf-8")
        write_versions(folder)
    return pod


def json_figures(pod: Pod) -> Row:
    """All figures, those of the other models and the notes too."""
    others = [{key: value for key, value in row.items() if value == value} for row in pod.others]
    return {**pod.figures, "others": others, "notes": pod.notes}


def curve_rows(pod: Pod) -> list[Row]:
    """The curve over sizes, with its one-sided 95 % lower bound: exact at `BOUND_PODS`, smooth between them."""
    if isinstance(pod.curve, NoCurve):
        return []
    curve = pod.curve
    bound = lower_curve(curve, BOUND_PODS, one_sided_drop(CONFIDENCE))
    sizes = pod.looks.size[pod.looks.size > 0]
    ends = [float(sizes.min()), max(float(sizes.max()), (pod.figures["a90"] or 0.0) * 1.1)]
    x = axis_points(ends[0], ends[1], curve.scale)
    at_any_size = max((level for size, level in bound if size <= 0), default=0.0)
    lower = np.full(x.size, at_any_size)
    if rising := [(size, level) for size, level in bound if size > 0]:
        place, level = np.array(rising).T
        # over normal deviates the curve is straighter
        lower = ndtr(np.interp(x, to_x(place, curve.scale), ndtri(level), left=ndtri(at_any_size)))
    return [
        {"size": to_size(at, curve.scale), "pod": float(value), "pod_lower_95": float(low)}
        for at, value, low in zip(x, curve.pod(x), np.minimum(lower, curve.pod(x)), strict=True)
    ]


# ---- words


def verdict(pod: Pod) -> str:
    """The outcome in one line."""
    figures = pod.figures
    if isinstance(pod.curve, NoCurve):
        return f"No curve: {figures['outcome']}. {pod.curve.reason[0].upper()}{pod.curve.reason[1:]}."
    if figures["a90"] is None:
        return f"a50 is {_size(figures['a50'])}; the curve never reaches a POD of 0.9."
    bound = figures["a90_95"][0]
    return f"a90 is {_size(figures['a90'])}, a90/95 {_size(bound['size'])} ({bound['convention']})."


def _size(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"


def facts(pod: Pod) -> list[tuple[str, str]]:
    """Every figure with its name, in the order in which they are read."""
    f = pod.figures
    each = (
        ""
        if f["looks_per_target"] == [1, 1]
        else f", {'-'.join(map(str, sorted(set(f['looks_per_target']))))} a target"
    )
    out = [("looks", f"{f['looks']} at {f['targets']} targets{each}" + (f", {f['hits']} hits" if "hits" in f else ""))]
    if f["kind"] == "signal":
        out.append(
            ("limits", f"{f['at_most_left']} signals at or under the left limit, {f['at_least_right']} at the right")
        )
        out.append(("decision", f"{f['decision']:g}"))
    if f["outcome"] == "curve":
        out += _parameters(f)
        out += [("a50", _size(f["a50"])), ("a90", _size(f["a90"]))]
    out += [("a90/95", f"{_size(bound['size'])} ({bound['convention']})") for bound in f["a90_95"]]
    if calls := f.get("false_calls"):
        out.append(("false calls", _calls(calls)))
    if noise := f.get("noise"):
        quantiles = ", ".join(f"{name} {value:.4g}" for name, value in noise["quantiles"].items())
        law = f"{noise['law']}, mean {noise['mean']:.4g}, sd {noise['standard_deviation']:.4g} of {noise['n']}"
        out.append(("noise", f"{law}; below {quantiles}"))
        out.append(("noise calls", f"{noise['false_call_probability']:.3g} by that law; {_calls(noise['called'])}"))
    return out


def _calls(calls: Row) -> str:
    upper = ", ".join(f"{value:.4f} ({name})" for name, value in calls["upper"].items())
    return f"{calls['counted']} of {calls['n']}: {calls['share']:.4f}, at most {upper}"


def _parameters(f: Row) -> list[tuple[str, str]]:
    model = (
        f"{f['link']}, {f['size_scale']} size" if "link" in f else f"{f['signal_scale']} signal, {f['size_scale']} size"
    )
    out = [("model", model), ("mu, sigma", f"{f['mu']:.5g}, {f['sigma']:.5g}")]
    if "standard_errors" in f:
        line = [("intercept", "intercept"), ("slope", "slope"), ("tau", "scatter tau")]
        for (key, name), error in zip(line, f["standard_errors"], strict=False):
            out.append((name, f"{f[key]:.5g} (standard error {error:.4g})"))
    else:
        out.append(("floor, ceiling", f"{f['floor']:.4g}, {f['ceiling']:.4g}"))
    if "deviance" in f:
        out.append(("deviance", f"{f['deviance']:.5g}"))
    return out


def words(pod: Pod) -> str:
    """All of it for a terminal."""
    said = [*facts(pod), *(("note", note) for note in pod.notes)]
    width = max(len(name) for name, _ in said)
    lines = [verdict(pod), *(f"{name:<{width}}  {value}" for name, value in said)]
    return "\n".join([*lines, "", text_table(pod.others, _other_columns(pod), "other models on the same looks")])


def _other_columns(pod: Pod) -> dict[str, str]:
    if pod.figures["kind"] == "signal":
        return {key: head for key, head in (OTHERS | SIGNALS).items() if key != "deviance"}
    return OTHERS


# ---- page


def page(file: Path, pod: Pod, rows: list[Row]) -> str:
    """The page: the curve, the figures, the other models, and what is weak."""
    pictures = [curve_picture(pod, rows)] if rows else []
    if isinstance(pod.curve, SignalCurve):
        pictures.insert(0, signal_picture(pod.curve))
        pictures += [decision_picture(pod)] if pod.figures.get("decisions") else []
    columns = _other_columns(pod)
    others = [list(columns.values()), *([_cell(row.get(key)) for key in columns] for row in pod.others)]
    sections = [
        Section("Detection", [note[0].upper() + note[1:] + "." for note in pod.notes], pictures=pictures),
        Section("Figures", table=[("figure", "value"), *facts(pod)]),
        Section(
            "Other models on the same looks",
            ["Of hit/miss models on the same looks the one with the smaller deviance is the likelier."],
            others,
        ),
    ]
    good = pod.figures["outcome"] == "curve" and pod.figures["a90_95"][0]["size"] is not None
    lead = f"{file.name}: {dict(facts(pod))['looks']}"
    return calibration_page("Probability of detection", lead, verdict(pod), good, sections, FOOTER)


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def curve_picture(pod: Pod, rows: list[Row]) -> Picture:
    """POD over size with its bound; hits and misses in bins, or as a rug."""
    size, curve, lower = (np.array([row[key] for row in rows]) for key in ("size", "pod", "pod_lower_95"))
    with drawing(4.6) as figure:
        axes = figure.subplots()
        axes.plot(size, curve, color=BLUE, label="POD, likeliest curve")
        axes.plot(
            size,
            np.where(lower > 0, lower, np.nan),
            color=BLUE,
            linestyle="--",
            label="its one-sided 95 % lower bound (likelihood ratio)",
        )
        if pod.figures["kind"] == "hit/miss":
            _bins(axes, pod)
        axes.axhline(POD, color="#777777", linewidth=0.8)
        a90, bound = pod.figures["a90"], pod.figures["a90_95"][0]["size"]
        for at, name, color, style in ((a90, "a90", BLACK, "-"), (bound, "a90/95", VERMILION, "--")):
            if at is not None and at <= size.max():
                axes.plot([at, at], [0, POD], color=color, linestyle=style, label=f"{name} = {at:.4g}")
        size_axis(axes, pod.curve.scale)
        axes.set_ylim(-0.03, 1.03)
        axes.set_ylabel("probability of detection")
        axes.set_title("Probability of detection over size")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return to_picture(
            figure,
            "Probability of detection over size with its lower bound",
            "Where the dashed curve reaches 0.9 is a90/95. " + _caption(pod),
        )


def _caption(pod: Pod) -> str:
    if pod.figures["kind"] == "hit/miss":
        free = "" if pod.figures["looks_per_target"][1] == 1 else ", as if looks were independent"
        return f"Dots: share of hits of targets of about one size, exact 95 % interval{free}; ticks: single looks."
    return "Hits are signals above the decision."


def _bins(axes: Axes, pod: Pod) -> None:
    real = pod.looks.size > 0
    size, hit = pod.looks.size[real], pod.looks.value[real] == 1
    for height, chosen in ((1.02, hit), (-0.02, ~hit)):
        axes.plot(size[chosen], np.full(int(chosen.sum()), height), "|", color="#888888", markersize=5)
    order = np.argsort(size, kind="stable")
    for k, part in enumerate(np.array_split(order, max(1, min(BINS, size.size // FEWEST_A_BIN)))):
        share = share_of(int(hit[part].sum()), part.size)
        errors = [[share.share - share.low], [share.high - share.share]]
        label = "share of hits, exact 95 % interval" if k == 0 else None
        axes.errorbar(
            float(np.median(size[part])),
            share.share,
            errors,
            fmt="o",
            color=GREEN,
            markersize=4,
            capsize=2,
            label=label,
        )
