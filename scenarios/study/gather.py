"""A study's rows as numbers to look at: figures by method and factor, paired differences, sizes of defects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from scenarios.study.ledger import DONE, STATES, Ledger

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
SIZED = 6  # of a defect that was found: three true sizes and three measured ones


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
    counts, number = ledger.counts(), {name: i for i, name in enumerate(methods)}
    n = counts["done"]
    figures = np.full((n, len(names)), np.nan)
    method, pair = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    values: dict[str, list[Any]] = {path: [] for path in paths}
    pairs: dict[tuple[int, int], int] = {}
    sizes: list[list[float]] = []
    measured_by: list[int] = []
    # row by row into arrays: a million rows as Python's numbers would take gigabytes
    done = (row for row in ledger.rows(by_key=False) if row.state == STATES[DONE])
    for i, row in enumerate(done):
        figures[i] = [np.nan if value is None else value for value in row.figures]
        method[i], pair[i] = number[row.method], pairs.setdefault((row.point, row.seed), len(pairs))
        for path, value in zip(paths, row.values, strict=True):
            values[path].append(value)
        found = [one for one in row.defects if len(one) == SIZED]
        sizes += found
        measured_by += [number[row.method]] * len(found)
    defects = np.array(sizes, dtype=float).reshape(-1, SIZED)
    by = np.array(measured_by, dtype=np.int64)
    return Gathered(methods, paths, names, counts, method, pair, values, figures, defects, by)


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
