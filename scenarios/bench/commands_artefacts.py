"""The command `pipetwin bench artefacts`: gauges of known size, and reference cylinders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from scenarios.cores import cores
from scenarios.options import Jobs


def register(app: typer.Typer) -> None:
    """Put the command into the bench's."""
    app.command()(artefacts)


def artefacts(
    seeds: Annotated[int, typer.Option("--seeds", metavar="N", min=1, max=1000, help="Scans with other noise.")] = 3,
    fidelity: Annotated[
        Literal["picture", "raycast", "points"], typer.Option("--fidelity", help="How frames are made.")
    ] = "points",
    reference: Annotated[
        Path | None,
        typer.Option("--reference", metavar="FOLDER", help="Instead fit its *.asc, judged by its *.answer.txt."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="JSON and CSV.  [default: bench/artefacts]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: a list of rows.")] = False,
    jobs: Jobs = None,
) -> None:
    """Measure a ring gauge, a step gauge and a ball-bar of known size."""
    if reference is not None:
        from scenarios.bench.reference import fit_references
        from scenarios.bench.reference import words as reference_words

        fitted = fit_references(reference)
        print(json.dumps(fitted, indent=2) if as_json else reference_words(fitted))
        return
    from scenarios.bench.artefacts import run_artefacts, words
    from scenarios.progress import Progress

    out, progress = out or Path("bench") / "artefacts", Progress()
    try:
        rows = run_artefacts(fidelity, seeds, out, jobs or cores(), progress)
    finally:
        progress.close()
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\nrows: {out / 'artefacts.csv'}")
