"""A plan held against itself: made again with another seed, and against fresh scans in pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from algorithms.trust.exact_bounds import Share, share_of
from scenarios.document import BadInput
from scenarios.fidelity.agreed import PICTURE
from scenarios.plan.findings import (
    Looks,
    Scans,
    all_detections,
    all_errors,
    all_tolerances,
    false_calls,
    read_scans,
    seen_share_pct,
    shown_by,
    shown_errors,
)
from scenarios.plan.plan_file import Plan
from scenarios.plan.scans import rows_of, scans_needed
from scenarios.plan.studies import CONFIRM, MAIN, studies_of, write_study
from scenarios.study.code import code_version
from scenarios.study.conduct import How, conduct, opened

FRESH_DRAW = 2  # the plan's own scans are draw 0, those that confirm it draw 1

Report = Callable[[str, int, int], None]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Estimate:
    """A figure with its two-sided interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Again:
    """One figure of a plan, and of the same plan with another seed."""

    what: str
    first: Estimate
    second: Estimate

    @property
    def agree(self) -> bool:
        """Whether the two are no further apart than their intervals together allow."""
        lower, upper = sorted((self.first, self.second), key=lambda one: one.value)
        return bool(upper.value - lower.value <= np.hypot(lower.high - lower.value, upper.value - upper.low))


@dataclass(frozen=True)
class Fresh:
    """How many of fresh scans in pictures lie inside what the plan promises for a share of all."""

    what: str
    promised: float
    asked: float
    inside: Share

    @property
    def kept(self) -> bool:
        """Whether the fresh scans do not refute the promise."""
        return self.inside.high >= self.asked


def made_again(plan: Plan, folder: Path, seed: int, how: How, progress: Report, say: Say) -> list[Again]:
    """Make a plan's scans with another seed, and hold every figure that it promises against its own.

    Raises:
        BadInput: when the plan was not made yet, or by other code, or the seed is its own.
    """
    if seed == plan.file.seed:
        raise BadInput([f"--again: got {seed}, the plan's own seed; take another"])
    first = _made(plan, folder)
    second = replace(plan, file=plan.file.model_copy(update={"seed": seed}))
    own = folder / f"again-{seed}"
    own.mkdir(exist_ok=True)
    studies = studies_of(second, scans_needed(second), 0)
    for name in (MAIN, CONFIRM):
        if name in studies:
            conduct(write_study(second, own / f"{name}.yaml", *studies[name]), own / name, how, progress, say)
    both = [_figures(plan, *scans, _found_from(plan, first)) for scans in (first, _read(second, own))]
    return [Again(what, both[0][what], both[1][what]) for what in both[0] if what in both[1]]


def fresh_pictures(plan: Plan, folder: Path, scans: int, how: How, progress: Report, say: Say) -> list[Fresh]:
    """Make scans in pictures that no figure of the plan rests on, and count how many keep what it promises.

    Raises:
        BadInput: when the plan was not made yet, or by other code.
    """
    first = _made(plan, folder)
    file = folder / f"fresh-{scans}.yaml"
    study = write_study(plan, file, {"sensing.fidelity": PICTURE}, rows_of(plan, scans, FRESH_DRAW))
    conduct(study, folder / file.stem, how, progress, say)
    return [one for one in _inside(plan, first, read_scans(folder / file.stem, plan)) if one.inside.n]


def _inside(plan: Plan, first: tuple[Scans, Scans | None], fresh: Scans) -> Iterator[Fresh]:
    values = all_errors(plan, fresh)
    for one in all_tolerances(plan, *first):
        errors = np.abs(values[one.what][np.isfinite(values[one.what])])
        if one.promised is not None:
            inside = share_of(int((errors <= one.promised).sum()), errors.size)
            yield Fresh(one.what, one.promised, plan.file.share, inside)
    for kind, from_pct in _found_from(plan, first).items():
        yield Fresh(f"found, {kind}, % of the wall and deeper", from_pct, 0.9, _found(fresh.looks, kind, from_pct))


def _made(plan: Plan, folder: Path) -> tuple[Scans, Scans | None]:
    """The scans that a plan stands on.

    Raises:
        BadInput: when there are none, or other code made them.
    """
    if not (folder / "plan.json").is_file():
        raise BadInput([f"{folder}: holds no plan; `pipetwin plan {plan.path} -o {folder}` makes it"])
    with opened(folder / MAIN) as ledger:
        code = ledger.about("identity")["code"]
    if code != code_version():
        raise BadInput([f"{folder}: was made by other code ({code}, now {code_version()}); make the plan again"])
    return _read(plan, folder)


def _read(plan: Plan, folder: Path) -> tuple[Scans, Scans | None]:
    pictures = read_scans(folder / CONFIRM, plan) if plan.file.confirm else None
    return read_scans(folder / MAIN, plan), pictures


def _found_from(plan: Plan, scans: tuple[Scans, Scans | None]) -> dict[str, float]:
    """By kind: the depth from which on the plan promises detection, where it does."""
    return {one.kind: one.a90_95_pct for one in all_detections(plan, *scans) if one.a90_95_pct is not None}


def _found(looks: Looks, kind: str, from_pct: float) -> Share:
    own = looks.of(kind)
    deep = own.depth_pct >= from_pct
    return share_of(int((own.hit & deep).sum()), int(deep.sum()))


def _figures(plan: Plan, scans: Scans, pictures: Scans | None, found_from: dict[str, float]) -> dict[str, Estimate]:
    """Every promised figure with its interval."""
    file = plan.file
    figures: dict[str, Estimate] = {}
    for what, (values, _) in shown_errors(plan, scans, pictures).items():
        ordered = np.sort(np.abs(values[np.isfinite(values)]))
        if ordered.size:
            figures[f"{what}, {100 * file.share:g} % within"] = quantile(ordered, file.share, file.confidence)
    seen_in, _ = shown_by(plan, "a90_95_pct", scans, pictures)
    for kind, from_pct in found_from.items():
        share = _found(seen_in.looks, kind, from_pct)
        figures[f"found, {kind} from {from_pct:.3g} % of the wall on, %"] = Estimate(
            100 * share.share, 100 * share.low, 100 * share.high
        )
    rate = false_calls(plan, shown_by(plan, "false_calls_per_m", scans, pictures)[0])
    figures["false calls a metre"] = Estimate(rate.per_m, rate.low_per_m, rate.high_per_m)
    seen = seen_share_pct(shown_by(plan, "seen_share_pct", scans, pictures)[0])
    if seen.half is not None:
        figures["seen, % of the wall"] = Estimate(seen.mean, seen.mean - seen.half, seen.mean + seen.half)
    return figures


def quantile(ordered: Float[np.ndarray, "n"], share: float, confidence: float) -> Estimate:
    """A quantile with its two-sided, distribution-free interval, by order statistics; without end where n is small."""
    from scipy.stats import binom

    low, high = (int(binom.ppf(p, ordered.size, share)) for p in ((1 - confidence) / 2, (1 + confidence) / 2))
    ends = np.concatenate([[0.0], ordered, [np.inf]])  # of sizes of errors
    return Estimate(float(np.quantile(ordered, share)), float(ends[low]), float(ends[high + 1]))
