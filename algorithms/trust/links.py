"""The links of hit/miss curves: rising distribution functions F of a linear predictor."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import expit, log_expit, log_ndtr, logit, ndtr, ndtri

STEEPEST = 700.0  # exp() of more is no number
LOG_SQRT_2PI = 0.5 * np.log(2 * np.pi)


class Link(NamedTuple):
    """F, the logarithms of F, of 1 - F and of F's derivative, and the predictor at which F takes a value."""

    cdf: Callable
    log_cdf: Callable
    log_sf: Callable
    log_pdf: Callable
    quantile: Callable


def _log_1_less_exp(negative: np.ndarray) -> np.ndarray:
    return np.log(-np.expm1(negative))


LINKS = {
    "logit": Link(expit, log_expit, lambda e: log_expit(-e), lambda e: log_expit(e) + log_expit(-e), logit),
    "probit": Link(ndtr, log_ndtr, lambda e: log_ndtr(-e), lambda e: -0.5 * e * e - LOG_SQRT_2PI, ndtri),
    "cloglog": Link(
        lambda e: -np.expm1(-np.exp(e)),
        lambda e: _log_1_less_exp(-np.exp(e)),
        lambda e: -np.exp(e),
        lambda e: e - np.exp(e),
        lambda p: np.log(-np.log1p(-p)),
    ),
    "loglog": Link(
        lambda e: np.exp(-np.exp(-e)),
        lambda e: -np.exp(-e),
        lambda e: _log_1_less_exp(-np.exp(-e)),
        lambda e: -e - np.exp(-e),
        lambda p: -np.log(-np.log(p)),
    ),
}
