"""What an examination of a log says: a verdict word, the figure behind it, and what it means for the result."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

Verdict = Literal["good", "weak", "bad"]
WORST: tuple[Verdict, ...] = ("bad", "weak", "good")


class Finding(NamedTuple):
    """One thing looked at; `means` says what follows for the result, and is empty where nothing does."""

    part: str
    name: str
    verdict: Verdict
    says: str
    means: str = ""


def finding(part: str, name: str, says: str, weak: bool | np.bool_, bad: bool | np.bool_, means: str) -> Finding:
    """A finding by two limits; what it means is said only where it is not good."""
    verdict: Verdict = "bad" if bad else "weak" if weak else "good"
    return Finding(part, name, verdict, says, "" if verdict == "good" else means)


def worst(findings: list[Finding]) -> Verdict:
    """The verdict on the whole log."""
    given = {one.verdict for one in findings}
    return next((verdict for verdict in WORST if verdict in given), "good")
