"""Uncertainty of a measured value: by propagation (GUM, JCGM 100) and by Monte Carlo (its Supplement 1, JCGM 101)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, isinf, log10, sqrt
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import norm
from scipy.stats import t as student

TINY = 1e-30
BLOCK = 100_000
Law = Literal["normal", "rectangular", "triangular", "arcsine"]
# half width of each law over its standard deviation (GUM 4.3.7, 4.3.9; JCGM 101, 6.4.6)
HALF_WIDTH = {"rectangular": sqrt(3.0), "triangular": sqrt(6.0), "arcsine": sqrt(2.0)}
Model = Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True)
class Source:
    """An input quantity: its estimate, standard uncertainty, degrees of freedom, and its law for Monte Carlo.

    A normal law with few degrees of freedom is drawn as Student's t, as JCGM 101 asks of a mean of few readings;
    for the other laws they say how well the half width is known (GUM G.4.2), and only propagation uses them.
    """

    name: str
    value: float
    u: float
    degrees_of_freedom: int | float = inf
    law: Law = "normal"

    def __post_init__(self) -> None:
        if not (isfinite(self.value) and isfinite(self.u) and self.u >= 0):
            raise ValueError(f"{self.name}: value {self.value} and uncertainty {self.u}; both finite, u at least 0")
        if not self.degrees_of_freedom > 0:
            raise ValueError(f"{self.name}: {self.degrees_of_freedom} degrees of freedom; more than 0 are needed")


class Part(NamedTuple):
    """What one source does: sensitivity, its contribution to the standard uncertainty, its share of the variance."""

    name: str
    sensitivity: float
    contribution: float
    variance_pct: float


class Budget(NamedTuple):
    """The measured value, its combined standard uncertainty, effective degrees of freedom, and its sources' parts."""

    value: float
    u: float
    degrees_of_freedom: float
    parts: tuple[Part, ...]

    def coverage_factor(self, coverage: float = 0.95) -> float:
        """Student's t for the effective degrees of freedom, rounded down (GUM G.4.1, Note 1)."""
        return coverage_factor(coverage, self.degrees_of_freedom)

    def expanded(self, coverage: float = 0.95) -> float:
        """The half width of the interval that is to hold the value with this coverage."""
        return self.coverage_factor(coverage) * self.u


class Draws(NamedTuple):
    """What Monte Carlo gives: mean, standard deviation, and the probabilistically symmetric interval."""

    value: float
    u: float
    low: float
    high: float
    coverage: float
    draws: int


class Comparison(NamedTuple):
    """How far the ends of two intervals lie apart, and may: half a unit of u's last digit (JCGM 101, 8.1)."""

    low_apart: float
    high_apart: float
    tolerance: float

    @property
    def agree(self) -> bool:
        """Whether propagation may be used in place of Monte Carlo."""
        return max(self.low_apart, self.high_apart) <= self.tolerance


def from_half_width(
    name: str, value: float, half_width: float, law: Law = "rectangular", degrees_of_freedom: int | float = inf
) -> Source:
    """A source known by limits only (GUM 4.3.7)."""
    return Source(name, value, half_width / HALF_WIDTH[law], degrees_of_freedom, law)


def from_readings(name: str, readings: Float[np.ndarray, "n"]) -> Source:
    """A source known by repeated readings: their mean, S / sqrt(n), n - 1 degrees of freedom (GUM 4.2, type A).

    Raises:
        ValueError: for fewer than two readings, or ones that are not finite.
    """
    if readings.size < 2 or not np.isfinite(readings).all():
        raise ValueError(f"{name}: {readings.size} readings; at least 2, all finite, are needed")
    return Source(name, float(readings.mean()), float(readings.std(ddof=1) / sqrt(readings.size)), readings.size - 1)


def coverage_factor(coverage: float, degrees_of_freedom: int | float = inf) -> float:
    """How many standard uncertainties hold the value with this coverage: Student's t, or the normal law's."""
    if not 0 < coverage < 1:
        raise ValueError(f"a coverage of {coverage} is not between 0 and 1")
    if isinf(degrees_of_freedom):
        return float(norm.ppf((1 + coverage) / 2))
    if degrees_of_freedom < 1:
        raise ValueError(f"{degrees_of_freedom:.3g} degrees of freedom are too few for a coverage factor")
    return float(student.ppf((1 + coverage) / 2, floor(degrees_of_freedom)))


def propagate(model: Model, sources: Sequence[Source]) -> Budget:
    """The law of propagation of uncertainty (GUM Eq. 10) with Welch-Satterthwaite degrees of freedom (Eq. G.2b).

    Sources are independent. `model` takes the values by name and must be made of plain arithmetic and numpy functions:
    sensitivities come from a complex step, exact to rounding.

    Raises:
        ValueError: for sources of one name, or a model that gives no finite number or cannot take a complex one.
    """
    names = [source.name for source in sources]
    if len(set(names)) < len(names) or not names:
        raise ValueError(f"sources need names, each another: {', '.join(names) or 'there are none'}")
    values: dict[str, Any] = {source.name: source.value for source in sources}
    value = float(model(values))
    sensitivities = [_sensitivity(model, values, name) for name in names]
    contributions = [abs(c) * source.u for c, source in zip(sensitivities, sources, strict=True)]
    if not (isfinite(value) and all(isfinite(part) for part in contributions)):
        raise ValueError("the model gives no finite value and sensitivities here")
    variance = sum(part**2 for part in contributions)
    u = sqrt(variance)  # GUM Eq. 10
    below = sum(part**4 / s.degrees_of_freedom for part, s in zip(contributions, sources, strict=True))
    freedom = u**4 / below if below > 0 else inf  # GUM Eq. G.2b
    parts = tuple(
        Part(name, c, part, 100 * part**2 / variance if variance else 0.0)
        for name, c, part in zip(names, sensitivities, contributions, strict=True)
    )
    return Budget(value, u, freedom, parts)


def _sensitivity(model: Model, values: Mapping[str, Any], name: str) -> float:
    try:
        stepped = model({**values, name: values[name] + 1j * TINY})
    except TypeError as error:
        raise ValueError(f"the model cannot take a complex {name}: {error}") from error
    moved = {**values, name: values[name] * (1 + 1e-6) + 1e-6}
    if not np.iscomplexobj(stepped) and model(moved) != model(values):
        raise ValueError(f"the model drops the complex part of {name} (as abs() does): no sensitivity can be had")
    return float(np.imag(stepped)) / TINY


def monte_carlo(
    model: Model, sources: Sequence[Source], rng: np.random.Generator, draws: int = 1_000_000, coverage: float = 0.95
) -> Draws:
    """Propagation of distributions (JCGM 101, clause 7): the model at draws of its sources, block by block."""
    if draws < 1000:
        raise ValueError(f"{draws} draws are too few; at least 1000")
    blocks = [min(BLOCK, draws - start) for start in range(0, draws, BLOCK)]
    found = np.concatenate([np.asarray(model({s.name: _draw(s, rng, n) for s in sources})) for n in blocks])
    if not np.isfinite(found).all():
        raise ValueError("the model gives values that are not finite")
    low, high = np.quantile(found, [(1 - coverage) / 2, (1 + coverage) / 2])
    return Draws(float(found.mean()), float(found.std(ddof=1)), float(low), float(high), coverage, draws)


def _draw(source: Source, rng: np.random.Generator, n: int) -> Float[np.ndarray, "n"]:
    if source.law == "normal":
        few = isfinite(source.degrees_of_freedom)
        unit = rng.standard_t(source.degrees_of_freedom, n) if few else rng.standard_normal(n)
        return source.value + source.u * unit
    half = source.u * HALF_WIDTH[source.law]
    if source.law == "rectangular":
        return source.value + half * rng.uniform(-1, 1, n)
    if source.law == "triangular":
        return source.value + half * (rng.uniform(-0.5, 0.5, n) + rng.uniform(-0.5, 0.5, n))
    return source.value + half * np.sin(rng.uniform(0, 2 * np.pi, n))


def compare(budget: Budget, draws: Draws, digits: int = 2) -> Comparison:
    """Propagation against Monte Carlo (JCGM 101, 8.1.2 and 7.9.2), with so many digits of u taken to matter."""
    half = budget.expanded(draws.coverage)
    tolerance = 0.5 * 10.0 ** (floor(log10(budget.u)) - digits + 1) if budget.u > 0 else 0.0
    return Comparison(abs(budget.value - half - draws.low), abs(budget.value + half - draws.high), tolerance)
