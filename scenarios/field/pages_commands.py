"""The commands `twin-page`, `match` and `verify`: each parses, calls one function and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from scenarios.options import AsJson

FAILED = 1
DEPTH_SHOWN = ("before_mm", "after_mm", "change_mm", "change_low_mm", "change_high_mm", "verdict")
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="A folder that `run` or `replay` made.")]


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    app.command("twin-page")(twin_page)
    app.command()(match)
    app.command()(verify)


def twin_page(
    run_dir: RunFolder,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Page.  [default: RUN/twin.html]")
    ] = None,
) -> None:
    """Make a page of a run: the wall unrolled and in space, defects to click, path, roll, slip and pictures."""
    from scenarios.field.twin_page import write_twin_page

    out = out or run_dir / "twin.html"
    write_twin_page(run_dir, out)
    print(f"page: {out}")


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


def verify(
    log_or_run: Annotated[Path, typer.Argument(metavar="LOG_OR_RUN", help="A scan of the spool: a log or a run.")],
    spool: Annotated[Path, typer.Option("--spool", metavar="FILE", help="The spool's certificate (YAML).")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Page and tables.  [default: verify/SCAN]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """The check before and after a job: does a scan of a reference spool agree with its certificate."""
    from scenarios.field.verify import rows
    from scenarios.field.verify_page import figures, words, write_check
    from scenarios.report.plain_rows import text_table

    out = out or Path("verify") / log_or_run.name
    check = write_check(log_or_run, spool, out)
    if as_json:
        print(json.dumps(figures(check), indent=2))
    else:
        numbers, others = ("measured", "certified", "allowed"), ("unit", "verdict", "words")
        lines = [row | {key: None if row[key] is None else f"{row[key]:.3f}" for key in numbers} for row in rows(check)]
        print(text_table(lines, {key: key for key in ("what", *numbers, *others)}))
        print(f"{words(check)}\nreport: {out / 'report.html'}")
    if check.verdict != "inside":
        raise typer.Exit(FAILED)
