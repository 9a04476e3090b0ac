"""The slip alarm: what each wheel rolled more or less than the robot went is summed up, and named past a limit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from algorithms.types import Episode
from sensor_model.settings import Settings

ALL = "all wheels"


class AlarmSettings(Settings):
    """From how much slip on the alarm speaks, what share of the way counts as none, and when it is over.

    It is over once the slip of the last `calm_s` stays below `calm_mm`.
    """

    alarm_mm: Annotated[float, Field(gt=0.1)] = 2.5
    slack_pct: Annotated[float, Field(ge=0)] = 0.3
    calm_s: Annotated[float, Field(gt=0.1)] = 0.8
    calm_mm: Annotated[float, Field(gt=0)] = 0.3


@dataclass(frozen=True)
class Watch:
    """Cumulative sums, one a wheel and the last for all together: forward, backward, and the slips of late."""

    forward_mm: Float[np.ndarray, "watched"]
    backward_mm: Float[np.ndarray, "watched"]
    named: Bool[np.ndarray, "watched"]
    late: tuple[tuple[int, Float[np.ndarray, "watched"]], ...] = ()
    episodes: tuple[Episode, ...] = field(default=())


def begin_watch(wheels: int) -> Watch:
    """Nothing has slipped yet."""
    nothing = np.zeros(wheels + 1)
    return Watch(nothing, nothing.copy(), np.zeros(wheels + 1, dtype=bool))


def watch(
    before: Watch,
    stamp_ns: int,
    slip_mm: Float[np.ndarray, "wheels"],
    way_mm: float,
    all_slip: bool,
    settings: AlarmSettings,
) -> Watch:
    """One frame on: an alarm may begin, go on, or be over."""
    common = float(np.median(slip_mm)) if all_slip else 0.0
    slip = np.append(slip_mm - common, common)
    slack = settings.slack_pct / 100 * abs(way_mm)
    forward = np.maximum(before.forward_mm + slip - slack, 0.0)
    backward = np.maximum(before.backward_mm - slip - slack, 0.0)
    horizon = stamp_ns - round(settings.calm_s * 1e9)
    late = (*(row for row in before.late if row[0] > horizon), (stamp_ns, slip))
    recent = np.abs(np.sum([row[1] for row in late], axis=0))
    over = before.named & (recent < settings.calm_mm)
    named = np.where(before.named, ~over, np.maximum(forward, backward) > settings.alarm_mm)
    episodes = list(before.episodes)
    for i in np.flatnonzero(named | before.named):
        _write(episodes, int(i), slip.size - 1, stamp_ns, float(forward[i] - backward[i]), bool(before.named[i]))
    forward[over], backward[over] = 0.0, 0.0
    return replace(before, forward_mm=forward, backward_mm=backward, named=named, late=late, episodes=tuple(episodes))


def _write(episodes: list[Episode], i: int, wheels: int, stamp_ns: int, amount_mm: float, goes_on: bool) -> None:
    who = ALL if i == wheels else f"wheel {i + 1}"
    if not goes_on:
        episodes.append(Episode("slip", who, stamp_ns, stamp_ns, amount_mm))
        return
    k = max(k for k, episode in enumerate(episodes) if episode.kind == "slip" and episode.who == who)
    episodes[k] = replace(episodes[k], end_ns=stamp_ns, amount=amount_mm)
