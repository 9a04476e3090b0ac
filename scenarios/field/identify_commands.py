"""The commands `pipetwin identify` and `pipetwin compare`: parse, call one function, print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from scenarios.options import AsJson


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    app.command()(identify)
    app.command()(compare)


def identify(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A recording or run, pictures, or the IMU's own CSV.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="SCENARIO.YAML", help="The scenario; a page goes beside it.")
    ],
    rig: Annotated[
        str | None, typer.Option("--rig", metavar="RIG", help="The sensor's rig.  [default: the recording's own]")
    ] = None,
    look: Annotated[
        str, typer.Option("--look", metavar="LOOK", help="Optics whose other settings are kept.")
    ] = "plain",
    as_json: AsJson = False,
) -> None:
    """Identify a twin from a log: what it tells of wheels, IMU, pictures, pipe and way, as a scenario to run."""
    from scenarios.calibration.in_pipe import optics_called
    from scenarios.calibration.rig_file import read_rig
    from scenarios.field.identify import identify as identify_log
    from scenarios.field.identify_text import words
    from scenarios.progress import Progress

    progress = Progress()
    try:
        figures = identify_log(log, read_rig(rig) if rig else None, optics_called(look, "--look"), out, progress)
    finally:
        progress.close()
    print(json.dumps(figures, indent=2) if as_json else words(figures))
    page = out.with_name(f"{out.stem}-identify.html")
    typer.echo(f"scenario: {out}\npage: {page}", err=as_json)


def compare(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The log: a run or a recording.")],
    replay: Annotated[Path, typer.Argument(metavar="REPLAY", help="Its twin: a run or a recording.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where page and JSON go.")] = Path("compared"),
    as_json: AsJson = False,
) -> None:
    """Hold a twin's run against the log that it is to be like: figure by figure, inside or outside the log's spread."""
    from scenarios.field.compare import compare as compare_logs
    from scenarios.field.identify_text import compared_words
    from scenarios.progress import Progress

    progress = Progress()
    try:
        figures = compare_logs(run, replay, out, progress)
    finally:
        progress.close()
    print(json.dumps(figures, indent=2) if as_json else compared_words(figures))
    typer.echo(f"page: {out / 'compare.html'}", err=as_json)
