"""A person's CSV: columns by name or number, and every cell that cannot be used by its file and line."""

from __future__ import annotations

import csv
from contextlib import suppress
from difflib import get_close_matches
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scenarios.document import BadInput, shown

LARGEST_FILE_BYTES = 50_000_000
MOST_ROWS = 500_000
MOST_FAULTS = 20
NOTHING = {"", "na", "n/a", "nan", "-"}
HITS = {"1": True, "hit": True, "yes": True, "true": True, "0": False, "miss": False, "no": False, "false": False}


class Table(NamedTuple):
    """A CSV as text: its heads, its rows, and the line on which each row stands."""

    file: Path
    heads: list[str]
    rows: list[list[str]]
    lines: list[int]


def read_table(file: Path) -> Table:
    """Read a CSV with one head line; cells part at commas, semicolons or tabs, whichever the head has most of.

    Raises:
        BadInput: for a file that cannot be read, has no rows, or rows that are not as long as the head.
    """
    try:
        if file.stat().st_size > LARGEST_FILE_BYTES:
            raise BadInput([f"{file}: is larger than {LARGEST_FILE_BYTES / 1e6:g} MB"])
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput([f"{file}: cannot be read: {getattr(error, 'strerror', None) or 'is no UTF-8 text'}"]) from error
    first = text.split("\n", 1)[0]
    reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count))
    rows, lines = [], []
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                rows.append([cell.strip() for cell in row])
                lines.append(reader.line_num)
    except csv.Error as error:
        raise BadInput([f"{file}:{reader.line_num}: {error}"]) from error
    if len(rows) < 2:
        raise BadInput([f"{file}: {'is empty' if not rows else 'has a head and no rows'}"])
    if len(rows) > MOST_ROWS:
        raise BadInput([f"{file}: has {len(rows)} rows; at most {MOST_ROWS} are taken"])
    heads = rows[0]
    faults = [
        f"{file}:{line}: got {len(row)} cells; the head has {len(heads)}"
        for row, line in zip(rows[1:], lines[1:], strict=True)
        if len(row) != len(heads)
    ]
    raise_faults(faults)
    return Table(file, heads, rows[1:], lines[1:])


def raise_faults(faults: list[str]) -> None:
    """Raise what is wrong, the first of it line by line.

    Raises:
        BadInput: when something is.
    """
    if faults:
        more = [f"and {len(faults) - MOST_FAULTS} more"] if len(faults) > MOST_FAULTS else []
        raise BadInput(faults[:MOST_FAULTS] + more)


def place_of(table: Table, column: str) -> int:
    """Which column a person means: its name, or its number from 1 where no column is called so.

    Raises:
        BadInput: for no such column, or several of that name.
    """
    at = [k for k, head in enumerate(table.heads) if head == column]
    if len(at) > 1:
        numbers = ", ".join(str(k + 1) for k in at)
        raise BadInput(
            [f"{table.file}:1: column {shown(column)} stands there {len(at)} times; give a number: {numbers}"]
        )
    if at:
        return at[0]
    if column.isdecimal() and 1 <= int(column) <= len(table.heads):
        return int(column) - 1
    near = get_close_matches(column, table.heads, 1)
    hint = f"; did you mean {shown(near[0])}" if near else ""
    heads = ", ".join(map(shown, table.heads))
    raise BadInput([f"{table.file}:1: no column {shown(column)}; there are {heads}{hint}"])


def numbers(table: Table, column: str, faults: list[str], least: float = -np.inf, empty: bool = False) -> np.ndarray:
    """A column as numbers of at least `least`; where cells may be empty (or NA), those are no number."""
    k, out = place_of(table, column), np.full(len(table.rows), nan)
    for i, (row, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        if row[k].lower() in NOTHING and empty:
            continue
        with suppress(ValueError):
            out[i] = float(row[k])
        if not (isfinite(out[i]) and out[i] >= least):
            limit = f" of at least {least:g}" if isfinite(least) else ""
            faults.append(f"{table.file}:{line}: {column}: got {shown(row[k])}; must be a finite number{limit}")
    return out


def hits(table: Table, column: str, faults: list[str], empty: bool = False) -> np.ndarray:
    """A column of hits (1) and misses (0) as numbers; where cells may be empty, those are no number."""
    k, out = place_of(table, column), np.full(len(table.rows), nan)
    for i, (row, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        word = row[k].lower()
        if word in NOTHING and empty:
            continue
        if word in HITS:
            out[i] = HITS[word]
        else:
            faults.append(f"{table.file}:{line}: {column}: got {shown(row[k])}; must be one of {', '.join(HITS)}")
    return out


def names(table: Table, column: str, faults: list[str]) -> list[str]:
    """A column of names, none of them empty."""
    k = place_of(table, column)
    faults += [
        f"{table.file}:{line}: {column}: got nothing; must be a name"
        for row, line in zip(table.rows, table.lines, strict=True)
        if not row[k]
    ]
    return [row[k] for row in table.rows]
