"""Options that several commands share, word for word."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Jobs = Annotated[int | None, typer.Option("-j", "--jobs", metavar="N", min=1, help="Processes.  [default: all cores]")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
StudyOut = Annotated[
    Path | None, typer.Option("-o", "--out", metavar="DIR", help="Study folder.  [default: studies/NAME]")
]
Dask = Annotated[
    str | None, typer.Option("--dask", metavar="tcp://HOST:PORT", help="Run on this Dask scheduler's workers.")
]
