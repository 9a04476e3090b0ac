"""The manner of every settings object: frozen, typos refused, units in names, a clock position understood."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

CLOCK = re.compile(r"(1[0-2]|[1-9]):([0-5]\d)")


class Settings(BaseModel):
    """Frozen settings that refuse a misspelt key, a non-number and an infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def _clock_to_deg(value: Any) -> Any:
    if isinstance(value, str) and (match := CLOCK.fullmatch(value)):
        return (int(match[1]) % 12) * 30.0 + int(match[2]) * 0.5
    return value


ClockDeg = Annotated[float, BeforeValidator(_clock_to_deg, json_schema_input_type=float | str)]
"""Degrees clockwise from 12 o'clock, seen along +z; a clock position "4:00" is understood."""
