"""What the measurement said was not as it should be (slips, silences, joints), beside what truly slipped."""

from __future__ import annotations

from html import escape

import numpy as np

from algorithms.localisation import ESTIMATORS
from algorithms.localisation.alarm import ALL
from algorithms.types import Episode
from scenarios.report.numbers import NONE
from scenarios.report.path_figures import slipped_mm
from scenarios.run import Run

LEAD_S = 1.0  # a slip is under way before it is named
MOST_ROWS = 60
HEADS = ("What", "Who", "From (s)", "Until (s)", "At (mm)", "Stated", "True")


def alarms(run: Run) -> str:
    """A row an episode, its true slip beside it; then what each wheel truly slipped."""
    kind = run.scenario.method.localisation.kind
    mute = "" if ESTIMATORS[kind].episodes else f"<p>Of the estimators, `{kind}` gives no slip alarm; `fused` does.</p>"
    slipped = slipped_mm(run)
    rows = sorted(run.found.episodes, key=lambda one: (one.start_ns, one.who))
    return mute + (_table(run, rows, slipped) if rows else "" if mute else "<p>No alarm.</p>") + _in_all(slipped)


def _table(run: Run, rows: list[Episode], slipped: np.ndarray) -> str:
    head = "".join(f'<th scope="col">{title}</th>' for title in HEADS)
    cells = (_cells(run, one, slipped) for one in rows[:MOST_ROWS])
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in cells)
    rest = f"<p>{len(rows) - MOST_ROWS} more are in episodes.csv.</p>" if len(rows) > MOST_ROWS else ""
    return (
        '<div class="scroll" tabindex="0"><table class="alarms"><caption>As stated live. A slip is what '
        "the rim went more than the robot, its true size counted from a second before the alarm; a joint, by how much "
        "the distance was put right there; a gap, a silence.</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>{rest}"
    )


def _cells(run: Run, one: Episode, slipped: np.ndarray) -> list[str]:
    start_s, end_s = one.start_ns / 1e9, one.end_ns / 1e9
    path = run.found.trajectory
    at_mm = path.T_pipe_camera[np.searchsorted(path.stamp_ns, one.start_ns).clip(max=path.stamp_ns.size - 1), 2, 3]
    unit, true = "s" if one.kind == "gap" else "mm", NONE
    if one.kind == "slip":
        time_s = run.truth.time_s
        a, b = (int(np.searchsorted(time_s, t).clip(max=time_s.size - 1)) for t in (start_s - LEAD_S, end_s))
        each = slipped[b] - slipped[a]
        wheel = float(np.median(each)) if one.who == ALL else float(each[int(one.who.removeprefix("wheel ")) - 1])
        true = f"{wheel:+.1f} mm"
    words = [one.kind, escape(one.who), f"{start_s:.1f}", f"{end_s:.1f}", f"{at_mm:.0f}"]
    return [*words, f"{one.amount:+.1f} {unit}", true]


def _in_all(slipped: np.ndarray) -> str:
    each = ", ".join(f"wheel {k} {mm:+.1f} mm" for k, mm in enumerate(slipped[-1], start=1))
    return f"<p>Truly slipped over the whole drive: {each}.</p>"
