"""The commands `fidelity` and `point-noise`: each parses, calls one function and prints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenarios.cores import cores
from scenarios.options import Jobs


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    app.command()(fidelity)
    app.command("point-noise")(point_noise)


def fidelity(
    bases: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="Library names or files.")] = None,
    library: Annotated[
        bool, typer.Option("--library", help="The field library (or those named of it), shortened as it says itself.")
    ] = False,
    against: Annotated[
        list[str], typer.Option("--of", metavar="FIDELITY", help="What to compare: points, raycast; may be repeated.")
    ] = ["points"],  # noqa: B006  typer copies it
    seeds: Annotated[int, typer.Option("--seeds", min=2, help="So many, the same in each.")] = 10,
    noise: Annotated[str, typer.Option("--noise", help="Of `points`: a name, as of `sensing.points`.")] = "default",
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder.")] = Path("fidelity"),
    jobs: Jobs = None,
) -> None:
    """Compare a cheap fidelity with pictures on the same seeds, and say for which scores they agree."""
    from scenarios.fidelity.agreed import looks, trusted
    from scenarios.fidelity.compare import compare, of_library
    from scenarios.study.commands import shown
    from scenarios.study.conduct import How

    if not (bases or library):
        raise typer.BadParameter("name a scenario, or give --library")
    with shown() as (progress, say):
        chosen = of_library(bases or []) if library else {base: {} for base in bases or []}
        found = compare(chosen, against, seeds, noise, out, How(jobs or cores()), progress, say)
    for one in found:
        for cost in one.costs:
            spent = f"{cost.run_s:.3g} s a run, {cost.cheaper:.3g} times cheaper than pictures"
            print(f"{one.scenario}: {cost.fidelity} {spent}")
        for row in one.scores:
            if row.verdict != "agrees":
                pictures = f"pictures {row.mean:.4g}, from seed to seed {row.spread:.2g}"
                numbers = f"{row.difference:+.3g} ± {row.half:.2g} ({pictures}; n = {row.n})"
                print(f"{one.scenario}: {row.fidelity}: {row.score} {row.verdict}: {numbers}")
    for name in against:
        for group in looks(found):
            names = ", ".join(one.scenario for one in group)
            print(f"{name} agrees over {names}: {', '.join(trusted(group, name)) or 'nothing'}")
    print(f"page: {out / 'fidelity.html'}")


def point_noise(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A library name or a file.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="Where the noise is written (YAML).")],
    pictures: Annotated[int, typer.Option("--pictures", min=4, max=1000, help="How many are drawn.")] = 16,
    jobs: Jobs = None,
) -> None:
    """Measure in drawn pictures which noise the fidelity `points` must have to be like them."""
    from scenarios.fidelity.noise import measure, write_noise
    from scenarios.load import load_scenario
    from scenarios.study.commands import shown

    loaded = load_scenario(scenario)
    with shown() as (progress, _):
        found = measure(loaded, pictures, jobs or cores(), progress)
    write_noise(out, found, loaded)
    print(f"{found.places} places in {found.pictures} pictures: {out}")
