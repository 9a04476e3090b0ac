"""A whole study: the same rows on any number of processes, in any order, on Dask, killed and resumed."""

from __future__ import annotations

import os
import subprocess

import pytest

from scenarios.document import BadInput
from scenarios.study import conduct as module
from scenarios.study.child import WorkersFail
from scenarios.study.conduct import facts_of, opened
from scenarios.study.ledger import Ledger, LedgerFailed, only_parent

RUNS = 3 * 2 * 4 * 2


@pytest.fixture
def expected(lab) -> list[bytes]:
    """The rows of an undisturbed study on one process."""
    assert lab.run(lab.write(), "expected") == {"planned": 0, "running": 0, "done": RUNS, "failed": 0}
    return lab.exported("expected")


@pytest.mark.parametrize("how", [{"workers": 2}, {"workers": 4}, {"workers": 2, "backwards": True}])
def test_rows_are_the_same_to_the_byte(lab, expected, how):
    lab.run(lab.write(), "other", **how)
    assert lab.exported("other") == expected


def test_rows_are_the_same_on_two_dask_workers(lab, expected, dask_cluster):
    assert lab.run(lab.write(), "dask", dask=dask_cluster)["done"] == RUNS
    assert lab.exported("dask") == expected


def test_on_dask_too_a_lost_process_costs_its_one_run(lab, dask_cluster):
    acts = ("[1, 2, 3]", "[1, 2]")
    text = lab.stand_in.replace(
        "sensing.points.pixel_noise_px: {low: 0.1, high: 0.4, steps: 2}", "drive.offset_mm.0: [0, -1, -3]"
    )
    text = text.replace("factors:\n  pipe.features.0.depth_mm: [1, 2, 3]\n  drive", "factors:\n  drive").replace(*acts)
    counts = lab.run(lab.write(text=text), "dask", dask=dask_cluster)
    assert counts == {"planned": 0, "running": 0, "done": 8, "failed": 16}
    with opened(lab.folder / "dask") as ledger:
        assert {row.cause for row in ledger.failures(20)} == {"raised", "killed"}


def test_when_a_dask_worker_dies_its_runs_go_to_another(lab, expected, lone_scheduler, two_workers, monkeypatch):
    finished = Ledger.finished

    def kill_in_between(ledger, outcomes):
        if ledger.counts()["done"] == 10:
            two_workers[0].kill()
        finished(ledger, outcomes)

    monkeypatch.setattr(Ledger, "finished", kill_in_between)
    assert lab.run(lab.write(), "dask", dask=lone_scheduler)["done"] == RUNS
    assert lab.exported("dask") == expected
    assert two_workers[0].poll() is not None


def test_a_scheduler_that_goes_away_stops_the_study_which_goes_on_after(lab, expected, lone_scheduler, two_workers):
    from scenarios.study import cluster

    file = lab.write()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "LOOK_S", 0.1)
        finished = Ledger.finished

        def lose_the_scheduler(ledger, outcomes):
            finished(ledger, outcomes)
            if ledger.counts()["done"] == 10:
                from distributed import Client

                with Client(lone_scheduler, set_as_default=False) as client:
                    client.shutdown()

        patch.setattr(Ledger, "finished", lose_the_scheduler)
        with pytest.raises(WorkersFail, match="goes on when it is back"):
            lab.run(file, "dask", dask=lone_scheduler)
    assert lab.run(file, "dask")["done"] == RUNS
    assert lab.exported("dask") == expected


def test_a_study_that_was_stopped_goes_on(lab, expected, monkeypatch):
    stopped = _Stop(after=20)
    with monkeypatch.context() as patch:
        patch.setattr(Ledger, "finished", stopped(Ledger.finished))
        with pytest.raises(KeyboardInterrupt):
            lab.run(lab.write(), "other", 2)
    with opened(lab.folder / "other") as ledger:
        counts = ledger.counts()
        before = {row.key for row in ledger.rows() if row.state == "done"}
    assert counts["running"] == 0
    assert counts["done"] == 20
    monkeypatch.setenv("STANDIN_LOG", str(lab.folder / "log"))
    counts, said = lab.run_saying(lab.write(), "other", 2)
    assert counts["done"] == RUNS
    assert said == ["20 of 48 runs are in the ledger already, 0 of them failed"]
    again = {line.split()[0] for line in (lab.folder / "log").read_text().splitlines()}
    assert len(again) == RUNS - 20
    assert not again & before
    assert lab.exported("other") == expected
    assert lab.run(lab.write(), "other", 2)["done"] == RUNS  # nothing is left to do


class _Stop:
    """Lets a method through so many times, and then is a Ctrl-C."""

    def __init__(self, after: int, error: BaseException | None = None) -> None:
        self.left, self.error = after, error or KeyboardInterrupt()

    def __call__(self, method):
        def call(*arguments):
            if self.left == 0:
                raise self.error
            self.left -= 1
            return method(*arguments)

        return call


def test_kills_at_random_instants_lose_nothing(campaign, tmp_path):
    kills = campaign("kills")
    said = kills.run(tmp_path / "kills", kills=4, seeds=60, pause_s=0.05, seed=1)
    assert "4 kills" in said


# ---- refusals


def test_a_study_changed_under_its_ledger_is_refused_and_the_difference_named(lab, expected):
    with pytest.raises(BadInput) as said:
        lab.run(lab.write(("[1, 2, 3]", "[1, 2, 4]")), "expected")
    assert "factors.pipe.features.0.depth_mm.values was [1, 2, 3] and is [1, 2, 4]" in said.value.lines[0]
    assert "--no-resume" in said.value.lines[-1]
    assert lab.run(lab.write(("name: stand-in", "name: stand-in\ntime_limit_s: 9")), "expected")["done"] == RUNS
    counts, told = lab.run_saying(lab.write(("[1, 2, 3]", "[1, 2, 4]")), "expected", resume=False)
    assert counts["done"] == RUNS
    assert "the older ledger is kept as" in told[0]


def test_two_parents_on_one_folder_are_refused(lab):
    with only_parent(lab.folder / "out"), pytest.raises(BadInput, match="works on this study"):
        lab.run(lab.write(), "out")


def test_a_folder_with_something_else_in_it_is_refused(lab):
    (lab.folder / "out").mkdir()
    (lab.folder / "out" / "thesis.tex").write_text("")
    with pytest.raises(BadInput, match="holds something that is no study"):
        lab.run(lab.write(), "out")
    with pytest.raises(BadInput, match="no study is there"):
        facts_of(lab.folder / "out")


@pytest.mark.parametrize("address", ["tcp://localhost", "file:///etc/passwd", "localhost:8786", "tcp://a b:1"])
def test_an_address_that_is_none_is_said(lab, address):
    with pytest.raises(BadInput, match="give it as tcp://HOST:PORT"):
        lab.run(lab.write(), "out", dask=address)


def test_an_unreachable_scheduler_is_one_clear_line(lab, monkeypatch):
    from scenarios.study import cluster

    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with pytest.raises(BadInput) as said:
        lab.run(lab.write(), "out", dask="tcp://127.0.0.1:9")
    assert said.value.lines == ["--dask tcp://127.0.0.1:9: no scheduler answers there within 0.5 s"]
    assert lab.run(lab.write(), "out")["done"] == RUNS


def test_a_scheduler_without_workers_is_said(lab, lone_scheduler, monkeypatch):
    from scenarios.study import cluster

    monkeypatch.setattr(cluster, "FIRST_WORKER_S", 0.5)
    with pytest.raises(WorkersFail, match="no worker has joined"):
        lab.run(lab.write(), "out", dask=lone_scheduler)


# ---- a full disk


def test_a_full_disk_in_a_worker_stops_the_study_and_it_goes_on_after(lab, expected, monkeypatch):
    full = ("{low: 0.1, high: 0.4, steps: 2}", "[0.1, 0.2]")
    with monkeypatch.context() as patch:
        patch.setenv("STANDIN_ACT", "-5")
        with pytest.raises(LedgerFailed, match=r"No space left on device; .*: no space left on this disk"):
            lab.run(lab.write(full), "full")
    assert lab.run(lab.write(full), "full")["done"] == RUNS


def test_a_full_disk_under_the_page_is_as_clear(lab, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(module, "write_page", full)
        with pytest.raises(LedgerFailed, match="what is finished is kept: free some, and the same command goes on"):
            lab.run(lab.write(), "out")
    assert lab.run(lab.write(), "out")["done"] == RUNS


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a small disk")
def test_a_really_full_disk_stops_with_a_clear_message_and_resumes(lab, expected):
    disk = lab.folder / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(70_000))
        with pytest.raises(LedgerFailed, match="no space left on this disk"):
            lab.run(lab.write(), "disk/study", 2)
        ballast.unlink()
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        assert lab.run(lab.write(), "disk/study", 2)["done"] == RUNS
        assert lab.exported("disk/study") == expected
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


# ---- looking at it


def test_status_says_how_far_it_is(lab, expected):
    facts = facts_of(lab.folder / "expected")
    assert facts["done"] == facts["runs"] == RUNS
    assert facts["at_work"] is False
    assert facts["failures"] == []
