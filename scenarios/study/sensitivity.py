"""What hurts what: Sobol's indices of each score over a study's factors, with their intervals."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scenarios.document import BadInput
from scenarios.run_folder import whole_file
from scenarios.study.conduct import How, conduct, opened
from scenarios.study.design import Saltelli
from scenarios.study.ledger import DONE, STATES
from scenarios.study.plan import planned_runs, recipe_of
from scenarios.study.study import Study, load_study

CONFIDENCE = 0.95
RESAMPLES = 1000
FEWEST_PAIRS = 8
LEAST_SPREAD = 1e-12  # of a score, in units of its size: what varies less does not vary

Report = Callable[[str, int, int], None]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Indices:
    """One score's share of variance by cause: alone (first), and with all that it takes part in (total).

    Each of `first` and `total` has a row a cause: value, and the ends of its 95 % interval (bootstrap over pairs).
    """

    score: str
    mean: float
    std: float
    pairs: int
    first: Float[np.ndarray, "causes 3"]
    total: Float[np.ndarray, "causes 3"]


@dataclass(frozen=True)
class Sensitivity:
    """Indices of every score that varies, and the names of those that do not, with why."""

    causes: tuple[str, ...]
    scores: tuple[Indices, ...]
    left_out: dict[str, str]
    counts: dict[str, int]


def sensitivity(file: Path, out: Path | None, how: How, progress: Report, say: Say) -> tuple[Path, Sensitivity]:
    """Run what is left of a study of Saltelli's design, and write its indices beside its ledger.

    Raises:
        BadInput: when the study is of another design, or has too few pairs that are whole.
    """
    from scenarios.study.sensitivity_page import write_page

    study = load_study(file)
    design = study.design
    if not isinstance(design, Saltelli) or len(study.methods) > 1 or len(study.seeds) > 1:
        wanted = "needs `design: {kind: saltelli, points: 2^k}`, one method and one seed (or `seed` among the factors)"
        raise BadInput([f"{file}: design: got {design.kind}, {len(study.methods)} methods: {wanted}"])
    say(f"{design.points} pairs x ({len(study.factors)} causes + 2) = {study.planned} runs at most")
    folder, counts = conduct(file, out, how, progress, say)
    found = indices_of(study, folder, counts)
    with whole_file(folder / "sensitivity.json") as work:
        work.write_text(json.dumps(as_json(found, study), indent=2) + "\n")
    with whole_file(folder / "sensitivity.csv") as work, work.open("w", newline="") as text:
        csv.writer(text).writerows(rows(found))
    write_page(folder / "sensitivity.html", study, found)
    return folder, found


def indices_of(study: Study, folder: Path, counts: dict[str, int]) -> Sensitivity:
    """Indices of every recorded score of a study that is done.

    Raises:
        BadInput: when too few pairs have all their runs.
    """
    with opened(folder) as ledger:
        identity = ledger.about("identity")
        done = {row.key: row.figures for row in ledger.rows() if row.state == STATES[DONE]}
    nothing = [None] * len(study.record)
    runs = planned_runs(study, recipe_of(study, identity["code"]))
    figures = np.array([done.get(run.key, nothing) for run in runs], dtype=float)
    blocks = figures.reshape(len(study.factors) + 2, -1, len(study.record))
    scores, left_out = [], {}
    for name, column in zip(study.record, np.moveaxis(blocks, -1, 0), strict=True):
        whole = np.isfinite(column).all(axis=0)
        if whole.sum() < FEWEST_PAIRS:
            left_out[name] = f"only {whole.sum()} of {whole.size} pairs have it in all their runs"
        elif np.ptp(column[:2, whole]) <= LEAST_SPREAD * np.abs(column[:2, whole]).max():
            left_out[name] = "does not vary"
        else:
            scores.append(_indices(name, column[:, whole]))
    if not scores and all(reason.startswith("only") for reason in left_out.values()):
        raise BadInput([f"{folder}: no score has {FEWEST_PAIRS} whole pairs; `pipetwin status` says which runs failed"])
    return Sensitivity(tuple(study.factors), tuple(scores), left_out, counts)


def _indices(name: str, values: Float[np.ndarray, "blocks pairs"]) -> Indices:
    """Indices of one score, its values in the blocks of Saltelli's design."""
    first, total = shares(values)
    rng, n = np.random.default_rng(0), values.shape[1]
    drawn = np.array([shares(values[:, rng.integers(n, size=n)]) for _ in range(RESAMPLES)])
    low, high = np.nanquantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    sample = values[:2].ravel()
    return Indices(
        name,
        float(sample.mean()),
        float(sample.std(ddof=1)),
        n,
        np.stack([first, low[0], high[0]], axis=1),
        np.stack([total, low[1], high[1]], axis=1),
    )


def shares(values: Float[np.ndarray, "blocks pairs"]) -> Float[np.ndarray, "2 causes"]:
    """First and total index of every cause: the estimators of Saltelli et al. 2010, Table 2 (b) and (f).

    NaN where nothing varies.
    """
    a, b, mixed = values[0] - values[:2].mean(), values[1] - values[:2].mean(), values[2:] - values[:2].mean()
    variance = values[:2].var()
    if variance == 0:
        return np.full((2, len(mixed)), np.nan)
    first = (b * (mixed - a)).mean(axis=1) / variance
    total = 0.5 * ((a - mixed) ** 2).mean(axis=1) / variance
    return np.stack([first, total])


def as_json(found: Sensitivity, study: Study) -> dict:
    """The indices as plain data."""

    def ends(row: Float[np.ndarray, "3"]) -> list[float]:
        return [float(v) for v in row]

    scores = {
        one.score: {
            "mean": one.mean,
            "std": one.std,
            "pairs": one.pairs,
            "causes": {
                cause: {"first": ends(one.first[i]), "total": ends(one.total[i])}
                for i, cause in enumerate(found.causes)
            },
        }
        for one in found.scores
    }
    about = {"study": study.name, "pairs": study.design.model_dump()["points"], "runs": found.counts}
    return {**about, "confidence": CONFIDENCE, "scores": scores, "left_out": found.left_out}


def rows(found: Sensitivity) -> list[list[str | float | int]]:
    """A row a score and cause, under a head."""
    kinds = [f"{kind}{end}" for kind in ("first", "total") for end in ("", "_low", "_high")]
    table: list[list[str | float | int]] = [["score", "cause", *kinds, "pairs"]]
    for one in found.scores:
        for i, cause in enumerate(found.causes):
            table.append([one.score, cause, *one.first[i].tolist(), *one.total[i].tolist(), one.pairs])
    return table
