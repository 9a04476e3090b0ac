"""A crossed gauge study: repeatability and reproducibility by analysis of variance, or by means and ranges (AIAG)."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import chi2
from scipy.stats import f as f_law

POOL_ABOVE = 0.25  # an interaction less significant than this is taken as repeatability (AIAG MSA, 4th ed.)
NDC_FACTOR = 1.41  # sqrt(2) as the AIAG manual rounds it


class SumOfSquares(NamedTuple):
    """One line of the table of variance."""

    source: str
    degrees_of_freedom: int
    sum_of_squares: float
    mean_square: float
    f: float | None
    p: float | None


class Variation(NamedTuple):
    """One part of the variation: standard deviation, share of the variance, share of the total spread."""

    name: str
    standard_deviation: float
    contribution_pct: float
    study_variation_pct: float


class GaugeStudy(NamedTuple):
    """Table of variance and the parts: EV equipment (repeatability), AV appraiser (reproducibility), INT operator by
    part (0 where pooled), GRR all of these, PV part to part, TV total; `ndc` distinct categories.

    `repeatability_interval` is exact (chi2). `negative` names variances that came out below 0 and were taken as 0.
    """  # noqa: D205

    table: tuple[SumOfSquares, ...]
    pooled: bool
    variation: tuple[Variation, ...]
    ndc: int
    repeatability_interval: tuple[float, float]
    negative: tuple[str, ...]

    def sd(self, name: str) -> float:
        """The standard deviation of one part."""
        return next(part.standard_deviation for part in self.variation if part.name == name)


class RangeStudy(NamedTuple):
    """The same by the manual's means and ranges: average range, spread of operators' means, and the parts' sds."""

    mean_range: float
    operator_difference: float
    part_range: float
    variation: tuple[Variation, ...]
    ndc: int


def gauge_study(values: Float[np.ndarray, "parts operators trials"], pool_above: float = POOL_ABOVE) -> GaugeStudy:
    """Crossed analysis of variance with random parts and operators (AIAG MSA 4th ed., chapter III, section B).

    Raises:
        ValueError: for fewer than two parts, operators or trials, or values that are not finite.
    """
    _check(values)
    p, o, r = values.shape
    of_part, of_operator, of_cell = values.mean((1, 2)), values.mean((0, 2)), values.mean(2)
    grand = values.mean()
    ss_part = o * r * np.sum((of_part - grand) ** 2)
    ss_operator = p * r * np.sum((of_operator - grand) ** 2)
    ss_cross = r * np.sum((of_cell - of_part[:, None] - of_operator + grand) ** 2)
    ss_repeat = np.sum((values - of_cell[:, :, None]) ** 2)
    freedom = [p - 1, o - 1, (p - 1) * (o - 1), p * o * (r - 1)]
    if ss_repeat <= 0:
        raise ValueError("all trials of each part and operator are the same: there is no repeatability to compare with")
    ms = [float(ss) / dof for ss, dof in zip((ss_part, ss_operator, ss_cross, ss_repeat), freedom, strict=True)]
    p_cross = float(f_law.sf(ms[2] / ms[3], freedom[2], freedom[3]))
    pooled = p_cross > pool_above
    error_dof = freedom[2] + freedom[3] if pooled else freedom[3]
    error = float(ss_cross + ss_repeat) / error_dof if pooled else ms[3]
    against, against_dof = (error, error_dof) if pooled else (ms[2], freedom[2])
    raw = {
        "AV": (ms[1] - against) / (p * r),
        "INT": 0.0 if pooled else (ms[2] - ms[3]) / r,
        "PV": (ms[0] - against) / (o * r),
    }
    table = (
        _line("part", freedom[0], ss_part, against, against_dof),
        _line("operator", freedom[1], ss_operator, against, against_dof),
        _line("part x operator", freedom[2], ss_cross, ms[3], freedom[3]),
        SumOfSquares("repeatability", freedom[3], float(ss_repeat), ms[3], None, None),
        SumOfSquares(
            "total", p * o * r - 1, float(np.sum((values - grand) ** 2)), float(values.var(ddof=1)), None, None
        ),
    )
    variance = {name: max(value, 0.0) for name, value in raw.items()}
    parts = _variation(error, variance["AV"], variance["INT"], variance["PV"])
    ends = tuple(float(np.sqrt(error * error_dof / chi2.ppf(tail, error_dof))) for tail in (0.975, 0.025))
    negative = tuple(name for name, value in raw.items() if value < 0)
    return GaugeStudy(table, pooled, parts, _categories(parts), (ends[0], ends[1]), negative)


def _line(source: str, dof: int, ss: float, against: float, against_dof: int) -> SumOfSquares:
    ratio = float(ss) / dof / against
    return SumOfSquares(source, dof, float(ss), float(ss) / dof, ratio, float(f_law.sf(ratio, dof, against_dof)))


def _variation(repeat: float, operator: float, cross: float, part: float) -> tuple[Variation, ...]:
    grr = repeat + operator + cross
    total = grr + part
    variances = {"EV": repeat, "AV": operator, "INT": cross, "GRR": grr, "PV": part, "TV": total}
    return tuple(
        Variation(name, float(np.sqrt(v)), float(100 * v / total), float(100 * np.sqrt(v / total)))
        for name, v in variances.items()
    )


def _categories(parts: tuple[Variation, ...]) -> int:
    """The number of categories that the gauge tells apart, rounded down as in the manual."""
    sd = {part.name: part.standard_deviation for part in parts}
    return int(NDC_FACTOR * sd["PV"] / sd["GRR"])


def range_study(values: Float[np.ndarray, "parts operators trials"]) -> RangeStudy:
    """The manual's average and range method, with its constants K1 to K3, rounded to four decimals as it prints them.

    Raises:
        ValueError: as `gauge_study`.
    """
    _check(values)
    p, o, r = values.shape
    mean_range = float(np.ptp(values, axis=2).mean())
    operators, parts = float(np.ptp(values.mean((0, 2)))), float(np.ptp(values.mean((1, 2))))
    k1, k2, k3 = (round(1 / factor, 4) for factor in (range_factor(r), range_factor(o, 1), range_factor(p, 1)))
    repeat = mean_range * k1
    operator = max((operators * k2) ** 2 - repeat**2 / (p * r), 0.0)
    variation = _variation(repeat**2, operator, 0.0, (parts * k3) ** 2)
    return RangeStudy(mean_range, operators, parts, variation, _categories(variation))


@cache
def range_factor(size: int, samples: int | None = None) -> float:
    """d2, the mean range of so many standard normal values; for the mean range of few samples d2* (Duncan 1974)."""
    mean = quad(lambda x: 1 - ndtr(x) ** size - ndtr(-x) ** size, -12, 12)[0]
    if samples is None:
        return float(mean)

    def beyond(x: float) -> float:
        inner = quad(lambda y: 1 - ndtr(y) ** size - ndtr(-x) ** size + (ndtr(y) - ndtr(x)) ** size, x, 12)[0]
        return float(inner)

    variance = 2 * quad(beyond, -12, 12)[0] - mean**2
    return float(np.sqrt(mean**2 + variance / samples))


def _check(values: np.ndarray) -> None:
    if values.ndim != 3 or min(values.shape) < 2:
        raise ValueError(
            f"{' x '.join(map(str, values.shape))} values; at least 2 parts x 2 operators x 2 trials are needed"
        )
    if not np.isfinite(values).all():
        raise ValueError("values that are not finite")
    if np.ptp(values) == 0:
        raise ValueError("all values are the same")
