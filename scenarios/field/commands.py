"""The commands `twin-page`, `match` and `verify`: each parses, calls one function and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

FAILED = 1
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="A folder that `run` or `replay` made.")]


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    app.command()(match)


def match(
    before: Annotated[Path, typer.Argument(metavar="RUN1", help="The earlier run's folder.")],
    after: Annotated[Path, typer.Argument(metavar="RUN2", help="The later run's folder.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Page and tables.  [default: match/RUN1-RUN2]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """The same pipe twice: defects paired, growth with its uncertainty, new, gone."""
    from scenarios.field.match import table, words
    from scenarios.field.match_page import figures, write_match
    from scenarios.report.plain_rows import text_table

    out = out or Path("match") / f"{before.name}-{after.name}"
    found = write_match(before, after, out)
    if as_json:
        print(json.dumps(figures(found), indent=2))
        return
    columns = {"defect": "", "distance_mm": "distance mm", "clock": "clock", "fate": "fate"}
    columns |= {f"depth_{name}": name.removesuffix("_mm").replace("_", " ") for name in DEPTH_SHOWN}
    if found.rows:
        print(text_table(table(found), columns))
    print(f"{words(found)}\nreport: {out / 'report.html'}")


DEPTH_SHOWN = ("before_mm", "after_mm", "change_mm", "change_low_mm", "change_high_mm", "verdict")
