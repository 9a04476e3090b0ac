"""The command `plan`: parses, calls one function and prints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenarios.cores import cores
from scenarios.options import Jobs


def register(app: typer.Typer) -> None:
    """Put the command into the command line."""
    app.command()(plan)


def plan(
    file: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan file (YAML).")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder.  [default: plans/NAME]")
    ] = None,
    jobs: Jobs = None,
) -> None:
    """Say what a deployment can promise, what limits it most, and whether it keeps the limits."""
    from scenarios.plan.conduct import make_plan
    from scenarios.study.commands import shown
    from scenarios.study.conduct import How

    with shown() as (progress, say):
        folder, result = make_plan(file, out, How(jobs or cores()), progress, say)
    for one in result.tolerances:
        promised = "not shown" if one.promised is None else f"{one.promised:.3g}"
        print(f"{one.what}: promised {promised} (n = {one.n}, bias {one.bias:+.3g})")
    for kind in result.detections:
        bound = "not shown" if kind.a90_95_pct is None else f"{kind.a90_95_pct:.3g} % of the wall"
        print(f"{kind.kind}: found {kind.found.counted} of {kind.found.n}, a90/95 {bound}")
    for row in result.kept:
        print(f"limit {row.limit} {row.asked:g}: {row.decision}")
    print(f"decision: {result.decision}")
    print(f"page: {folder / 'plan.html'}")
