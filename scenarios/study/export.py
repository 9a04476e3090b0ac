"""A study's rows as files for other programs: sorted by key and without times, so that equal studies match."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Literal, get_type_hints

from scenarios.document import BadInput
from scenarios.run_folder import whole_file
from scenarios.score import Score
from scenarios.study.ledger import Ledger, Row
from scenarios.study.scan import SIZES

BATCH = 10_000
FIRST = ("key", "point", "method", "seed")
LAST = ("state", "cause", "error")
DEFECT_COLUMNS = ("key", "defect", *(f"{size}_{kind}" for kind in ("true", "measured") for size in SIZES), "found")

Format = Literal["csv", "parquet"]
Table = tuple[dict[str, str], Iterator[list[Any]]]
"""Columns with their types (int, float or text), and rows."""


def export(ledger: Ledger, folder: Path, to: Format) -> list[Path]:
    """Write `runs` and `defects` into a folder; returns the files.

    Raises:
        BadInput: when a file cannot be written, or the package for it is not there.
    """
    write = {"csv": _write_csv, "parquet": _write_parquet}[to]
    files = []
    for name, (columns, rows) in {"runs": runs_table(ledger), "defects": defects_table(ledger)}.items():
        file = folder / f"{name}.{to}"
        with whole_file(file) as work:
            write(work, columns, rows)
        files.append(file)
    return files


def runs_table(ledger: Ledger) -> Table:
    """A row a run, whatever became of it."""
    identity = ledger.about("identity")
    kinds = get_type_hints(Score)
    if identity is None or not (
        set(identity["paths"]) <= set(identity["factors"]) and {*identity["record"]} <= {*kinds}
    ):
        raise BadInput([f"{ledger.file}: does not say what its study varied and kept; another version wrote it"])
    factors = {path: _factor_type(identity["factors"][path]) for path in identity["paths"]}
    figures = {name: "int" if kinds[name] in (int, int | None) else "float" for name in identity["record"]}
    first = dict(zip(FIRST, ("text", "int", "text", "text"), strict=True))  # a seed may pass what a double holds
    return {**first, **factors, **dict.fromkeys(LAST, "text"), **figures}, (
        _run_row(row, factors, len(figures), ledger.file) for row in ledger.rows()
    )


def _run_row(row: Row, factors: dict[str, str], figures: int, file: Path) -> list[Any]:
    if len(row.values) != len(factors) or len(row.figures) not in (0, figures):
        has = f"{len(row.values)} values and {len(row.figures)} figures"
        raise BadInput([f"{file}: run {row.key}: has {has}; {len(factors)} and {figures} are expected"])
    values = [
        v if kind != "text" or isinstance(v, str) else json.dumps(v)
        for v, kind in zip(row.values, factors.values(), strict=True)
    ]
    words = [row.state, row.cause, row.error]
    return [row.key, row.point, row.method, str(row.seed), *values, *words, *(row.figures or [None] * figures)]


def defects_table(ledger: Ledger) -> Table:
    """A row a true defect within what was scanned: its true sizes, the measured ones unless missed, and 1 if found."""
    kinds = ["text", "int", *["float"] * 6, "int"]
    return dict(zip(DEFECT_COLUMNS, kinds, strict=True)), (
        [row.key, number, *sizes, *[None] * (6 - len(sizes)), int(len(sizes) == 6)]
        for row in ledger.rows()
        for number, sizes in enumerate(row.defects, start=1)
    )


def _factor_type(factor: dict[str, Any]) -> str:
    """`float` where every value is a number."""
    numbers = (isinstance(v, int | float) and not isinstance(v, bool) for v in factor.get("values", ()))
    return "float" if all(numbers) else "text"


def _write_csv(file: Path, columns: dict[str, str], rows: Iterator[list[Any]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as out:
        lines = csv.writer(out, lineterminator="\n")
        lines.writerow(columns)
        lines.writerows(rows)


def _write_parquet(file: Path, columns: dict[str, str], rows: Iterator[list[Any]]) -> None:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise BadInput(["--to parquet: needs pyarrow; pip install 'pipetwin[parquet]', or give --to csv"]) from error
    kinds = {"int": pa.int64(), "float": pa.float64(), "text": pa.string()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    with pq.ParquetWriter(file, schema) as out:
        while batch := list(islice(rows, BATCH)):
            arrays = [
                pa.array(_cast(column, kind), type=kinds[kind])
                for column, kind in zip(zip(*batch, strict=True), columns.values(), strict=True)
            ]
            out.write_table(pa.table(arrays, schema=schema))


def _cast(column: tuple[Any, ...], kind: str) -> list[Any]:
    return [float(v) if kind == "float" and v is not None else v for v in column]
