"""The ledger of a study: one SQLite file with a row a run, written by one process only and whole after any kill."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, TypeAdapter

from scenarios.document import BadInput, shown
from scenarios.study.ledger_cells import FACTS, DamagedCell, checked, plain_of
from scenarios.study.plain import canonical

FILE, LOCK = "ledger.sqlite", "lock"
PLANNED, RUNNING, DONE, FAILED = range(4)
STATES = ("planned", "running", "done", "failed")
LOST = ("killed", "time", "memory")  # causes outside the run itself: a resumed study tries these again
MOST_ATTEMPTS = 3
PAGE = 1000
PATIENCE_S = 5.0
FULL_BELOW_BYTES = 1_000_000
FORMAT = 1
SCHEMA = f"""
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE runs (
  number INTEGER PRIMARY KEY,
  key TEXT NOT NULL UNIQUE,
  point INTEGER NOT NULL,
  method TEXT NOT NULL,
  seed INTEGER NOT NULL,
  setting TEXT NOT NULL,
  state INTEGER NOT NULL,
  cause TEXT,
  error TEXT,
  seconds REAL,
  attempts INTEGER NOT NULL DEFAULT 0,
  figures TEXT,
  defects TEXT
);
CREATE INDEX runs_by_state ON runs (state, number);
PRAGMA user_version = {FORMAT};
"""


class LedgerFailed(RuntimeError):
    """The ledger cannot be written on; the message says why, and what is kept."""


class PlannedRun(NamedTuple):
    """One run before it is made; `fault` says why its values cannot be a scenario."""

    key: str
    point: int
    method: str
    seed: int
    values: tuple[Any, ...]
    fault: str = ""


class Job(NamedTuple):
    """One run as it is handed out."""

    key: str
    point: int
    method: str
    seed: int
    values: list[Any]


class Outcome(NamedTuple):
    """What became of a run: its figures and its defects, found or missed, or the cause and words of failure."""

    key: str
    seconds: float
    figures: list[float | int | None] | None = None
    defects: list[list[float]] | None = None
    cause: str | None = None
    error: str | None = None


class Row(NamedTuple):
    """A run as the ledger has it."""

    key: str
    point: int
    method: str
    seed: int
    values: list[Any]
    state: str
    cause: str | None
    error: str | None
    seconds: float | None
    figures: list[float | int | None]
    defects: list[list[float]]


ROW, LIST = TypeAdapter(Row), TypeAdapter(list)
STATE = TypeAdapter(Annotated[int, Field(ge=PLANNED, le=FAILED)])


@contextmanager
def only_parent(folder: Path) -> Iterator[None]:
    """Hold a study's folder; a second process is refused, and a kill lets go.

    Raises:
        BadInput: when another process holds it, or the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise BadInput([f"{folder}: cannot be written: {error.strerror}; choose another folder with --out"]) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(handle, 20, 0).decode(errors="replace").strip()
            who = f"process {holder}" if holder.isdigit() else "another process"
            line = f"{folder}: {who} works on this study; wait for it, or choose another folder with --out"
            raise BadInput([line]) from None
        with _full_disk_said(folder):
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(handle)


def is_held(folder: Path) -> bool:
    """Whether a process works on a study now."""
    try:
        with (folder / LOCK).open("rb") as handle:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


class Ledger:
    """The open ledger; every change is committed before the call returns, and a commit survives any kill."""

    def __init__(self, folder: Path, read_only: bool = False) -> None:
        self.folder, self.file = folder, folder / FILE
        with self._said():
            self._check_whole()
            how = "ro" if read_only else "rwc"
            self.base = sqlite3.connect(
                f"{self.file.absolute().as_uri()}?mode={how}", uri=True, timeout=PATIENCE_S, isolation_level=None
            )
            try:
                self._opened(read_only)
            except BaseException:
                self.base.close()
                raise

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.base.close()

    def _opened(self, read_only: bool) -> None:
        version = self.base.execute("PRAGMA user_version").fetchone()[0]
        if version not in (0, FORMAT):
            raise BadInput([f"{self.file}: a ledger of format {version}; this program reads format {FORMAT}"])
        if not read_only:
            self.base.execute("PRAGMA journal_mode = WAL")
            self.base.execute("PRAGMA synchronous = NORMAL")  # a commit outlives any process, not a power cut
        if version == 0:
            if read_only or self.base.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                raise BadInput([f"{self.file}: is no ledger of a study"])
            self.base.executescript(f"BEGIN; {SCHEMA} COMMIT;")

    def _check_whole(self) -> None:
        """Compare the file's length with the one its header states, which a truncated file belies."""
        if not self.file.is_file() or (size := self.file.stat().st_size) == 0:
            return
        log = self.file.with_name(f"{FILE}-wal")
        if log.exists() and log.stat().st_size:
            return  # SQLite completes the file from its log
        with self.file.open("rb") as start:
            head = start.read(100)
        page = int.from_bytes(head[16:18], "big")
        stated = int.from_bytes(head[28:32], "big") * (65536 if page == 1 else page)
        if not head.startswith(b"SQLite format 3\0") or size < stated:
            raise sqlite3.DatabaseError(f"it has {size} bytes of {stated}" if len(head) == 100 else "it is cut short")

    @contextmanager
    def _said(self) -> Iterator[None]:
        """SQLite's errors in words that say what to do."""
        try:
            with _full_disk_said(self.folder):
                yield
        except (DamagedCell, UnicodeDecodeError, sqlite3.DatabaseError) as error:  # SQLite quotes a damaged schema
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise BadInput([f"{self.file}: another program has locked it; close that and try again"]) from error
            if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM):
                raise BadInput([f"{self.file}: cannot be opened: {error}"]) from error
            if code == sqlite3.SQLITE_FULL or (code == sqlite3.SQLITE_IOERR and _is_full(self.folder)):
                raise LedgerFailed(full_disk(self.folder)) from error
            mend = "move it away to begin anew"
            raise BadInput([f"{self.file}: is damaged ({error}); what was in it cannot be trusted; {mend}"]) from error

    # ---- planning

    def about(self, name: str) -> Any:
        """A fact about the study, None where it is not there."""
        with self._said():
            found = self.base.execute("SELECT value FROM about WHERE name = ?", (name,)).fetchone()
            return None if found is None else plain_of(found[0], FACTS[name], name)

    def note(self, name: str, value: Any) -> None:
        """Write down a fact about the study."""
        with self._said():
            self.base.execute("INSERT OR REPLACE INTO about VALUES (?, ?)", (name, canonical(value)))

    def plan(self, runs: Iterable[PlannedRun], facts: dict[str, Any]) -> int:
        """Enter all planned runs and the facts about them, all or nothing; returns how many were repeats of others."""
        repeats = 0
        with self._said():
            self.base.execute("BEGIN IMMEDIATE")
            try:
                for number, run in enumerate(runs):
                    repeats += 1 - self._enter(number, run)
                facts = {**facts, "repeats": repeats}
                lines = [(name, canonical(value)) for name, value in facts.items()]
                self.base.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", lines)
                self.base.execute("COMMIT")
            except BaseException:
                self.base.execute("ROLLBACK") if self.base.in_transaction else None
                raise
        return repeats

    def _enter(self, number: int, run: PlannedRun) -> int:
        state, cause = (FAILED, "invalid") if run.fault else (PLANNED, None)
        return self.base.execute(
            "INSERT OR IGNORE INTO runs (number, key, point, method, seed, setting, state, cause, error)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                number,
                run.key,
                run.point,
                run.method,
                run.seed,
                canonical(run.values),
                state,
                cause,
                run.fault or None,
            ),
        ).rowcount

    # ---- running

    def recover(self) -> None:
        """Plan again what was running when the last process died, and what was lost to no fault of its own."""
        lost = ", ".join(f"'{cause}'" for cause in LOST)
        self.interrupted()
        with self._said():
            self.base.execute(
                f"UPDATE runs SET state = ?, cause = NULL, error = NULL, seconds = NULL"  # noqa: S608  our own words
                f" WHERE state = ? AND cause IN ({lost}) AND attempts < ?",
                (PLANNED, FAILED, MOST_ATTEMPTS),
            )

    def interrupted(self) -> None:
        """Plan again what was running."""
        with self._said():
            self.base.execute("UPDATE runs SET state = ? WHERE state = ?", (PLANNED, RUNNING))

    def todo(self, backwards: bool = False) -> Iterator[Job]:
        """Every planned run, in the design's order; read in pages, so that no reading holds up the writing."""
        beyond, order = (">", "ASC") if not backwards else ("<", "DESC")
        last = -1 if not backwards else 2**62
        query = (
            "SELECT number, key, point, method, seed, setting FROM runs"  # noqa: S608  our own words
            f" WHERE state = ? AND number {beyond} ? ORDER BY number {order} LIMIT {PAGE}"
        )
        while True:
            with self._said():
                page = self.base.execute(query, (PLANNED, last)).fetchall()
            if not page:
                return
            last = page[-1][0]
            for _, key, point, method, seed, setting in page:
                yield Job(key, point, method, seed, json.loads(setting))

    def started(self, keys: list[str]) -> None:
        """Note that runs were handed to a worker."""
        with self._said(), self._one_commit():
            self.base.executemany("UPDATE runs SET state = ? WHERE key = ?", [(RUNNING, key) for key in keys])

    def finished(self, outcomes: list[Outcome]) -> None:
        """Enter what became of runs; one that is done stays as it is."""
        rows = [
            (
                FAILED if o.cause else DONE,
                o.cause,
                o.error,
                round(o.seconds, 3),
                canonical(o.figures) if o.figures is not None else None,
                canonical(o.defects) if o.defects is not None else None,
                o.key,
                DONE,
            )
            for o in outcomes
        ]
        with self._said(), self._one_commit():
            self.base.executemany(
                "UPDATE runs SET state = ?, cause = ?, error = ?, seconds = ?, figures = ?, defects = ?,"
                " attempts = attempts + 1 WHERE key = ? AND state != ?",
                rows,
            )

    @contextmanager
    def _one_commit(self) -> Iterator[None]:
        self.base.execute("BEGIN IMMEDIATE")
        try:
            yield
            self.base.execute("COMMIT")
        except BaseException:
            if self.base.in_transaction:
                self.base.execute("ROLLBACK")
            raise

    # ---- reading

    def counts(self) -> dict[str, int]:
        """How many runs are in each state."""
        with self._said():
            found = dict(self.base.execute("SELECT state, count(*) FROM runs GROUP BY state").fetchall())
        return {name: found.get(state, 0) for state, name in enumerate(STATES)}

    def seconds(self) -> float:
        """Worker seconds of all runs together."""
        with self._said():
            return float(self.base.execute("SELECT coalesce(sum(seconds), 0) FROM runs").fetchone()[0])

    def failures(self, most: int) -> list[Row]:
        """The first failed runs, in the design's order."""
        return list(self._rows("WHERE state = ? ORDER BY number LIMIT ?", (FAILED, most)))

    def rows(self, by_key: bool = True) -> Iterator[Row]:
        """Every run, by its key or in the design's order."""
        return self._rows(f"ORDER BY {'key' if by_key else 'number'}", ())

    def _rows(self, which: str, values: tuple) -> Iterator[Row]:
        columns = "key, point, method, seed, setting, state, cause, error, seconds, figures, defects"
        with self._said():
            for key, point, method, seed, setting, state, cause, error, seconds, figures, defects in self.base.execute(
                f"SELECT {columns} FROM runs {which}",  # noqa: S608  our own words
                values,
            ):
                what = f"run {shown(key)}"
                held = [plain_of(cell or "[]", LIST, what) for cell in (setting, figures, defects)]
                checked(state, STATE, what)
                row = Row(key, point, method, seed, held[0], STATES[state], cause, error, seconds, *held[1:])
                checked(row, ROW, what)
                yield row


def set_aside(folder: Path) -> Path | None:
    """Give an old ledger another name, so that a study can begin anew; returns the name."""
    if not (folder / FILE).exists():
        return None
    aside = folder / f"ledger-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.sqlite"
    for ending in ("-wal", "-shm", ""):
        old = folder / f"{FILE}{ending}"
        if old.exists():
            old.rename(folder / f"{aside.name}{ending}")
    return aside


def full_disk(place: Path) -> str:
    """What to say of a full disk."""
    return f"{place}: no space left on this disk; what is finished is kept: free some, and the same command goes on"


@contextmanager
def _full_disk_said(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        raise LedgerFailed(full_disk(folder)) from error


def _is_full(folder: Path) -> bool:
    return shutil.disk_usage(folder).free < FULL_BELOW_BYTES
