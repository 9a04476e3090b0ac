"""In which scores a cheap fidelity agrees with pictures: the comparisons that are shipped, by their noise."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from scenarios.scenario import Scenario
from sensor_model.sense import Sensing

FOLDER = Path(__file__).parent / "agreed"
PICTURE = "picture"
SPREADS = 2.0  # within so many standard deviations from seed to seed, a seed does more than the fidelity
SAME_BORE = 0.1  # of the radius: slits that fall on nearly the same places

Verdict = Literal["agrees", "differs", "open"]


@dataclass(frozen=True)
class Compared:
    """One score of one scenario in a cheap fidelity against pictures, paired by seed."""

    fidelity: str
    score: str
    mean: float
    """Of the pictures."""
    spread: float
    """From seed to seed in pictures, one standard deviation."""
    difference: float
    half: float
    """Of the difference's 95 % interval."""
    n: int

    @property
    def verdict(self) -> Verdict:
        """By itself."""
        return verdict_of(self.difference, self.half, self.spread)


@dataclass(frozen=True)
class Cost:
    """Seconds of one run, median, and how many times cheaper it is than in pictures."""

    fidelity: str
    run_s: float
    cheaper: float


@dataclass(frozen=True)
class Comparison:
    """One scenario in every fidelity on the same seeds: what was run, by which code, and what came of it."""

    scenario: str
    seeds: int
    version: str
    code: str
    changes: dict[str, Any]
    """What was set in all fidelities to make its pictures affordable."""
    optics: dict[str, Any]
    bore_radius_mm: float
    costs: list[Cost]
    scores: list[Compared]


def verdict_of(difference: float, half: float, spread: float) -> Verdict:
    """Whether a difference lies within the seed-to-seed spread, beyond it, or cannot be told yet."""
    within = SPREADS * spread
    if abs(difference) + half <= within:
        return "agrees"
    return "differs" if abs(difference) - half > within else "open"


def trusted(comparisons: Iterable[Comparison], fidelity: str) -> list[str]:
    """Scores that agree over these scenarios taken together, and differ in none of them."""
    rows: dict[str, list[Compared]] = {}
    for one in (score for comparison in comparisons for score in comparison.scores):
        if one.fidelity == fidelity and one.n:
            rows.setdefault(one.score, []).append(one)
    return [score for score, own in rows.items() if _together(own) == "agrees"]


def _together(rows: list[Compared]) -> Verdict:
    """The verdict on the mean difference over several scenarios; one scenario that differs decides."""
    if any(one.verdict == "differs" for one in rows):
        return "differs"
    difference, half, spread = np.array([(one.difference, one.half, one.spread) for one in rows]).T
    return verdict_of(float(difference.mean()), float(np.linalg.norm(half)) / len(rows), _root_mean_square(spread))


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def looks(comparisons: Iterable[Comparison]) -> list[list[Comparison]]:
    """Those of the same optics in bores of the same size together: they are trusted together."""
    groups: list[list[Comparison]] = []
    for one in comparisons:
        own = next((g for g in groups if _same_look(g[0], one.optics, one.bore_radius_mm)), None)
        if own is None:
            groups.append([one])
        else:
            own.append(one)
    return groups


def _same_look(one: Comparison, optics: dict[str, Any], bore_radius_mm: float) -> bool:
    return one.optics == optics and abs(bore_radius_mm / one.bore_radius_mm - 1) < SAME_BORE


def alike(scene: Scenario) -> list[Comparison]:
    """The shipped comparisons of scenarios of its noise, optics and bore; none where the noise is the scene's own."""
    for file in sorted(FOLDER.glob("*.json")):
        if scene.sensing.points == Sensing(optics=scene.sensing.optics, points=file.stem).points:
            found = read_comparisons(file)[1]
            return [one for one in found if _same_look(one, optics_of(scene), scene.pipe.bore_radius_mm)]
    return []


def optics_of(scene: Scenario) -> dict[str, Any]:
    """What a scene's optics are beside the default ones, as plain data."""
    found: dict[str, Any] = scene.sensing.optics.model_dump(mode="json", exclude_defaults=True)
    return found


def trusts(scene: Scenario, score: str) -> bool:
    """Whether a score of this scene needs no pictures: it is drawn in them, or its fidelity agreed with them in it."""
    return scene.sensing.fidelity == PICTURE or score in trusted(alike(scene), scene.sensing.fidelity)


def read_comparisons(file: Path) -> tuple[str, list[Comparison]]:
    """What `pipetwin fidelity` wrote as `fidelity.json`: the noise of `points`, and every comparison."""
    data = json.loads(file.read_text())
    found = [
        Comparison(
            **{
                **one,
                "costs": [Cost(**cost) for cost in one["costs"]],
                "scores": [Compared(**_numbers(row)) for row in one["scores"]],
            }
        )
        for one in data["scenarios"]
    ]
    return data["noise"], found


def _numbers(row: dict[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: what cannot be said is null there."""
    return {key: float("nan") if value is None else value for key, value in row.items()}


def compared_on(scene: Scenario) -> str:
    """Where the trust comes from, in words."""
    if scene.sensing.fidelity == PICTURE:
        return "all scans are in pictures"
    own = [one for one in alike(scene) if any(cost.fidelity == scene.sensing.fidelity for cost in one.costs)]
    if not own:
        return f"`{scene.sensing.fidelity}` with these settings was never compared with pictures"
    names = ", ".join(f"{one.scenario} ({one.seeds} seeds)" for one in own)
    versions = ", ".join(dict.fromkeys(f"{one.version}, code {one.code}" for one in own))
    return f"`{scene.sensing.fidelity}` against pictures in {names} (pipetwin {versions})"
