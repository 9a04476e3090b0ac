"""The commands `replay` and `export`: each parses, calls one function and prints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenarios.cores import cores
from scenarios.options import Jobs

FAILED = 1


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    for command in (replay, export):
        app.command()(command)


def replay(
    log: Annotated[
        Path,
        typer.Argument(metavar="LOG", help="A recording, a run, a ROS 2 bag or .mcap file, or a video."),
    ],
    rig: Annotated[
        str | None, typer.Option("--rig", metavar="RIG", help="A rig by name, or a rig.yaml.  [default: the log's own]")
    ] = None,
    pipe: Annotated[
        Path | None, typer.Option("--pipe", metavar="FILE", help="What is known of the pipe.  [default: the log's own]")
    ] = None,
    method: Annotated[
        Path | None, typer.Option("--method", metavar="METHOD", help="Measure by these: a file, or field.")
    ] = None,
    topics: Annotated[
        Path | None,
        typer.Option("--topics", metavar="FILE", help="Which topics of a bag hold what, where types leave it open."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder.  [default: replays/NAME]")
    ] = None,
    jobs: Jobs = None,
    live: Annotated[bool, typer.Option("--live", help="Follow a recording while it is written.")] = False,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Of the live page, on this machine alone; 0 is a free one.")
    ] = 0,
    idle_s: Annotated[
        float, typer.Option("--idle-s", min=0.1, metavar="S", help="A live log that is silent for so long has ended.")
    ] = 10.0,
) -> None:
    """Measure a robot's log by the very code that the twin's logs go through, and say how sound the log is."""
    from scenarios.document import BadInput
    from scenarios.field.live import follow
    from scenarios.field.replay import method_of
    from scenarios.field.replay import replay as replay_log
    from scenarios.field.told import told_by
    from scenarios.progress import Progress

    told, settings = told_by(rig, pipe, topics, method)
    if live and any(told):
        raise BadInput(
            ["--live: a growing recording has its own rig.yaml and pipe.yaml; leave --rig, --pipe, --topics out"]
        )
    out, progress = out or Path("replays") / log.resolve().stem, Progress()
    try:
        if live:
            result = follow(log, settings or method_of(log), out, jobs or cores(), port, idle_s, progress)
        else:
            result = replay_log(log, told, settings, out, jobs or cores(), progress)
    finally:
        progress.close()
    for one in result.health.findings:
        if one.verdict != "good":
            print(f"{one.verdict}: {one.part}, {one.name}: {one.says}")
    print(f"health: {result.health.verdict}")
    print(f"defects: {len(result.found.defects)}" if result.found else f"no reconstruction: {result.why}")
    print(f"report: {out / 'report.html'}")
    if result.found is None:
        raise typer.Exit(FAILED)


def export(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder that `run`, `replay` or `study` wrote.")],
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="A log: mcap, rosbag2, video; a run: docs/field-pages.md; a study: csv, parquet.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PATH", help="Where a run's file or folder goes.")
    ] = None,
) -> None:
    """Write a run in a format that other tools open, or a study's rows as tables."""
    from scenarios.field.export import export as write

    for file in write(folder, to, out):
        print(file)
