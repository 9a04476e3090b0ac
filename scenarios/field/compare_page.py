"""The page of a comparison: the verdict, every figure, how far each lies off, and how far all of it can be believed."""

from __future__ import annotations

from collections.abc import Sequence

from scenarios.field.credibility import credibility
from scenarios.field.line import Line
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import BLUE, VERMILION, Picture, drawing, to_picture
from scenarios.report.numbers import figure, signed
from scenarios.scenario import Scenario

FOOTER = "Lengths in millimetres, angles in degrees."
MOST = 3.0  # spreads; what lies further off is drawn at the edge
SPREAD = (
    "The spread comes from the log alone: it is cut into up to eight stretches of time, and another such stretch of "
    "the same log would lie within the spread 95 times in 100 (Student's t). It is never taken for less than 0.5 % of "
    "the figure (0.02 % of the diameter, 4 % of what the slide's print makes rough, a tenth of the drop-outs, 0.8 % of "
    "the mean force). Speed, offset, roll and tilt are compared stretch by stretch, and the worst one is shown; their "
    "spread is how single frames of the log scatter, or what the measurement states if that is more. Sizes of defects "
    "have the uncertainty that both state for theirs."
)


def compare_page(log: str, replay: str, lines: Sequence[Line], scenario: Scenario | None) -> str:
    """The whole page."""
    outside = [line for line in lines if not line.inside]
    verdict = f"{len(lines) - len(outside)} of {len(lines)} figures lie inside the log's own spread"
    verdict += "." if not outside else f"; outside: {', '.join(line.name for line in outside)}."
    rows = [("figure", "log", "replay", "difference", "spread", "stretches", "verdict")]
    rows += [
        (
            line.name,
            figure(line.log, 4),
            figure(line.replay, 4),
            signed(line.difference, _decimals(line.spread)),
            figure(line.spread, 2),
            str(line.blocks),
            "inside" if line.inside else "OUTSIDE",
        )
        for line in lines
    ]
    sections = [
        Section("How far each figure lies off", [SPREAD], (), [_picture(lines)]),
        Section("Figures", [], rows),
        *credibility(scenario),
    ]
    lead = f"{replay} beside {log}"
    return calibration_page("The twin next to its log", lead, verdict, not outside, sections, FOOTER)


def _decimals(spread: float) -> int:
    """As many as show a hundredth of the spread."""
    from math import ceil, log10

    return min(max(ceil(-log10(spread)) + 1, 0), 8) if spread > 0 else 2


def _picture(lines: Sequence[Line]) -> Picture:
    """Differences in spreads, one dot a figure."""
    shown = [line for line in lines if line.spread > 0][::-1]
    with drawing(0.22 * len(shown) + 1.2) as drawn:
        axes = drawn.subplots()
        axes.axvspan(-1, 1, color="#e8eef2")
        for k, line in enumerate(shown):
            at = max(-MOST, min(MOST, line.difference / line.spread))
            axes.plot(at, k, "o" if line.inside else "D", color=BLUE if line.inside else VERMILION, markersize=5)
        axes.set_yticks(range(len(shown)), [line.name for line in shown], fontsize=8)
        axes.set(xlim=(-MOST - 0.15, MOST + 0.15), ylim=(-0.7, len(shown) - 0.3))
        axes.set(xlabel="replay less log, in spreads of the log", title="Dots within the band: inside the spread")
        return to_picture(drawn, "Difference of each figure in spreads.", "Diamonds lie outside; beyond 3 at the edge.")
