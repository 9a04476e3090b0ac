"""The commands of the field side: each parses, calls one function and prints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    for command in (export,):
        app.command()(command)


def export(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder that `run`, `replay` or `study` wrote.")],
    to: Annotated[
        str | None,
        typer.Option("--to", metavar="FORMAT", help="A run: mcap, rosbag2; a study: csv (the default), parquet."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PATH", help="Where a run's file or folder goes.")
    ] = None,
) -> None:
    """Write a run in a format that other tools open, or a study's rows as tables."""
    from scenarios.field.export import export as write

    for file in write(folder, to, out):
        print(file)
