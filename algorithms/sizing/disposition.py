"""What becomes of a defect by a limit that the user sets on the wall loss."""

from __future__ import annotations

from typing import Literal

ONE_SIDED_95 = 1.645

Disposition = Literal["accept", "reject", "undecided"]


def at_least(value: float, std: float) -> float:
    """What a measured value exceeds in 95 % of cases, never less than nothing."""
    return max(value - ONE_SIDED_95 * std, 0.0)


def disposition(loss_pct: float, loss_std_pct: float, floor_seen: bool, limit_pct: float) -> Disposition:
    """Rejected or accepted where the loss lies beyond or within the limit with 95 % certainty.

    Where no light reached the floor, the loss is a least one, and nothing is accepted.
    """
    if at_least(loss_pct, loss_std_pct) > limit_pct:
        return "reject"
    if floor_seen and loss_pct + ONE_SIDED_95 * loss_std_pct <= limit_pct:
        return "accept"
    return "undecided"
