"""What a factor's values are: a list, a range, or a distribution; each gives a value for a number between 0 and 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from sensor_model.settings import Settings

DIGITS = 9  # of a drawn value: the last bits of an inverse distribution differ between machines
MOST_LEVELS = 10_000


@runtime_checkable
class Factor(Protocol):
    """Values that one setting takes in a study."""

    def levels(self) -> tuple[Any, ...] | None:
        """The values of a grid; None where there are infinitely many."""

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """A value for each number between 0 and 1, by the inverse of the factor's distribution."""


@dataclass(frozen=True)
class Levels:
    """The values of a list, all equally likely."""

    values: tuple[Any, ...]

    def levels(self) -> tuple[Any, ...]:
        """The values."""
        return self.values

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """The value of the equal part that each number falls into."""
        index = np.minimum((unit * len(self.values)).astype(int), len(self.values) - 1)
        return [self.values[i] for i in index]


class _Interval(Settings):
    low: float
    high: float
    whole: bool = False
    """Only whole numbers."""

    @model_validator(mode="after")
    def _high_above_low(self) -> _Interval:
        if self.high <= self.low:
            raise ValueError(f"high must be above low, {self.low:g}")
        return self


class Range(_Interval):
    """Numbers from low to high: `steps` of them, or (in a sampled design) any between."""

    steps: Annotated[int, Field(ge=2, le=MOST_LEVELS)] | None = None
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _log_of_positive(self) -> Range:
        if self.scale == "log" and self.low <= 0:
            raise ValueError("on a log scale low must be above 0")
        return self

    def levels(self) -> tuple[Any, ...] | None:
        """So many steps, both ends among them."""
        if self.steps is None:
            return None
        return tuple(_plain(self._between(np.linspace(0, 1, self.steps)), self.whole))

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """A step, or a place between low and high."""
        levels = self.levels()
        return Levels(levels).at(unit) if levels is not None else _plain(self._between(unit), self.whole)

    def _between(self, share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        if self.scale == "log":
            return np.exp(np.log(self.low) + share * (np.log(self.high) - np.log(self.low)))
        return self.low + share * (self.high - self.low)


class _Endless(Settings):
    def levels(self) -> None:
        """A distribution has no levels."""
        return


class Uniform(_Endless, _Interval):
    """Every number between low and high equally likely."""

    distribution: Literal["uniform"] = "uniform"

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """The inverse of its distribution."""
        return _plain(self.low + unit * (self.high - self.low), self.whole)


class LogUniform(_Endless, _Interval):
    """Every ratio between low and high equally likely."""

    distribution: Literal["log-uniform"] = "log-uniform"
    low: Annotated[float, Field(gt=0)]

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """The inverse of its distribution."""
        return _plain(np.exp(np.log(self.low) + unit * np.log(self.high / self.low)), self.whole)


class Normal(_Endless):
    """Gauss's bell, cut off at low and high where they are given."""

    distribution: Literal["normal"] = "normal"
    mean: float
    std: Annotated[float, Field(gt=0)]
    low: float | None = None
    high: float | None = None
    whole: bool = False

    @model_validator(mode="after")
    def _high_above_low(self) -> Normal:
        if self.low is not None and self.high is not None and self.high <= self.low:
            raise ValueError(f"high must be above low, {self.low:g}")
        return self

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """The inverse of its distribution; five standard deviations out at most, where no end is given."""
        from scipy.special import ndtr, ndtri

        ends = [self.mean - 5 * self.std if self.low is None else self.low]
        ends += [self.mean + 5 * self.std if self.high is None else self.high]
        below, above = ndtr((np.array(ends) - self.mean) / self.std)
        drawn = self.mean + self.std * ndtri(below + unit * (above - below))
        return _plain(np.clip(drawn, ends[0], ends[1]), self.whole)


class Triangular(_Endless, _Interval):
    """Likeliest at mode, and linearly less so towards low and high."""

    distribution: Literal["triangular"] = "triangular"
    mode: float

    @model_validator(mode="after")
    def _mode_between(self) -> Triangular:
        if not self.low <= self.mode <= self.high:
            raise ValueError(f"mode must lie from {self.low:g} to {self.high:g}")
        return self

    def at(self, unit: Float[np.ndarray, "n"]) -> list[Any]:
        """The inverse of its distribution."""
        width, rise = self.high - self.low, self.mode - self.low
        left = self.low + np.sqrt(unit * width * rise)
        right = self.high - np.sqrt((1 - unit) * width * (width - rise))
        return _plain(np.where(unit * width < rise, left, right), self.whole)


DISTRIBUTIONS: dict[str, type[Settings]] = {
    "uniform": Uniform,
    "log-uniform": LogUniform,
    "normal": Normal,
    "triangular": Triangular,
}


def _plain(values: Float[np.ndarray, "n"], whole: bool) -> list[Any]:
    if whole:
        return [int(v) for v in np.rint(values)]
    return [float(f"{v:.{DIGITS}g}") for v in values]


def same_values(values: Sequence[Any]) -> tuple[int, int] | None:
    """Places of two equal values of a list; 1, 1.0 and true are three."""
    seen: dict[str, int] = {}
    for i, value in enumerate(values):
        first = seen.setdefault(repr(value), i)
        if first != i:
            return first, i
    return None
