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


COMPARED = {"name": "figure", "log": "log", "replay": "replay", "spread": "spread", "verdict": "verdict"}


def compared_words(figures: dict[str, Any]) -> str:
    """A comparison as a table, the count, and what goes beyond the validated range."""
    rows = [{"name": name, **row} for name, row in figures["figures"].items()]
    count = f"{figures['inside']} of {len(rows)} figures lie inside the log's own spread"
    lines = [text_table(rows, COMPARED), count]
    return "\n".join([*lines, *(f"extrapolated: {reason}" for reason in figures["extrapolated"] or [])])
