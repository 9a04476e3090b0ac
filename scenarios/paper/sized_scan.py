"""One scenario scanned and sized, with its scan and its score kept in memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from algorithms.reconstruct import finish
from algorithms.types import Defect, Reconstruction
from scenarios.bench.scans import Scan, take_scan
from scenarios.matching import match
from scenarios.run import RunFailed, fold
from scenarios.scenario import Scenario
from scenarios.score import Score, score
from twin.features.base import Feature

Report = Callable[[str, int, int], None]


class SizedScan(NamedTuple):
    """What one drive gave."""

    scan: Scan
    found: Reconstruction
    score: Score

    def pairs(self) -> list[tuple[Feature, Defect]]:
        """True features in order, each with the defect that was made of it; those that were missed are left out."""
        pipe = self.scan.truth.pipe
        return [(pipe.features[i], self.found.defects[j]) for i, j in sorted(match(pipe, self.found.defects))]

    def first(self) -> tuple[Feature, Defect]:
        """The pipe's first feature and the defect that was made of it.

        Raises:
            RunFailed: when it was missed.
        """
        feature = self.scan.truth.pipe.features[0]
        for own, defect in self.pairs():
            if own is feature:
                return feature, defect
        raise RunFailed(f"the defect at {feature.distance_mm} mm was not found")


def sized_scan(scenario: Scenario, workers: int, progress: Report) -> SizedScan:
    """Drive, sense, measure, score.

    Raises:
        RunFailed: when a stage fails.
    """
    scan = take_scan(scenario, workers, progress)
    state, tally = fold(scenario, scan.truth, scan.recording, scan.seen)
    try:
        found = finish(state)
    except RuntimeError as error:
        raise RunFailed(f"{scenario.name}: {error}") from error
    return SizedScan(scan, found, score(found, scan.truth, tally))
