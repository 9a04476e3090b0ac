"""The figures of an identification as lines for a terminal."""

from __future__ import annotations

from typing import Any

from scenarios.report.plain_rows import text_table

COLUMNS = {"name": "quantity", "value": "estimate", "low": "95 % from", "high": "to", "count": "n"}


def words(figures: dict[str, Any]) -> str:
    """A table of what was estimated, then what was not, then what is wrong with the log."""
    named = {name: one for name, one in figures.items() if isinstance(one, dict)}
    rows = [{"name": name, **one} for name, one in named.items() if "value" in one]
    lines = [text_table(rows, COLUMNS)]
    lines += [f"not estimated: {name}: {one['reason']}" for name, one in named.items() if "reason" in one]
    return "\n".join([*lines, *figures["said"]])
