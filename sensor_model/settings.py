"""The manner of every settings object: frozen, typos refused, units in names, a clock position understood."""

from __future__ import annotations

import re
from collections.abc import Mapping
from copy import deepcopy
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

S = TypeVar("S", bound="Settings")
CLOCK = re.compile(r"(1[0-2]|[1-9]):([0-5]\d)")


class Settings(BaseModel):
    """Frozen settings that refuse a misspelt key, a non-number and an infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    # by the fields alone: cached properties hold arrays, whose comparison has no single truth value
    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._values() == other._values()

    def __hash__(self) -> int:
        return hash((type(self), self._values()))

    def model_copy(self: S, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> S:
        """A validated copy: pydantic's own would keep cached properties of the old fields, and check nothing."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_validate({**(deepcopy(values) if deep else values), **(update or {})})

    def _values(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in type(self).model_fields)


def _clock_to_deg(value: Any) -> Any:
    if isinstance(value, str) and (match := CLOCK.fullmatch(value)):
        return (int(match[1]) % 12) * 30.0 + int(match[2]) * 0.5
    return value


ClockDeg = Annotated[float, BeforeValidator(_clock_to_deg, json_schema_input_type=float | str), Field(ge=0, le=360)]
"""Degrees clockwise from 12 o'clock, seen along +z; a clock position "4:00" is understood."""
