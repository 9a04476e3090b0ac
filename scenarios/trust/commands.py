"""The commands `pipetwin pod`, `gauge` and `report`: parse, call one function, print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from scenarios.options import AsJson

Csv = Annotated[Path, typer.Argument(metavar="CSV", help="A table with one head line.")]
Scale = Literal["log", "linear"]


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    app.command()(pod)
    app.command()(gauge)
    app.command()(report)


def pod(
    file: Annotated[
        Path,
        typer.Argument(metavar="CSV|DIR", help="A table with one head line; or a study, a run or a folder of runs."),
    ],
    size: Annotated[
        str | None,
        typer.Option("--size", metavar="COLUMN", help="True size; 0 where nothing is.  [default: size; true_depth_mm]"),
    ] = None,
    hit: Annotated[
        list[str] | None, typer.Option("--hit", metavar="COLUMN", help="Hit (1) or miss (0); may repeat, a look each.")
    ] = None,
    signal: Annotated[
        list[str] | None, typer.Option("--signal", metavar="COLUMN", help="Signal; may repeat, a look each.")
    ] = None,
    decision: Annotated[float | None, typer.Option("--decision", help="A signal above this is a hit.")] = None,
    left: Annotated[float | None, typer.Option("--left", help="Signals at most this are known only to be so.")] = None,
    right: Annotated[
        float | None, typer.Option("--right", help="Signals at least this are known only to be so.")
    ] = None,
    noise_to: Annotated[float | None, typer.Option("--noise-to", help="Sizes up to this are noise too.")] = None,
    target: Annotated[
        str | None, typer.Option("--target", metavar="COLUMN", help="Names the target that a row looks at.")
    ] = None,
    link: Annotated[
        Literal["logit", "probit", "cloglog", "loglog"], typer.Option("--link", help="Shape of a hit/miss curve.")
    ] = "logit",
    size_scale: Annotated[Scale, typer.Option("--size-scale", help="The curve's axis.")] = "log",
    signal_scale: Annotated[Scale, typer.Option("--signal-scale", help="The signals' axis.")] = "linear",
    floor: Annotated[bool, typer.Option("--floor", help="Let a hit/miss curve start above 0.")] = False,
    ceiling: Annotated[bool, typer.Option("--ceiling", help="Let a hit/miss curve end below 1.")] = False,
    method: Annotated[
        str | None, typer.Option("--method", metavar="NAME", help="Whose measurements, where a study has several.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Page and figures.  [default: pod/CSV's name]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Probability of detection from a table, or straight from scans: a50, a90, a90/95, false calls."""
    from scenarios.trust.looks import question_of
    from scenarios.trust.pod_page import json_figures, run_pod, words
    from scenarios.trust.scan_looks import HIT, SIZE, TARGET

    if file.is_dir():
        size, hit, target = size or SIZE, hit or [HIT], target or TARGET
    given = {
        "size": size or "size",
        "hit": tuple(hit or ()),
        "signal": tuple(signal or ()),
        "decision": decision,
        "left": left,
    }
    given |= {"right": right, "noise_to": noise_to, "target": target, "link": link, "size_scale": size_scale}
    given |= {"signal_scale": signal_scale, "floor": floor, "ceiling": ceiling}
    out = out or Path("pod") / file.stem
    found = run_pod(file, question_of(given), out, method)
    print(json.dumps(json_figures(found), indent=2) if as_json else f"{words(found)}\nreport: {out / 'report.html'}")


def gauge(
    file: Csv,
    part: Annotated[str, typer.Option("--part", metavar="COLUMN", help="Names the part.")] = "part",
    operator: Annotated[
        str, typer.Option("--operator", metavar="COLUMN", help="Names who, or what, measured.")
    ] = "operator",
    value: Annotated[str, typer.Option("--value", metavar="COLUMN", help="What was measured.")] = "value",
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Page and figures.  [default: gauge/CSV's name]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Repeatability and reproducibility of measurements, by crossed analysis of variance and by ranges."""
    from scenarios.trust.gauge import figures, run_gauge, words

    out = out or Path("gauge") / file.stem
    found = run_gauge(file, part, operator, value, out)
    print(json.dumps(figures(found), indent=2) if as_json else f"{words(found)}\nreport: {out / 'report.html'}")


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders that `run` made.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Page and rows.  [default: performance]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Performance over runs as the trade states it: unity plot, classes, detection, false calls, stated intervals."""
    from scenarios.trust.performance_page import figures, run_report, words

    out = out or Path("performance")
    found, pod = run_report(runs, out)
    print(
        json.dumps(figures(found, pod), indent=2) if as_json else f"{words(found, pod)}\nreport: {out / 'report.html'}"
    )
