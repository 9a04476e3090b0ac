"""Rows of figures as plain text for a terminal, and as JSON and CSV files."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

NONE = "-"


def text_table(rows: Sequence[Mapping[str, object]], columns: Mapping[str, str], title: str = "") -> str:
    """Columns (key: heading) of some rows, words to the left and numbers to the right; what a row lacks is a dash."""
    cells = [[_cell(row.get(key)) for key in columns] for row in rows]
    heads = list(columns.values())
    widths = [max(len(head), *(len(line[i]) for line in cells), 0) for i, head in enumerate(heads)]
    numeric = [all(not isinstance(row.get(key), str) for row in rows) for key in columns]
    lines = [
        "  ".join(
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(line, widths, numeric, strict=True)
        ).rstrip()
        for line in [heads, *cells]
    ]
    return "\n".join([title, *lines] if title else lines)


def _cell(value: object) -> str:
    if value is None or value != value:
        return NONE
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write_rows(rows: Sequence[Mapping[str, Any]], stem: Path) -> None:
    """Write rows as JSON and as CSV, the files' ending apart."""
    stem.with_suffix(".json").write_text(json.dumps(rows, indent=1, allow_nan=False) + "\n")
    keys = list(dict.fromkeys(key for row in rows for key in row))
    with stem.with_suffix(".csv").open("w", newline="") as file:
        table = csv.DictWriter(file, keys)
        table.writeheader()
        table.writerows(rows)
