"""The commands `study`, `status`, `export` and `cache` as a person uses them."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import pytest

from scenarios import cli
from scenarios.document import BadInput
from scenarios.study import conduct
from scenarios.study.cache import Cache, entry_key
from scenarios.study.conduct import facts_of

LIKE_A_PERSON = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell that started us in the background switched off
from functools import partial
from scenarios.study import conduct
conduct.How = partial(conduct.How, make="standin:maker")
conduct.write_page = lambda *_, **__: None
from scenarios.cli import main
main()
"""


@pytest.fixture
def pipetwin(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Runs a command here; returns exit status, what it printed and what it said on stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(conduct, "How", partial(conduct.How, make="standin:maker"))

    def run(*words: str) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["pipetwin", *words])
        monkeypatch.setattr(signal, "signal", lambda *_: None)
        out, said = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(said), pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, out.getvalue(), said.getvalue()

    return run


def test_a_study_is_run_looked_at_and_exported(lab, pipetwin):
    lab.write()
    code, out, said = pipetwin("study", "study.yaml", "-j", "2")
    assert (code, out) == (0, "planned 0, running 0, done 48, failed 0\npage: studies/stand-in/study.html\n")
    assert said.startswith("planning 48 runs\n")
    assert "study: 48 of 48" in said
    code, out, _ = pipetwin("status", "studies/stand-in")
    assert code == 0
    assert "done        48" in out
    code, out, _ = pipetwin("export", "studies/stand-in", "--to", "parquet")
    assert out.splitlines() == ["studies/stand-in/runs.parquet", "studies/stand-in/defects.parquet"]
    code, out, said = pipetwin("study", "study.yaml")
    assert code == 0
    assert "48 of 48 runs are in the ledger already, 0 of them failed" in said


def test_failed_runs_are_named_and_the_status_is_1(lab, pipetwin):
    offset = ("sensing.points.pixel_noise_px: {low: 0.1, high: 0.4, steps: 2}", "drive.offset_mm.0: [-1]")
    lab.write(offset, ("  pipe.features.0.depth_mm: [1, 2, 3]\n", ""))
    code, out, said = pipetwin("study", "study.yaml", "--out", "out")
    assert code == 1
    assert "done 0, failed 8" in out
    assert said.endswith("8 runs failed; `pipetwin status out` names them\n")
    code, out, _ = pipetwin("status", "out")
    assert out.count("RuntimeError: it broke") == 8
    assert json.loads(pipetwin("status", "out", "--json")[1])["failed"] == 8


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["study", "none.yaml"], "none.yaml: no such file; give a study file (.yaml)"),
        (["status", "nowhere"], "nowhere: no study is there"),
        (["export", "nowhere"], "nowhere: no study is there"),
        (["study", "study.yaml", "--dask", "here"], "--dask: got 'here'; give it as tcp://HOST:PORT"),
        (["study", "study.yaml", "--out", "study.yaml"], "study.yaml: is there already and is no folder"),
    ],
)
def test_bad_input_is_one_line_and_status_2(lab, pipetwin, words, said):
    lab.write()
    code, out, errors = pipetwin(*words)
    assert (code, out) == (2, "")
    assert said in errors.splitlines()[-1]


def test_the_cache_is_looked_at_and_cleaned(pipetwin, tmp_path: Path):
    cache = Cache(tmp_path / "cache", 1e9)
    for number in range(3):
        with cache.entry("recording", entry_key(number), lambda folder: (folder / "x").write_bytes(bytes(1_000_000))):
            pass
    lines = pipetwin("cache")[1].splitlines()
    assert lines[0] == f"{tmp_path / 'cache'}, at most 20 GB"
    assert lines[2].split() == ["recording", "3", "entries", "3.0", "MB"]
    assert "removed 1.0 MB" in pipetwin("cache", "--keep-gb", "0.002")[1]
    assert "removed 2.0 MB" in pipetwin("cache", "--clean")[1]


@pytest.mark.parametrize(("which", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stop_by_hand_leaves_no_worker_and_a_ledger_that_goes_on(lab, which, status):
    environment = {**os.environ, "STANDIN_PAUSE_S": "0.5"}
    words = [
        sys.executable,
        "-c",
        LIKE_A_PERSON,
        "study",
        str(lab.write()),
        "--out",
        str(lab.folder / "out"),
        "-j",
        "2",
    ]
    study = subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while not _running(lab.folder / "out"):
        assert study.poll() is None
        time.sleep(0.05)
    workers = Path(f"/proc/{study.pid}/task/{study.pid}/children").read_text().split()
    os.killpg(study.pid, which)
    said = study.communicate(timeout=20)[1]
    assert study.returncode == status, said
    assert "pipetwin: stopped" in said
    assert len(workers) == 2
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()]
    facts = facts_of(lab.folder / "out")
    assert facts["running"] == 0
    assert facts["planned"] + facts["done"] == 48


def _running(folder: Path) -> bool:
    try:
        return facts_of(folder)["running"] == 2
    except BadInput:
        return False  # not begun yet
