"""The cheap fidelities against pictures: the same scenarios and seeds, score by score, and where they agree."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from scenarios.document import BadInput
from scenarios.fidelity.agreed import PICTURE
from scenarios.provenance import versions
from scenarios.run_folder import whole_file
from scenarios.study.conduct import How, conduct, opened
from scenarios.study.gather import mean_of
from scenarios.study.ledger import DONE, STATES
from scenarios.study.study import save_study

SPREADS = 2.0  # within so many standard deviations from seed to seed, a seed does more than the fidelity
SHORTEST_S = 1e-3
NEVER_COMPARED = {"ms_per_frame"}

Report = Callable[[str, int, int], None]
Say = Callable[[str], None]
Verdict = Literal["agrees", "differs", "open"]


@dataclass(frozen=True)
class Compared:
    """One score of one scenario in a cheap fidelity against pictures, paired by seed."""

    scenario: str
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
    verdict: Verdict


@dataclass(frozen=True)
class Cost:
    """Seconds of one run, median, and how many times cheaper it is than in pictures."""

    scenario: str
    fidelity: str
    run_s: float
    cheaper: float


def compare(
    bases: list[str], fidelities: list[str], seeds: int, noise: str, out: Path, how: How, progress: Report, say: Say
) -> tuple[list[Compared], list[Cost]]:
    """Run every scenario in every fidelity with the same seeds, and write what agrees.

    Raises:
        BadInput: when a scenario is none, or too few seeds are left to compare.
    """
    from scenarios.fidelity.page import write_page

    out.mkdir(parents=True, exist_ok=True)
    found: list[Compared] = []
    costs: list[Cost] = []
    for base in bases:
        study, folder = _study(base, [*fidelities, PICTURE], seeds, noise, out)
        say(f"{base}: {len(fidelities) + 1} fidelities x {seeds} seeds")
        conduct(study, folder, how, progress, say)
        names, scores, seconds = _scores(folder)
        for fidelity in fidelities:
            found += [
                _compared(base, fidelity, name, scores[fidelity][:, k], scores[PICTURE][:, k])
                for k, name in enumerate(names)
                if name not in NEVER_COMPARED
            ]
            costs.append(Cost(base, fidelity, seconds[fidelity], seconds[PICTURE] / seconds[fidelity]))
    _write(out, found, costs, noise)
    write_page(out / "fidelity.html", found, costs, noise)
    return found, costs


def trusted(found: list[Compared], fidelity: str) -> list[str]:
    """Scores that agree in every scenario where they were compared."""
    own = [one for one in found if one.fidelity == fidelity]
    return [name for name in _in_order(own) if all(one.verdict == "agrees" for one in own if one.score == name)]


def _in_order(found: list[Compared]) -> list[str]:
    return list(dict.fromkeys(one.score for one in found))


def _study(base: str, fidelities: list[str], seeds: int, noise: str, out: Path) -> tuple[Path, Path]:
    file = Path(base)
    name = file.stem
    document = {
        "name": name,
        "why": "The same seeds in every fidelity.",
        "base": str(file.resolve()) if file.is_file() else base,
        "set": {"sensing.points": noise},
        "factors": {"sensing.fidelity": fidelities},
        "design": {"kind": "grid", "seeds": seeds},
    }
    study = out / f"{name}.yaml"
    save_study(document, study)
    return study, out / name


def _scores(folder: Path) -> tuple[list[str], dict[str, Float[np.ndarray, "seeds scores"]], dict[str, float]]:
    """Names of the scores; each fidelity's by seed, NaN where there is none; and the median seconds of its runs."""
    values: dict[str, dict[int, list[Any]]] = {}
    seconds: dict[str, list[float]] = {}
    with opened(folder) as ledger:
        names = ledger.about("identity")["record"]
        for row in ledger.rows(by_key=False):
            (fidelity,) = row.values
            whole = row.state == STATES[DONE]
            values.setdefault(fidelity, {})[row.seed] = row.figures if whole else [None] * len(names)
            seconds.setdefault(fidelity, []).extend(
                [max(row.seconds, SHORTEST_S)] if whole and row.seconds is not None else []
            )
    if empty := [name for name, spent in seconds.items() if not spent]:
        raise BadInput([f"{folder}: no run in {', '.join(empty)} ended well; `pipetwin status {folder}` says why"])
    tables = {name: np.array([rows[seed] for seed in sorted(rows)], dtype=float) for name, rows in values.items()}
    return names, tables, {name: float(np.median(spent)) for name, spent in seconds.items()}


def _compared(base: str, fidelity: str, name: str, cheap: np.ndarray, dear: np.ndarray) -> Compared:
    mean = mean_of(cheap - dear)
    there = dear[np.isfinite(dear)]
    spread = float(there.std(ddof=1)) if there.size > 1 else float("nan")
    center = float(there.mean()) if there.size else float("nan")
    half = float("nan") if mean.half is None else mean.half
    verdict = verdict_of(mean.mean, half, spread)
    return Compared(Path(base).stem, fidelity, name, center, spread, mean.mean, half, mean.n, verdict)


def verdict_of(difference: float, half: float, spread: float) -> Verdict:
    """Whether a difference lies within the seed-to-seed spread, beyond it, or cannot be told yet."""
    within = SPREADS * spread
    if abs(difference) + half <= within:
        return "agrees"
    return "differs" if abs(difference) - half > within else "open"


def _write(out: Path, found: list[Compared], costs: list[Cost], noise: str) -> None:
    fidelities = list(dict.fromkeys(one.fidelity for one in found))
    data = {
        "version": versions()["pipetwin"],
        "noise": noise,
        "seeds": max(one.n for one in found),
        "spreads": SPREADS,
        "trusted": {name: trusted(found, name) for name in fidelities},
        "costs": [asdict(cost) for cost in costs],
    }
    with whole_file(out / "fidelity.json") as work:
        work.write_text(json.dumps(data, indent=2) + "\n")
    with whole_file(out / "fidelity.csv") as work, work.open("w", newline="") as text:
        rows = csv.DictWriter(text, list(asdict(found[0])))
        rows.writeheader()
        rows.writerows(asdict(one) for one in found)
