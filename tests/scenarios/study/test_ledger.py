"""The ledger: nothing planned disappears, what is done stays, and a file that cannot be trusted is refused."""

from __future__ import annotations

import errno
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from scenarios.document import BadInput
from scenarios.study import ledger as module
from scenarios.study.ledger import FILE, Ledger, LedgerFailed, Outcome, PlannedRun, is_held, only_parent, set_aside


def _runs(n: int) -> list[PlannedRun]:
    return [PlannedRun(f"{i:032x}", i // 2, "ab"[i % 2], 0, (i, "x")) for i in range(n)]


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    with Ledger(tmp_path) as ledger:
        assert ledger.plan(_runs(6), {"name": "six"}) == 0
    return tmp_path


def _done(key: int, figure: float = 0.1) -> Outcome:
    return Outcome(f"{key:032x}", 1.0, [figure, None], [[1.0, 2.0]])


def test_rows_come_back_as_they_went_in(planned: Path):
    with Ledger(planned) as ledger:
        ledger.started([f"{3:032x}"])
        assert ledger.counts() == {"planned": 5, "running": 1, "done": 0, "failed": 0}
        ledger.finished([_done(3, 0.1 + 0.2), Outcome(f"{4:032x}", 2.0, cause="raised", error="it broke")])
    with Ledger(planned, read_only=True) as ledger:
        rows = list(ledger.rows())
        assert [row.state for row in rows] == ["planned"] * 3 + ["done", "failed", "planned"]
        assert rows[3].figures == [0.1 + 0.2, None]
        assert rows[3].values == [3, "x"]
        assert rows[3].defects == [[1.0, 2.0]]
        (failed,) = ledger.failures(10)
        assert (failed.cause, failed.error) == ("raised", "it broke")
        assert ledger.seconds() == 3.0
        assert ledger.about("name") == "six"
        assert ledger.about("repeats") == 0


def test_what_is_done_stays_done(planned: Path):
    with Ledger(planned) as ledger:
        ledger.finished([_done(0, 1.0)])
        ledger.finished([_done(0, 2.0), Outcome(f"{0:032x}", 0.0, cause="killed", error="late")])
        ledger.recover()
        assert next(ledger.rows()).figures == [1.0, None]


def test_a_resumed_study_does_what_was_running_or_lost_but_no_failure_of_its_own(planned: Path):
    with Ledger(planned) as ledger:
        ledger.started([f"{k:032x}" for k in range(4)])
        causes = ["killed", "time", "raised"]
        ledger.finished([Outcome(f"{k:032x}", 0.0, cause=cause, error="x") for k, cause in enumerate(causes)])
        ledger.recover()
        assert [int(job.key, 16) for job in ledger.todo()] == [0, 1, 3, 4, 5]
        assert [int(job.key, 16) for job in ledger.todo(backwards=True)] == [5, 4, 3, 1, 0]


def test_a_run_that_is_always_lost_is_given_up(planned: Path):
    with Ledger(planned) as ledger:
        for _ in range(module.MOST_ATTEMPTS):
            assert ledger.counts()["failed"] == 0
            ledger.finished([Outcome(f"{0:032x}", 0.0, cause="memory", error="x")])
            ledger.recover()
        assert ledger.counts()["failed"] == 1


def test_jobs_are_read_in_pages_while_the_ledger_is_written(planned: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "PAGE", 2)
    with Ledger(planned) as ledger:
        seen = []
        for job in ledger.todo():
            seen.append(int(job.key, 16))
            ledger.started([job.key])
            ledger.finished([Outcome(job.key, 0.0, [1.0], [])])
        assert seen == list(range(6))


def test_a_repeat_is_counted_and_an_invalid_run_is_a_failure(tmp_path: Path):
    with Ledger(tmp_path) as ledger:
        runs = [*_runs(2), _runs(1)[0], PlannedRun("f" * 32, 9, "a", 0, (), "does not fit")]
        assert ledger.plan(runs, {}) == 1
        assert ledger.counts() == {"planned": 2, "running": 0, "done": 0, "failed": 1}
        assert ledger.failures(1)[0].error == "does not fit"


def test_planning_is_all_or_nothing(tmp_path: Path):
    def broken():
        yield from _runs(3)
        raise KeyboardInterrupt

    with Ledger(tmp_path) as ledger:
        with pytest.raises(KeyboardInterrupt):
            ledger.plan(broken(), {"identity": 1})
        assert ledger.about("identity") is None
        assert sum(ledger.counts().values()) == 0


# ---- files that cannot be used


def _truncated(file: Path) -> None:
    os.truncate(file, file.stat().st_size // 2)


def _cut_short(file: Path) -> None:
    os.truncate(file, 50)


def _overwritten(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:4096] + b"\xff" * (file.stat().st_size - 4096))


def _text(file: Path) -> None:
    file.write_text("no database " * 1000)


def _edited(change: str):
    def harm(file: Path) -> None:
        with sqlite3.connect(file) as base:
            base.execute(change)
        base.close()

    return harm


CELLS = [
    "UPDATE runs SET defects = '{'",
    "UPDATE runs SET figures = '[\"x\"]'",
    "UPDATE runs SET state = 9",
    "UPDATE runs SET setting = printf('%.*c', 5000, '[')",
    "ALTER TABLE runs RENAME COLUMN figures TO other",
    "UPDATE about SET value = '[1]' WHERE name = 'name'",
]


@pytest.mark.parametrize("harm", [_truncated, _cut_short, _overwritten, _text, *map(_edited, CELLS)])
def test_a_damaged_ledger_is_one_clear_line(planned: Path, harm):
    harm(planned / FILE)
    with pytest.raises(BadInput) as said, Ledger(planned) as ledger:
        assert (list(ledger.rows()), ledger.about("name")) is None
    assert len(said.value.lines) == 1
    assert "is damaged" in said.value.lines[0]
    assert "move it away to begin anew" in said.value.lines[0]


def test_somebody_else_s_database_is_refused(tmp_path: Path):
    base = sqlite3.connect(tmp_path / FILE)
    base.execute("CREATE TABLE theirs (x)")
    base.close()
    with pytest.raises(BadInput, match="is no ledger of a study"):
        Ledger(tmp_path)


def test_a_newer_format_is_refused(planned: Path):
    base = sqlite3.connect(planned / FILE)
    base.execute("PRAGMA user_version = 9")
    base.close()
    with pytest.raises(BadInput, match="format 9; this program reads format 1"):
        Ledger(planned)


def test_a_locked_ledger_is_one_clear_line(planned: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "PATIENCE_S", 0.1)
    base = sqlite3.connect(planned / FILE, isolation_level=None)
    base.execute("BEGIN EXCLUSIVE")
    with pytest.raises(BadInput, match="another program has locked it"), Ledger(planned) as ledger:
        ledger.started([f"{0:032x}"])
    base.close()


def test_a_full_disk_is_said_and_what_is_done_is_kept(planned: Path, monkeypatch: pytest.MonkeyPatch):
    with Ledger(planned) as ledger:
        ledger.finished([_done(0)])
        ledger.base.execute(f"PRAGMA max_page_count = {ledger.base.execute('PRAGMA page_count').fetchone()[0]}")
        with pytest.raises(LedgerFailed, match="no space left on this disk; what is finished is kept"):
            ledger.note("much", "x" * 1_000_000)
    with Ledger(planned) as ledger:
        ledger.note("much", "x" * 1_000_000)
        assert ledger.counts()["done"] == 1


def test_two_parents_on_one_folder_are_refused_and_a_kill_lets_go(tmp_path: Path):
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdin is not None
    with holder.stdout, holder.stdin:
        assert holder.stdout.readline() == "held\n"
        assert is_held(tmp_path)
        with pytest.raises(BadInput, match=f"process {holder.pid} works on this study"), only_parent(tmp_path):
            pass
        holder.kill()
        holder.wait()
    assert not is_held(tmp_path)
    with only_parent(tmp_path):
        assert is_held(tmp_path)


HOLD = """
import sys
from pathlib import Path
from scenarios.study.ledger import only_parent
with only_parent(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"), only_parent(tmp_path / "file"):
        pass


def test_an_error_of_ours_is_not_taken_for_a_full_disk(tmp_path: Path):
    with pytest.raises(OSError, match="input"), module._full_disk_said(tmp_path):
        raise OSError(errno.EIO, "input/output error")


def test_an_old_ledger_is_kept_under_another_name(planned: Path):
    aside = set_aside(planned)
    assert aside is not None
    assert aside.is_file()
    assert not (planned / FILE).exists()
    assert set_aside(planned) is None
