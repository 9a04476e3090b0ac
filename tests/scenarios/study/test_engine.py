"""Workers may raise, hang, run out of memory or be killed: each costs its one run, which is named."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from scenarios.study import child as child_module
from scenarios.study.child import WorkersFail
from scenarios.study.code import code_version
from scenarios.study.engine import Processes, groups
from scenarios.study.ledger import Job, Outcome

RAISES, HANGS, IS_KILLED, HOGS, FILLS_DISK, PRINTS, EXITS = range(-1, -8, -1)
LIMIT_S = 3.0


def _setup(make: str = "standin:maker", **changes: object) -> dict:
    recipe = {"record": ["a", "b"], "code": code_version()}
    return {"make": make, "recipe": recipe, "memory_limit_mb": 200, **changes}


def _jobs(acts: Iterable[int]) -> list[Job]:
    return [Job(f"{i:032x}", i, "m", 0, [act]) for i, act in enumerate(acts)]


def _outcomes(engine: Processes, jobs: list[Job]) -> dict[int, Outcome]:
    found = [event for event in engine.events(jobs) if isinstance(event, Outcome)]
    assert len({outcome.key for outcome in found}) == len(found)
    return {int(outcome.key, 16): outcome for outcome in found}


@pytest.fixture(scope="module")
def misbehaved(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Outcome]:
    acts = [0, RAISES, HANGS, IS_KILLED, HOGS, FILLS_DISK, PRINTS, EXITS, *[0] * 40]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).resolve().parents[3] / "campaigns"))
        log = tmp_path_factory.mktemp("engine") / "workers.log"
        return _outcomes(Processes(_setup(), 2, LIMIT_S, log), _jobs(acts))


@pytest.mark.parametrize(
    ("number", "cause", "words"),
    [
        (1, "raised", "RuntimeError: it broke"),
        (2, "time", "took more than the time limit of 3 s"),
        (3, "killed", "its worker ended: killed by signal 9"),
        (4, "memory", "ran out of memory"),
        (5, "disk", "No space left on device"),
        (7, "killed", "its worker ended: exit status 3"),
    ],
)
def test_a_run_that_misbehaves_is_named_with_its_cause(misbehaved, number, cause, words):
    assert misbehaved[number].cause == cause
    assert words in misbehaved[number].error
    assert misbehaved[number].figures is None


def test_and_the_rest_goes_on(misbehaved):
    assert sorted(misbehaved) == list(range(48))
    assert [k for k, outcome in misbehaved.items() if outcome.cause is not None and k not in (1, 2, 3, 4, 5, 7)] == []
    assert misbehaved[6].figures is not None  # what a library prints is no answer


def test_what_shares_a_recording_travels_together():
    jobs = [Job(f"{i}", i // 6, "abc"[i % 3], i // 3 % 2, []) for i in range(12)]
    assert [[job.key for job in group] for group in groups(jobs)] == [
        [str(i) for i in range(first, first + 3)] for first in (0, 3, 6, 9)
    ]


def test_a_worker_with_other_code_takes_no_part():
    setup = _setup(recipe={"record": [], "code": "other"})
    with pytest.raises(WorkersFail, match="it runs other code"):
        _outcomes(Processes(setup, 1, LIMIT_S), _jobs([0]))


def test_workers_that_cannot_start_are_given_up_with_their_last_words(tmp_path: Path):
    with pytest.raises(WorkersFail, match=r"ended as it started .*: .*No module named 'nowhere'"):
        _outcomes(Processes(_setup("nowhere:maker"), 1, LIMIT_S, tmp_path / "log"), _jobs([0]))


def test_a_worker_that_does_not_get_ready_is_given_up(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(child_module, "STARTS_WITHIN_S", 0.0)
    with pytest.raises(WorkersFail, match="did not start within 0 s"):
        _outcomes(Processes(_setup(), 1, LIMIT_S), _jobs([0]))


def test_a_worker_killed_while_idle_or_starting_costs_nothing():
    events = Processes(_setup(), 2, LIMIT_S).events(_jobs([0] * 6))
    started = False
    found = []
    for event in events:
        if not started:
            os.kill(_a_child(), signal.SIGKILL)
            started = True
        found += [event] if isinstance(event, Outcome) else []
    assert len(found) == 6


def test_closing_the_engine_ends_its_workers():
    events = Processes(_setup(), 2, 60.0).events(_jobs([HANGS, HANGS]))
    next(event for event in events if isinstance(event, list))
    pid = _a_child()
    started_s = time.monotonic()
    events.close()
    assert time.monotonic() - started_s < 2
    assert not Path(f"/proc/{pid}").exists()


def _a_child() -> int:
    """A worker of ours; there may be other children, such as a Dask cluster's."""
    every = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return next(int(pid) for pid in every if b"study.worker" in Path(f"/proc/{pid}/cmdline").read_bytes())
