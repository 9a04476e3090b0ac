"""Plain data as text that is the same for the same data."""

from __future__ import annotations

import json
from dataclasses import asdict, is_dataclass
from typing import Any


def canonical(value: Any) -> str:
    """Plain data as text, the same for the same data."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_as_plain)


def _as_plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return value.model_dump(mode="json")
