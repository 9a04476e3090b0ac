"""One row's outcome in the index of the paper: our value in words, and what that says."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

HOLDS, DOES_NOT = "holds", "DOES NOT HOLD"


class Found(NamedTuple):
    """Our value with its unit, and the verdict on it."""

    ours: str
    verdict: str


def difference(value: float, unit: str, most: float) -> Found:
    """The largest difference between our function and the equation as printed, judged against rounding."""
    return Found(f"largest difference {value:.1e} {unit}", verdict(value <= most))


def verdict(held: bool | np.bool_) -> str:
    """The two plain verdicts."""
    return HOLDS if held else DOES_NOT


def named(where: str) -> Any:
    """What `package.module:name` names.

    Raises:
        ImportError, AttributeError: when there is no such thing.
    """
    module, name = where.split(":")
    return getattr(import_module(module), name)
