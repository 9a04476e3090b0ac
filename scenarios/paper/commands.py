"""The commands `pipetwin paper ...`: the paper's own table and figures, made again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, no_type_check

import typer

from scenarios.cores import cores
from scenarios.options import Jobs

app = typer.Typer(help="Make the paper's tables and figures again, with the truth beside them; alone: what it holds.")

Fidelity = Literal["picture", "raycast", "points"]
Sees = Annotated[Fidelity, typer.Option("--fidelity", help="How frames are made.")]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed instead of the scenario's.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON: a list of rows.")]
OutFolder = Annotated[
    Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder for the results.  [default: paper/NAME]")
]


@app.callback(invoke_without_command=True)
@no_type_check  # what typer hands over is its own class's parent
def paper(
    context: typer.Context,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: a list of rows.")] = False,
) -> None:
    """Make the paper's tables and figures again, with the truth beside them; alone: the index of all it holds."""
    if context.invoked_subcommand is None:
        index(as_json=as_json)


@app.command()
def index(
    root: Annotated[
        Path, typer.Option("--from", metavar="DIR", help="Where the commands' folders `paper` and `runs` are.")
    ] = Path(),
    page: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Write the index as a page, too.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List every equation, figure and table: where it is computed, what makes it, our value, theirs, the verdict."""
    from scenarios.paper.index import rows_of, words, write_page

    rows = rows_of(root)
    if page:
        write_page(rows, page)
    print(json.dumps(rows, indent=2) if as_json else words(rows) + (f"\npage: {page}" if page else ""))


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

    def run(fidelity: Fidelity, seed: int | None, out: Path, workers: int, progress: Callable) -> list:
        return run_table1(fidelity, seed, grow, out, workers, progress)

    out = out or Path("paper") / ("table1-grown" if grow else "table1")
    _made("table1.csv", run, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def fig5(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 5: a defect 10.16 mm deep set apart by RANSAC, point by point against the truth; the wall is 12.7 mm."""
    from scenarios.paper.fig5 import run_fig5, words

    _made("fig5.png", run_fig5, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def fig7(seed: Seed = None, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Figure 7: rotation by camera and by IMU on a log like the sensor's own; `calibrate imu` does a real one."""
    from scenarios.paper.fig7 import run_fig7

    out = out or Path("paper") / "fig7"
    figures = run_fig7(seed or 0, out)
    said = [f"{name:<32}{value}" for name, value in figures.items() if value != ""]
    print(json.dumps(figures, indent=2) if as_json else "\n".join([*said, f"page: {out / 'fig7-imu.html'}"]))


@app.command()
def fig11(seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, jobs: Jobs = None) -> None:
    """Figure 11: the clouds that the registrations leave of one gantry scan, side by side."""
    from scenarios.paper.fig11 import run_fig11
    from scenarios.progress import Progress

    out, progress = out or Path("paper") / "fig11", Progress()
    try:
        run_fig11(fidelity, seed, out, jobs or cores(), progress)
    finally:
        progress.close()
    print(f"picture: {out / 'fig11.png'}")


@app.command()
def fig12(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 12: the angle that a roll of 8 and of 25 degrees leaves between two defects, by every estimator."""
    from scenarios.paper.fig12 import run_fig12, words

    _made("fig12.csv", run_fig12, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def table3(out: OutFolder = None, as_json: AsJson = False) -> None:
    """Table 3: the uncertainty that Eq. 31 gives on the paper's own Table 2, beside what it prints."""
    from scenarios.paper.table3 import run_table3, words

    out = out or Path("paper") / "table3"
    rows = run_table3(out)
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\nrows: {out / 'table3.csv'}")


@app.command()
def fig16(out: OutFolder = None, as_json: AsJson = False) -> None:
    """Figure 16: uncertainty over the number of scans, from all subsets of Table 2's six scans."""
    from scenarios.paper.fig16 import run_fig16, words

    out = out or Path("paper") / "fig16"
    rows = run_fig16(out)
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\npicture: {out / 'fig16.png'}")


@app.command()
def table2(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Table 2: one defect sized blind in six robot scans, beside the paper's six."""
    from scenarios.paper.table2 import run_table2, words

    _made("table2.csv", run_table2, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def table4(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Table 4: the depth of pockets that take 100, 75, 50 and 25 % of the wall, three scans, beside the paper's."""
    from scenarios.paper.table4 import run_table4, words

    _made("table4.csv", run_table4, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def fig14(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 14: the paper's threshold search, which needs the true size, beside the blind one."""
    from scenarios.paper.fig14 import run_fig14, words

    _made("fig14.png", run_fig14, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def fig15(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 15: the depth of one defect from its own background."""
    from scenarios.paper.fig15 import run_fig15, words

    _made("fig15.png", run_fig15, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def fig17(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 17: how pockets of falling depth show in the map."""
    from scenarios.paper.fig17 import run_fig17, words

    _made("fig17.png", run_fig17, words, (fidelity, seed, out, jobs), as_json)


@app.command()
def fig18(
    seed: Seed = None, fidelity: Sees = "picture", out: OutFolder = None, as_json: AsJson = False, jobs: Jobs = None
) -> None:
    """Figure 18: scratches of different shape and depth, true beside measured."""
    from scenarios.paper.fig18 import run_fig18, words

    _made("fig18.png", run_fig18, words, (fidelity, seed, out, jobs), as_json)


def _made(file: str, run: Callable, words: Callable, asked: tuple, as_json: bool) -> None:
    """Scan as a table or a figure asks, and print its rows and where its file is."""
    from scenarios.progress import Progress

    fidelity, seed, out, jobs = asked
    out, progress = out or Path("paper") / Path(file).stem, Progress()
    try:
        rows = run(fidelity, seed, out, jobs or cores(), progress)
    finally:
        progress.close()
    what = "rows" if file.endswith(".csv") else "picture"
    print(json.dumps(rows, indent=2) if as_json else f"{words(rows)}\n{what}: {out / file}")
