"""A study from its file to its ledger and page; called again, it goes on where it was."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from scenarios.document import BadInput
from scenarios.study.code import code_version
from scenarios.study.engine import Engine, Processes
from scenarios.study.ledger import (
    FILE,
    LOCK,
    Ledger,
    LedgerFailed,
    Outcome,
    full_disk,
    is_held,
    only_parent,
    set_aside,
)
from scenarios.study.page import PAGE_FILE, write_page
from scenarios.study.plan import Recipe, differences, identity, planned_runs, recipe_of
from scenarios.study.study import Study, load_study

MAKE = "scenarios.study.scan:maker"
LOG = "workers.log"
FOLDER = "studies"
PAGE_EVERY_S, NOTE_EVERY_S = 15.0, 2.0
MOST_DIFFERENCES = 5
MOST_FAILURES = 20

Report = Callable[[str, int, int], None]
Say = Callable[[str], None]


@dataclass(frozen=True)
class How:
    """How a study is run, none of which changes a row."""

    workers: int
    dask: str | None = None
    resume: bool = True
    backwards: bool = False
    make: str = MAKE


def conduct(file: Path, out: Path | None, how: How, progress: Report, say: Say) -> tuple[Path, dict[str, int]]:
    """Run what is left of a study; returns its folder and how many runs are in each state.

    Raises:
        BadInput: when the study, its folder or its ledger cannot be used.
        LedgerFailed: when the disk is full.
        WorkersFail: when no worker can be started, or the scheduler goes away.
    """
    study = load_study(file)
    folder = out or Path(FOLDER) / study.name
    _check_ours(folder)
    with only_parent(folder), _kept_in_words(folder):
        if not how.resume and (aside := set_aside(folder)) is not None:
            say(f"the older ledger is kept as {aside}")
        with Ledger(folder) as ledger:
            recipe = recipe_of(study, code_version())
            _agree(ledger, study, recipe, say)
            ledger.recover()
            try:
                _work(ledger, engine(study, recipe, how, folder), how, progress, say)
            finally:
                # a Ctrl-C too leaves a ledger in which nothing seems to be running
                with suppress(LedgerFailed, BadInput):
                    ledger.interrupted()
            write_page(ledger, folder / PAGE_FILE)
            return folder, ledger.counts()


def _check_ours(folder: Path) -> None:
    """Refuse a folder that holds something else.

    Raises:
        BadInput: naming it.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise BadInput([f"{folder}: is there already and is no folder; choose another with --out"])
        others = {path.name for path in folder.iterdir()} - {LOCK} if folder.is_dir() else set()
    except OSError as error:
        raise BadInput([f"{folder}: cannot be read: {error.strerror}"]) from error
    if others and FILE not in others and not any(name.startswith("ledger-") for name in others):
        raise BadInput([f"{folder}: holds something that is no study; choose another folder with --out"])


def _agree(ledger: Ledger, study: Study, recipe: Recipe, say: Say) -> None:
    """Plan a new study, or make sure that an old one is this one.

    Raises:
        BadInput: naming what has changed, or when no run of the design is a sound scenario.
    """
    now = identity(study, recipe.code)
    was = ledger.about("identity")
    if was is None:
        say(f"planning {study.planned} runs")
        facts = {"identity": now, "name": study.name, "why": study.why, "planned": study.planned}
        facts |= {"methods": list(study.methods)}
        repeats = ledger.plan(planned_runs(study, recipe), facts)
        if repeats:
            say(f"{repeats} of {study.planned} runs are repeats of others, and made once")
        return
    if changed := list(differences(was, now)):
        said = [f"{ledger.file}: was begun with another study: {line}" for line in changed[:MOST_DIFFERENCES]]
        more = len(changed) - MOST_DIFFERENCES
        said += [f"{ledger.file}: and {more} more differences"] if more > 0 else []
        raise BadInput([*said, f"{ledger.folder}: choose another folder with --out, or begin anew with --no-resume"])


def engine(study: Study, recipe: Recipe, how: How, folder: Path) -> Engine:
    """Who makes the runs."""
    setup = {"make": how.make, "recipe": asdict(recipe), "memory_limit_mb": study.memory_limit_mb}
    if how.dask is not None:
        from scenarios.study.cluster import Cluster

        return Cluster(how.dask, setup, study.time_limit_s)
    return Processes(setup, how.workers, study.time_limit_s, folder / LOG)


def _work(ledger: Ledger, engine: Engine, how: How, progress: Report, say: Say) -> None:
    """Have every planned run made, and enter what becomes of it."""
    counts = ledger.counts()
    left = counts["planned"]
    if before := counts["done"] + counts["failed"]:
        say(f"{before} of {before + left} runs are in the ledger already, {counts['failed']} of them failed")
    if not left:
        return
    watch = _Watch(ledger, progress, left)
    with closing(engine.events(ledger.todo(how.backwards))) as events:  # type: ignore[type-var]  # they are generators
        for event in events:
            if isinstance(event, Outcome):
                if event.cause == "disk":
                    raise LedgerFailed(f"{event.error}; {full_disk(ledger.folder)}")
                ledger.finished([event])
                watch.done += 1
            elif event is not None:
                ledger.started(event)
            watch.look()


class _Watch:
    """Says on the terminal, in the ledger and on the page how far the study has come."""

    def __init__(self, ledger: Ledger, progress: Report, total: int) -> None:
        self.ledger, self.progress, self.total = ledger, progress, total
        self.done, self.said, self.since_s, self.noted_s, self.paged_s = 0, -1, time.time(), 0.0, 0.0

    def look(self) -> None:
        """Say it where the last word is old enough."""
        if self.done != self.said or self.done < self.total:
            self.said = self.done
            self.progress("study", self.done, self.total)
        now_s = time.time()
        if now_s - self.noted_s >= NOTE_EVERY_S:
            self.noted_s = now_s
            self.ledger.note("pace", {"since_s": self.since_s, "at_s": now_s, "done": self.done})
        if now_s - self.paged_s >= PAGE_EVERY_S:
            self.paged_s = now_s
            write_page(self.ledger, self.ledger.folder / PAGE_FILE, running=True)


@contextmanager
def _kept_in_words(folder: Path) -> Iterator[None]:
    """A full disk found by the page or the log is as clear as one found by the ledger."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise LedgerFailed(full_disk(folder)) from error


def facts_of(folder: Path) -> dict[str, Any]:
    """What a study's ledger says of it now.

    Raises:
        BadInput: when there is no ledger, or it cannot be read.
    """
    with opened(folder) as ledger:
        counts, pace = ledger.counts(), ledger.about("pace") or {}
        running = is_held(folder)
        elapsed_s = pace.get("at_s", 0.0) - pace.get("since_s", 0.0)
        rate = pace["done"] / elapsed_s if elapsed_s > 0 else None
        left = counts["planned"] + counts["running"]
        return {
            "name": ledger.about("name"),
            "runs": sum(counts.values()),
            **counts,
            "repeats": ledger.about("repeats"),
            "at_work": running,
            "runs_per_s": rate if running else None,
            "left_s": left / rate if running and rate else None,
            "worker_s": ledger.seconds(),
            "failures": [
                {"key": row.key, "method": row.method, "seed": row.seed, "cause": row.cause, "error": row.error}
                for row in ledger.failures(MOST_FAILURES)
            ],
        }


def opened(folder: Path) -> Ledger:
    """The ledger of a study, to read.

    Raises:
        BadInput: when there is none.
    """
    if not (folder / FILE).is_file():
        raise BadInput([f"{folder}: no study is there; give the folder that `pipetwin study` wrote"])
    return Ledger(folder, read_only=True)
