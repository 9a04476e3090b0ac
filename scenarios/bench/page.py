"""The bench's page: the verdict, the tables, what the errors look like, and the clouds side by side."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.bench.clouds import MOST_CLOUDS, clouds_picture
from scenarios.bench.frames import FrameCase
from scenarios.bench.statistics import Row, by_scenario, nearest_method, rows, winner_words
from scenarios.report.canvas import BLACK, BLUE, SERIES, VERMILION, Picture, drawing, to_picture
from scenarios.report.numbers import figure as number
from scenarios.report.page import figure_html
from scenarios.report.shell import page_html
from sensor_model.settings import Settings

if TYPE_CHECKING:
    from scenarios.bench.registration import Bench

COLUMNS = {
    "method": "method",
    "failures": "failed",
    "weak": "weak",
    "center": "centre, mm: median [95 %]",
    "axis": "axis, °: median [95 %]",
    "radius_rms_mm": "radius, mm RMS",
    "crb_ratio_axis": "axis / bound",
    "crb_ratio_center": "centre / bound",
    "crb_ratio_radius": "radius / bound",
    "travel_rms_mm": "travel, mm RMS",
    "roll_rms_deg": "roll, ° RMS",
    "ms_median": "ms a frame",
}
MOST_PAIRS = 40


def write_page(result: Bench, cases: dict[str, FrameCase], methods: dict[str, Settings], file: Path) -> None:
    """Write the page of one bench; it opens offline, without a script or a second file."""
    sections = [_scenario(result, name, cases.get(name), methods) for name in by_scenario(result.errors)]
    body = "".join(sections) + _pairs(result)
    file.write_text(
        page_html(
            "Registration bench",
            f"""<h1>Registration bench: {escape(result.level)} level</h1>
<p class="lead">{escape(_lead(result))}</p>
<p class="verdict clean">{escape(_verdict(result))}</p>""",
            body,
            """\
Errors against the exact truth. A frame failed when there is no pose, or one off by more than 1 degree or 1 mm.
A weak pose is one that the method itself doubts. The bound is Cramer and Rao's: no unbiased method that even knows
which points are wall can have a smaller RMS error. Centre: how far the pipe's axis passes the camera beside its true
place.""",
        ),
        encoding="utf-8",
    )


def _lead(result: Bench) -> str:
    if result.level == "scan":
        return "Whole recordings, each frame registered by every method from the same slit pixels."
    return (
        "Synthetic frames with exact truth and no picture; every method sees the same frames. Odometry tells travel "
        "and roll; methods with a map have seen one frame before."
    )


def _verdict(result: Bench) -> str:
    """Fewest failures first, then the smallest median error of the centre over all frames."""
    best = nearest_method(result.rows)
    if best is None:
        return "No method gave a pose that stands."
    c = best.center_median_mm
    return (
        f"{best.method}: {best.failures} of {best.frames} frames failed, centre {c.median:.3g} mm "
        f"[{c.low:.3g}, {c.high:.3g}] in the median, {best.ms_median:.2g} ms a frame."
    )


def _scenario(result: Bench, name: str, case: FrameCase | None, methods: dict[str, Settings]) -> str:
    errors = by_scenario(result.errors)[name]
    mine = rows(errors, result.level)
    frames = len({(e.seed, e.frame) for e in errors})
    pictures = [_errors_picture(name, result, mine)]
    if case is not None:
        pictures.append(clouds_of_case(name, case, methods))
    elif clouds := [cloud for cloud in result.clouds if cloud.scenario == name]:
        pictures.append(clouds_picture(clouds))
    shown = "".join(figure_html(picture) for picture in pictures)
    words = f"<p>{escape(_case_words(case))}</p>" if case is not None else ""
    return f"<section><h2>{escape(name)}: {frames} frames</h2>{words}{_table(mine)}{shown}</section>\n"


def _case_words(case: FrameCase) -> str:
    default = FrameCase()
    differs = {k: v for k, v in case.model_dump().items() if v != getattr(default, k)}
    return "Settings: " + (", ".join(f"{k} {v:g}" for k, v in differs.items()) or "the defaults") + "."


def _table(mine: list[Row]) -> str:
    head = "".join(f'<th scope="col">{escape(words)}</th>' for words in COLUMNS.values())
    body = "".join(f"<tr>{''.join(f'<td>{escape(_cell(row, key))}</td>' for key in COLUMNS)}</tr>" for row in mine)
    return _framed(head, body)


def _framed(head: str, body: str) -> str:
    table = f'<table class="bench"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    return f'<div class="scroll" tabindex="0">{table}</div>'


def _cell(row: Row, key: str) -> str:
    if key in ("center", "axis"):
        median = row.center_median_mm if key == "center" else row.axis_median_deg
        return f"{number(median.median)} [{number(median.low)}, {number(median.high)}]"
    value = getattr(row, key)
    return value if isinstance(value, str) else number(value)


def _errors_picture(name: str, result: Bench, mine: list[Row]) -> Picture:
    """Every frame's error of the centre, a line a method, with the median, its interval, and the bound."""
    errors = by_scenario(result.errors)[name]
    bounds = [e.bound.center_mm for e in errors if np.isfinite(e.bound.center_mm)]
    with drawing(1.3 + 0.42 * len(mine)) as figure:
        axes = figure.subplots()
        rng = np.random.default_rng(0)
        for k, row in enumerate(mine):
            off = np.array([e.center_mm for e in errors if e.method == row.method and np.isfinite(e.center_mm)])
            axes.scatter(off, k + rng.uniform(-0.22, 0.22, off.size), s=7, color=BLUE, alpha=0.35, linewidths=0)
            c = row.center_median_mm
            if off.size:
                axes.plot([c.low, c.high], [k, k], color=BLACK, linewidth=4, solid_capstyle="butt")
                axes.plot(c.median, k, "|", color=BLACK, markersize=14)
        if bounds:
            axes.axvline(np.median(bounds), color=VERMILION, linestyle="--", label="Cramer-Rao bound (RMS)")
            axes.legend(loc="lower right")
        axes.set_xscale("log")
        axes.set_yticks(range(len(mine)), [row.method for row in mine])
        axes.invert_yaxis()
        axes.set_xlabel("error of the camera's centre (mm)")
        axes.set_title(f"{name}: where each method puts the camera")
        return to_picture(
            figure,
            f"Errors of the centre by method in {name}.",
            "A point is a frame; black: median and the interval that holds it with 95 % confidence.",
        )


def clouds_of_case(name: str, case: FrameCase, methods: dict[str, Settings]) -> Picture:
    """The first frame as each method aligns it, unrolled: a good pose leaves the wall flat."""
    from scenarios.bench.frame_bench import first_alignments

    frame, found = first_alignments(case, methods)
    shown = list(found.items())[:MOST_CLOUDS]
    columns = min(len(shown), 4)
    lines = -(-len(shown) // columns)
    reach = max(3.0 * case.noise_mm, 0.5) + (case.defect_depth_mm if case.defect_share else 0.0)
    with drawing(0.7 + 2.4 * lines) as figure:
        grid = np.atleast_1d(figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)).ravel()
        thin = slice(None, None, max(frame.on_wall.size // 4000, 1))
        for axes, (label, (alignment, xyz)) in zip(grid, shown, strict=False):
            clock = np.degrees(np.arctan2(xyz[thin, 0], -xyz[thin, 1])) % 360
            high = np.hypot(xyz[thin, 0], xyz[thin, 1]) - case.radius_mm
            wall = frame.on_wall[thin]
            axes.scatter(clock[wall], high[wall], s=2, color=BLUE, linewidths=0, label="wall")
            axes.scatter(clock[~wall], high[~wall], s=2, color=VERMILION, linewidths=0, label="no wall")
            axes.axhline(0, color=BLACK, linewidth=0.7)
            axes.set_ylim(-reach, reach)
            axes.set_title(label if alignment.converged else f"{label}: failed", color=SERIES[1 - alignment.converged])
        for axes in grid[len(shown) :]:
            axes.set_visible(False)
        for axes in grid[::columns]:
            axes.set_ylabel("beyond the wall (mm)")
        for axes in grid[max(len(shown) - columns, 0) : len(shown)]:
            axes.set_xlabel("around the pipe (°)")
            axes.set_xticks([0, 90, 180, 270, 360])
        return to_picture(
            figure,
            f"One frame of {name} as each method aligns it, unrolled.",
            "The first frame, unrolled about the pipe's axis as each method found it: a wave is a camera put off "
            "centre, a fan is an axis put askew. Vermilion points are truly no wall.",
        )


def _pairs(result: Bench) -> str:
    if not result.pairs:
        return ""
    lines = "".join(
        f"<tr><td>{escape(p.scenario)}</td><td>{escape(p.a)}</td><td>{escape(p.b)}</td><td>{p.frames}</td>"
        f"<td>{100 * p.a_nearer_share:.0f} %</td><td>{p.difference_mm.median:+.4f} [{p.difference_mm.low:+.4f}, "
        f"{p.difference_mm.high:+.4f}]</td><td>{p.p:.1g}</td><td>{number(p.floor_mm)}</td>"
        f"<td>{escape(winner_words(p))}</td></tr>"
        for p in result.pairs[:MOST_PAIRS]
    )
    rest = len(result.pairs) - MOST_PAIRS
    more = f"<p>{rest} further pairs are in pairs.csv.</p>" if rest > 0 else ""
    heads = ["scenario", "a", "b", "frames", "a nearer", "a less b, mm [95 %]", "p (Wilcoxon)", "floor, mm", "so"]
    head = "".join(f'<th scope="col">{escape(words)}</th>' for words in heads)
    return (
        "<section><h2>Method against method</h2><p>Errors of the centre on the same frames, frame by frame. The floor "
        "is the median Cramer-Rao bound: differences far below it mean nothing.</p>"
        f"{_framed(head, lines)}{more}</section>"
    )
