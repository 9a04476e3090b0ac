"""The commands `study`, `tune`, `status` and `cache`: each parses, calls one function and prints."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenarios.cores import cores
from scenarios.options import AsJson, Dask, Jobs, StudyOut

if TYPE_CHECKING:
    from scenarios.progress import Progress

FAILED = 1
StudyFolder = Annotated[Path, typer.Argument(metavar="DIR", help="The folder that `study` wrote.")]


def register(app: typer.Typer) -> None:
    """Put the commands into the command line."""
    for command in (study, sensitivity, tune, status, cache):
        app.command()(command)


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (YAML).")],
    out: StudyOut = None,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Annotated[bool, typer.Option("--resume/--no-resume", help="Go on with an older ledger.")] = True,
) -> None:
    """Run what is left of a study, and write its page."""
    from scenarios.study.conduct import How, conduct

    with shown() as (progress, say):
        folder, counts = conduct(file, out, How(jobs or cores(), dask, resume), progress, say)
    print(", ".join(f"{name} {n}" for name, n in counts.items()))
    print(f"page: {folder / 'study.html'}")
    if counts["failed"]:
        print(f"{counts['failed']} runs failed; `pipetwin status {folder}` names them", file=sys.stderr)
        raise typer.Exit(FAILED)


def sensitivity(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (YAML) of `design: saltelli`.")],
    out: StudyOut = None,
    jobs: Jobs = None,
    dask: Dask = None,
) -> None:
    """Say which cause makes which score vary: Sobol's indices with their intervals."""
    from scenarios.study.conduct import How
    from scenarios.study.sensitivity import sensitivity as find

    with shown() as (progress, say):
        folder, found = find(file, out, How(jobs or cores(), dask), progress, say)
    width = max(map(len, found.causes))
    for one in found.scores:
        print(f"{one.score}: mean {one.mean:.4g}, standard deviation {one.std:.3g}, {one.pairs} pairs")
        for i in (-one.total[:, 0]).argsort():
            first, total = (
                f"{value:6.3f} ({low:6.3f} {high:6.3f})" for value, low, high in (one.first[i], one.total[i])
            )
            print(f"  {found.causes[i]:<{width}}  first {first}  total {total}")
    for name, why in found.left_out.items():
        print(f"{name}: {why}")
    print(f"page: {folder / 'sensitivity.html'}")
    if found.counts["failed"]:
        print(f"{found.counts['failed']} runs failed; `pipetwin status {folder}` names them", file=sys.stderr)
        raise typer.Exit(FAILED)


def tune(
    file: Annotated[Path, typer.Argument(metavar="TUNE", help="A tuning file (YAML).")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder.  [default: tunings/NAME]")
    ] = None,
    jobs: Jobs = None,
    storage: Annotated[
        str | None, typer.Option("--storage", metavar="URL", help="Optuna's database.  [default: SQLite in DIR]")
    ] = None,
) -> None:
    """Search settings on some scans, and judge the winner on others that the search never saw."""
    from scenarios.study.tune import tune as run_tuning

    with shown() as (progress, say):
        tuned = run_tuning(file, out, jobs or cores(), progress, say, storage)
    for verdict in tuned.verdicts:
        print(f"hold-out, {verdict.fidelity}: {verdict.words}")
    print(f"method: {tuned.folder / 'method.yaml'}")
    print(f"page: {tuned.folder / 'tuning.html'}")


@contextmanager
def shown() -> Iterator[tuple[Progress, Callable[[str], None]]]:
    """What shows how far the work is, and what says a line beside it."""
    from scenarios.progress import Progress

    progress = Progress()

    def say(line: str) -> None:
        progress.close()
        print(line, file=sys.stderr)

    try:
        yield progress, say
    finally:
        progress.close()


def status(folder: StudyFolder, as_json: AsJson = False) -> None:
    """Say how far a study is, and which runs failed."""
    from scenarios.study.conduct import facts_of

    facts = facts_of(folder)
    if as_json:
        print(json.dumps(facts, indent=2))
        return
    failures = facts.pop("failures")
    width = max(map(len, facts))
    for name, value in facts.items():
        shown = "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
        print(f"{name:<{width}}  {shown}")
    for failure in failures:
        print(f"failed: {failure['key']} {failure['method']} seed {failure['seed']}: {failure['error']}")
    if facts["failed"] > len(failures):
        print(f"and {facts['failed'] - len(failures)} more; `pipetwin export` has them all")


def cache(
    clean: Annotated[bool, typer.Option("--clean", help="Remove what nobody uses at the moment.")] = False,
    keep_gb: Annotated[
        float | None, typer.Option("--keep-gb", metavar="GB", min=0, help="Remove the longest unused beyond this.")
    ] = None,
) -> None:
    """Say what the cache of stages holds, or clean it."""
    from scenarios.study.cache import GB, Cache, default_folder, default_limit_bytes

    limit = default_limit_bytes()
    stages = Cache(default_folder(), limit)
    if clean or keep_gb is not None:
        freed = stages.prune(0.0 if clean else (keep_gb or 0.0) * GB)
        print(f"removed {freed / 1e6:.1f} MB")
    print(f"{stages.folder}, at most {limit / GB:g} GB")
    for size in stages.sizes():
        print(f"{size.stage:<10} {size.entries:>7} entries  {size.bytes / 1e6:>10.1f} MB")
