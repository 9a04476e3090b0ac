"""The commands `pipetwin bench ...`: parse, call one function, print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from scenarios.bench.commands_artefacts import register

app = typer.Typer(
    help="Benchmark registration methods and estimators against each other and against the truth.", no_args_is_help=True
)
register(app)

Scenarios = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[SCENARIOS]",
        help="Frame cases, or at the scan level scenarios.  [default: clean, defect-30, hard; paper-gantry]",
    ),
]
Methods = Annotated[str | None, typer.Option("--methods", metavar="A,B", help="Of those `list` shows.  [default: all]")]
Seeds = Annotated[
    int | None, typer.Option("--seeds", metavar="N", min=1, max=100_000, help="Frames, or scans.  [default: 40; 1]")
]
Level = Annotated[
    Literal["frame", "scan"],
    typer.Option("--level", help="Synthetic frames with exact truth and no picture, or whole recordings."),
]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change a case or scenario, as noise_mm=0.3; may repeat."),
]
OutFolder = Annotated[
    Path | None, typer.Option("-o", "--out", metavar="DIR", help="Page and CSV.  [default: bench/registration-LEVEL]")
]


@app.command()
def localisation(
    causes: Annotated[
        list[str] | None, typer.Argument(metavar="[CAUSES]", help="Of the table's rows.  [default: all]")
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", metavar="N", min=1, max=1000, help="Drives a cause.")] = 1,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="CSV and JSON.  [default: bench/localisation]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: a row a drive and estimator.")] = False,
) -> None:
    """Compare estimators of distance and roll: which cause (slip, worn wheels, biases ...) hurts which of them."""
    from scenarios.bench.localisation import bench, words
    from scenarios.progress import Progress

    out, progress = out or Path("bench") / "localisation", Progress()
    try:
        rows = bench(causes or [], seeds, out, 1, progress)
    finally:
        progress.close()
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\nrows: {out / 'localisation.csv'}")


@app.command()
def registration(
    scenarios: Scenarios = None,
    methods: Methods = None,
    seeds: Seeds = None,
    level: Level = "frame",
    changes: Changes = None,
    out: OutFolder = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: a row a method.")] = False,
    jobs: Annotated[
        int, typer.Option("-j", "--jobs", metavar="N", min=1, help="Processes; more than 1 disturbs the times.")
    ] = 1,
) -> None:
    """Compare registration methods: errors with intervals, failures, the Cramer-Rao bound, time, pair by pair."""
    from scenarios.bench.registration import bench, table
    from scenarios.bench.statistics import plain
    from scenarios.progress import Progress

    out = out or Path("bench") / f"registration-{level}"
    progress = Progress()
    try:
        result = bench(scenarios or [], methods, seeds, level, changes or [], out, jobs, progress)
    finally:
        progress.close()
    if as_json:
        print(json.dumps([plain(row) for row in result.rows], indent=2))
        return
    print(table(result))
    print(f"report: {out / 'report.html'}")
