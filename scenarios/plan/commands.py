"""The commands `plan` and `plan-check`: each parses, calls one function and prints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenarios.cores import cores
from scenarios.options import Jobs


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    app.command()(plan)
    app.command("plan-check")(plan_check)


PlanArgument = Annotated[Path, typer.Argument(metavar="PLAN", help="A plan file (YAML).")]
Out = Annotated[Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder.  [default: plans/NAME]")]


def plan(file: PlanArgument, out: Out = None, jobs: Jobs = None) -> None:
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


def plan_check(
    file: PlanArgument,
    out: Out = None,
    again: Annotated[
        int | None, typer.Option("--again", metavar="SEED", min=0, help="Make it again with this seed.")
    ] = None,
    pictures: Annotated[
        int, typer.Option("--pictures", metavar="N", min=0, max=1000, help="So many fresh scans in pictures.")
    ] = 0,
    jobs: Jobs = None,
) -> None:
    """Hold a plan that was made against itself with another seed, or against fresh scans in pictures."""
    from scenarios.plan.check import fresh_pictures, made_again
    from scenarios.plan.conduct import FOLDER
    from scenarios.plan.plan_file import load_plan
    from scenarios.study.commands import shown
    from scenarios.study.conduct import How

    if again is None and not pictures:
        raise typer.BadParameter("give --again SEED, --pictures N, or both")
    with shown() as (progress, say):
        loaded, how = load_plan(file), How(jobs or cores())
        folder = out or Path(FOLDER) / loaded.file.name
        twice = [] if again is None else made_again(loaded, folder, again, how, progress, say)
        fresh = fresh_pictures(loaded, folder, pictures, how, progress, say) if pictures else []
    for one in twice:
        both = " and ".join(f"{x.value:.3g} ({x.low:.3g} to {x.high:.3g})" for x in (one.first, one.second))
        print(f"{one.what}: {both}: {'agree' if one.agree else 'DIFFER'}")
    for promise in fresh:
        inside = promise.inside
        ends = f"{100 * inside.low:.0f} to {100 * inside.high:.0f} %"
        said = "as often as promised" if promise.kept else "LESS OFTEN than promised"
        where = f"{promise.what} {promise.promised:.3g}, promised for {100 * promise.asked:g} %"
        print(f"{where}: {inside.counted} of {inside.n} ({ends}): {said}")
