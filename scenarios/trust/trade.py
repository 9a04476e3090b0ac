"""A tool's performance as the trade states it, as parts of a page: unity plot, classes, identification, false calls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from algorithms.trust.exact_bounds import Rate, Share
from algorithms.trust.feature_class import NOTE
from algorithms.trust.performance import Confusion, Identification, Unity, unity_words
from scenarios.report.calibration_page import Section
from scenarios.report.canvas import BLUE, SKY, VERMILION, Picture, drawing, to_picture

MOST_DOTS = 5000


class Trade(NamedTuple):
    """What a page states: depths of the features found, their walls' unity figures, classes, and false calls."""

    measured_mm: np.ndarray
    true_mm: np.ndarray
    wall_mm: float
    unity: Unity
    confusion: Confusion
    identification: Identification
    false_calls: Rate


def trade_sections(trade: Trade) -> list[Section]:
    """The parts of a page, in the trade's order."""
    found, named = trade.identification
    return [
        Section(
            "Depth against truth", [f"{line}." for line in unity_words(trade.unity)], pictures=[unity_picture(trade)]
        ),
        Section(
            "Classes",
            [f"{share_words('Class right', trade.confusion.right)}. {NOTE[0].upper()}{NOTE[1:]}."],
            confusion_table(trade.confusion),
        ),
        Section(
            "Detection and identification",
            [
                f"{share_words('Detected', found)}; {share_words('identified of those detected (POI)', named)}.",
                f"{rate_words(trade.false_calls)}.",
            ],
        ),
    ]


def share_words(what: str, share: Share) -> str:
    """A share with its interval."""
    if share.n == 0:
        return f"{what}: none to judge"
    ends = f"[{100 * share.low:.1f}, {100 * share.high:.1f}]"
    return f"{what}: {share.counted} of {share.n}, {100 * share.share:.1f} % {ends}"


def rate_words(rate: Rate) -> str:
    """False calls per metre with their exact bound."""
    return (
        f"{rate.calls} false calls on {rate.length_m:g} m: {rate.per_m:.2g} per metre, at most {rate.upper_per_m:.2g} "
        f"(one-sided {100 * rate.confidence:g} %, Poisson)"
    )


def confusion_table(confusion: Confusion) -> list[list[str]]:
    """True classes down, reported ones across, of those that occur."""
    seen = np.nonzero(confusion.counts.sum(axis=0) + confusion.counts.sum(axis=1))[0]
    names = [confusion.classes[k] for k in seen]
    rows = [[confusion.classes[k], *(str(confusion.counts[k, other]) for other in seen)] for k in seen]
    return [["true \\ reported", *names], *rows]


def unity_picture(trade: Trade) -> Picture:
    """Measured over true depth in per cent of the wall, with the band that the statement is about."""
    true, measured = 100 * trade.true_mm / trade.wall_mm, 100 * trade.measured_mm / trade.wall_mm
    shown = np.linspace(0, true.size - 1, min(true.size, MOST_DOTS)).astype(int)
    inside = np.abs(measured - true) <= trade.unity.tolerance_pct
    most = max(100.0, float(true.max()), float(measured.max()))
    ends = np.array([0.0, most])
    band = trade.unity.tolerance_pct
    with drawing(6.2, 7.0) as figure:
        axes = figure.subplots()
        axes.fill_between(ends, ends - band, ends + band, color=SKY, alpha=0.3, label=f"within {band:g} % of the wall")
        axes.plot(ends, ends, color="#777777", linewidth=1, label="measured = true")
        for kept, color, marker, label in ((True, BLUE, "o", "inside"), (False, VERMILION, "^", "outside")):
            part = shown[inside[shown] == kept]
            axes.plot(true[part], measured[part], marker, color=color, markersize=4, alpha=0.7, label=label)
        axes.set_xlim(0, most)
        axes.set_ylim(min(0.0, float(measured.min())), most)
        axes.set_aspect("equal")
        axes.set_xlabel("true depth (% of the wall)")
        axes.set_ylabel("measured depth (% of the wall)")
        axes.set_title("Unity plot of depth")
        axes.legend(loc="lower right")
        part_shown = f", {shown.size} of them drawn" if shown.size < true.size else ""
        return to_picture(
            figure,
            "Measured over true depth in per cent of the wall, with the tolerance band",
            f"{true.size} features{part_shown}; features that were missed are not here.",
        )
