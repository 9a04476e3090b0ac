"""The commands `pipetwin paper ...`: the paper's own table and figures, made again."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Literal

import typer

app = typer.Typer(help="Make the paper's table and figures again, with the truth beside them.", no_args_is_help=True)

Fidelity = Literal["picture", "raycast", "points"]
Sees = Annotated[Fidelity, typer.Option("--fidelity", help="How frames are made.")]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed instead of the scenario's.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON: a list of rows.")]
OutFolder = Annotated[
    Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder for the results.  [default: paper/NAME]")
]
Jobs = Annotated[int | None, typer.Option("-j", "--jobs", metavar="N", min=1, help="Processes.  [default: all cores]")]


@app.command()
def table1(
    seed: Seed = None,
    fidelity: Sees = "picture",
    grow: Annotated[
        bool, typer.Option("--grow", help="As noise, calibration error, ovality and defects grow; slit pixels only.")
    ] = False,
    out: OutFolder = None,
    as_json: AsJson = False,
    jobs: Jobs = None,
) -> None:
    """Table 1: what each registration leaves of the gantry's scan, beside the paper's rows and the true poses'."""
    from scenarios.paper.table1 import run_table1, words
    from scenarios.progress import Progress

    out, progress = out or Path("paper") / ("table1-grown" if grow else "table1"), Progress()
    try:
        rows = run_table1(fidelity, seed, grow, out, jobs or _cores(), progress)
    finally:
        progress.close()
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\nrows: {out / 'table1.csv'}")


@app.command()
def fig5(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 5: a defect 10.16 mm deep set apart by RANSAC, point by point against the truth; the wall is 12.7 mm."""
    from scenarios.paper.fig5 import run_fig5, words
    from scenarios.progress import Progress

    out, progress = out or Path("paper") / "fig5", Progress()
    try:
        rows = run_fig5(fidelity, seed, out, jobs or _cores(), progress)
    finally:
        progress.close()
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\npicture: {out / 'fig5.png'}")


@app.command()
def fig11(seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, jobs: Jobs = None) -> None:
    """Figure 11: the clouds that the registrations leave of one gantry scan, side by side."""
    from scenarios.paper.fig11 import run_fig11
    from scenarios.progress import Progress

    out, progress = out or Path("paper") / "fig11", Progress()
    try:
        run_fig11(fidelity, seed, out, jobs or _cores(), progress)
    finally:
        progress.close()
    print(f"picture: {out / 'fig11.png'}")


@app.command()
def fig12(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 12: the angle that a roll of 8 and of 25 degrees leaves between two defects, by every estimator."""
    from scenarios.paper.fig12 import run_fig12, words
    from scenarios.progress import Progress

    out, progress = out or Path("paper") / "fig12", Progress()
    try:
        rows = run_fig12(fidelity, seed, out, jobs or _cores(), progress)
    finally:
        progress.close()
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\nrows: {out / 'fig12.csv'}")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
