"""Which points of the factors' space are run: a grid, a hypercube, a Sobol sequence or Saltelli's pairs; over seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from math import prod
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from scenarios.study.factors import Factor
from sensor_model.settings import Settings

MOST_POINTS = 10_000_000
MOST_SEEDS = 100_000


def _counted(value: Any) -> Any:
    """A number of seeds as the seeds from 0 on."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    return tuple(range(value)) if whole and 0 <= value <= MOST_SEEDS else value


Seed = Annotated[int, Field(ge=0, lt=2**63)]
Seeds = Annotated[
    tuple[Seed, ...],
    BeforeValidator(_counted, json_schema_input_type=int | list[int]),
    Field(min_length=1, max_length=MOST_SEEDS),
]


class _Replicated(Settings):
    seeds: Seeds | None = None
    """How many seeds, or which; every point is run with each. Left out: the base scenario's."""

    @model_validator(mode="after")
    def _no_seed_twice(self) -> _Replicated:
        if self.seeds is not None and len(set(self.seeds)) < len(self.seeds):
            raise ValueError("every seed may stand once")
        return self


class Grid(_Replicated):
    """Every combination of the factors' levels."""

    kind: Literal["grid"] = "grid"


class LatinHypercube(_Replicated):
    """Points spread so that each factor's range is evenly covered, however few they are."""

    kind: Literal["latin-hypercube"] = "latin-hypercube"
    points: Annotated[int, Field(ge=1, le=MOST_POINTS)]
    draw_seed: Seed = 0


class _Balanced(_Replicated):
    points: Annotated[int, Field(ge=1, le=MOST_POINTS)]
    draw_seed: Seed = 0

    @model_validator(mode="after")
    def _power_of_two(self) -> _Balanced:
        if self.points & (self.points - 1):
            below = 1 << self.points.bit_length() - 1
            raise ValueError(f"points must be a power of 2 to be balanced; {below} and {2 * below} are near")
        return self


class Sobol(_Balanced):
    """A scrambled Sobol sequence, evenly spread in all factors at once."""

    kind: Literal["sobol"] = "sobol"


class Saltelli(_Balanced):
    """What Sobol's indices need: `points` pairs A and B, and each A again with one factor of B, for every factor.

    In this order: all A, all B, then A with B's first factor, and so on; (factors + 2) x `points` in all.
    Source: Saltelli et al., Computer Physics Communications 181 (2010) 259.
    """

    kind: Literal["saltelli"] = "saltelli"


class Rows(_Replicated):
    """The first values of all factors together, then the second, and so on: lists of one length, as rows of a table."""

    kind: Literal["rows"] = "rows"


Design = Grid | LatinHypercube | Sobol | Saltelli | Rows
DESIGNS: dict[str, type[Grid] | type[LatinHypercube] | type[Sobol] | type[Saltelli] | type[Rows]] = {
    "grid": Grid,
    "rows": Rows,
    "latin-hypercube": LatinHypercube,
    "sobol": Sobol,
    "saltelli": Saltelli,
}


def point_count(design: Design, factors: Sequence[Factor]) -> int:
    """How many points a design has."""
    if isinstance(design, Grid):
        return prod(len(factor.levels() or ()) for factor in factors)
    if isinstance(design, Rows):
        return len(factors[0].levels() or ())
    return design.points * (len(factors) + 2 if isinstance(design, Saltelli) else 1)


def points(design: Design, factors: Sequence[Factor]) -> Iterator[tuple[Any, ...]]:
    """The design's points: a value for every factor. The same design gives the same points in the same order."""
    if isinstance(design, Grid):
        return product(*(factor.levels() or () for factor in factors))
    if isinstance(design, Rows):
        return zip(*(factor.levels() or () for factor in factors), strict=True)
    unit = _unit(design, len(factors))
    return zip(*(factor.at(column) for factor, column in zip(factors, unit.T, strict=True)), strict=True)


def _unit(design: LatinHypercube | Sobol | Saltelli, dimensions: int) -> np.ndarray:
    from scipy.stats import qmc

    rng = np.random.default_rng(design.draw_seed)
    if isinstance(design, LatinHypercube):
        return qmc.LatinHypercube(dimensions, rng=rng).random(design.points)
    doublings = design.points.bit_length() - 1
    if isinstance(design, Sobol):
        return qmc.Sobol(dimensions, rng=rng).random_base2(doublings)
    pairs = qmc.Sobol(2 * dimensions, rng=rng).random_base2(doublings)
    a, b = pairs[:, :dimensions], pairs[:, dimensions:]
    mixed = [np.where(np.arange(dimensions) == i, b, a) for i in range(dimensions)]
    return np.vstack([a, b, *mixed])
