"""A study's rows as numbers to look at: figures by method and factor, paired differences, sizes of defects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from scenarios.study.ledger import STATES, Ledger

MOST_LEVELS = 8
BINS = 6
CONFIDENCE = 0.95
LEADING = (
    "depth_error_mm_max",
    "length_error_mm_max",
    "width_error_mm_max",
    "center_rms_mm",
    "roll_rms_deg",
    "false_calls",
    "defects_found",
)
MOST_LEADING = 4


class Mean(NamedTuple):
    """A mean with the half width of its 95 % interval (None with fewer than two values), and of how many."""

    mean: float
    half: float | None
    n: int


class Level(NamedTuple):
    """One level of a factor, or one bin of it: what it is called, where it lies, and which runs have it."""

    name: str
    place: float
    runs: Bool[np.ndarray, "n"]


@dataclass(frozen=True)
class Gathered:
    """All runs that are done, a row a run."""

    methods: tuple[str, ...]
    paths: tuple[str, ...]
    names: tuple[str, ...]
    counts: dict[str, int]
    method: Int[np.ndarray, "n"]
    pair: Int[np.ndarray, "n"]
    values: dict[str, list[Any]]
    figures: Float[np.ndarray, "n figures"]
    defects: Float[np.ndarray, "d 6"]
    defect_method: Int[np.ndarray, "d"]

    @property
    def leading(self) -> list[str]:
        """The figures worth a picture."""
        return ([name for name in LEADING if name in self.names] or list(self.names))[:MOST_LEADING]

    def column(self, name: str) -> Float[np.ndarray, "n"]:
        """One figure of every run, NaN where the run has none."""
        return self.figures[:, self.names.index(name)]


def gather(ledger: Ledger) -> Gathered:
    """Read all that is done."""
    identity = ledger.about("identity")
    methods, paths, names = tuple(ledger.about("methods")), tuple(identity["paths"]), tuple(identity["record"])
    done = [row for row in ledger.rows(by_key=False) if row.state == STATES[2]]
    number = {name: i for i, name in enumerate(methods)}
    pairs: dict[tuple[int, int], int] = {}
    nan = float("nan")
    figures = [[nan if v is None else float(v) for v in row.figures] for row in done]
    sizes = [(number[row.method], defect) for row in done for defect in row.defects]
    return Gathered(
        methods,
        paths,
        names,
        ledger.counts(),
        np.array([number[row.method] for row in done], dtype=np.int64),
        np.array([pairs.setdefault((row.point, row.seed), len(pairs)) for row in done], dtype=np.int64),
        {path: [row.values[k] for row in done] for k, path in enumerate(paths)},
        np.array(figures, dtype=float).reshape(-1, len(names)),
        np.array([defect for _, defect in sizes], dtype=float).reshape(-1, 6),
        np.array([method for method, _ in sizes], dtype=np.int64),
    )


def mean_of(values: Float[np.ndarray, "n"]) -> Mean:
    """The mean of what is there, with Student's interval."""
    there = values[np.isfinite(values)]
    n = there.size
    if n == 0:
        return Mean(float("nan"), None, 0)
    if n == 1:
        return Mean(float(there[0]), None, 1)
    from scipy.stats import t

    half = float(t.ppf(0.5 + CONFIDENCE / 2, n - 1) * there.std(ddof=1) / np.sqrt(n))
    return Mean(float(there.mean()), half, n)


def paired(found: Gathered, name: str, method: int, against: int = 0) -> Mean:
    """Mean difference of a figure between two methods over the scans that both measured."""
    values = found.column(name)
    count = int(found.pair.max(initial=-1)) + 1
    both = np.full((2, count), np.nan)
    for row, which in enumerate((method, against)):
        own = found.method == which
        both[row, found.pair[own]] = values[own]
    return mean_of(both[0] - both[1])


def levels(found: Gathered, path: str) -> list[Level]:
    """A factor's levels; one with many numbers in bins of equal content."""
    values = found.values[path]
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    column = np.array(values, dtype=float) if numbers else np.array([repr(v) for v in values])
    each = np.unique(column)
    if numbers and each.size > MOST_LEVELS:
        return _bins(column)
    places = each if numbers else np.arange(each.size)
    names = [f"{v:g}" if numbers else _short(str(v)) for v in each]
    return [Level(name, float(at), column == v) for name, at, v in zip(names, places, each, strict=True)]


def _bins(column: Float[np.ndarray, "n"]) -> list[Level]:
    edges = np.quantile(column, np.linspace(0, 1, BINS + 1))
    which = np.clip(np.searchsorted(edges, column, side="right") - 1, 0, BINS - 1)
    return [
        Level(f"{edges[i]:.3g} to {edges[i + 1]:.3g}", float(np.median(column[which == i])), which == i)
        for i in range(BINS)
        if (which == i).any()
    ]


def _short(text: str) -> str:
    return text if len(text) <= 24 else text[:21] + "..."
