"""The command line as a person uses it: what comes on which stream, with which exit status."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from scenarios import cli
from scenarios.document import parse
from scenarios.load import library, to_scenario

PIPETWIN = [sys.executable, "-m", "scenarios.cli"]

# the chain itself has its own tests; here `run` meets one that does as it is told
STAND_IN = """
import sys, time, types
from scenarios.run_folder import run_folder

class RunFailed(Exception):
    pass

RunFailed.__module__ = "scenarios.run"

def run(scenario, out, workers, progress):
    with run_folder(out) as work:
        (work / "score.json").write_text("")
        progress("draw", 1, 2)
        if scenario.seed == 1:
            raise RunFailed("stuck at 3.2 s")
        if scenario.seed == 2:
            raise ZeroDivisionError("division by zero")
        if scenario.seed == 3:
            print("waiting", file=sys.stderr, flush=True)
            time.sleep(60)
        progress("draw", 2, 2)
        (work / "run.json").write_text('{"pipetwin": "0"}')
    return {"defects_found": 2, "depth_error_mm_max": 0.123456789, "eq30": None, "workers": workers}

sys.modules["scenarios.run"] = types.SimpleNamespace(run=run, RunFailed=RunFailed)
sys.argv[0] = "pipetwin"
from scenarios.cli import main
main()
"""
STAND_IN_RUN = [sys.executable, "-c", STAND_IN, "run", "paper-gantry"]


def pipetwin(*words: str, cwd: Path, command: list[str] = PIPETWIN, **env: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **env}
    return subprocess.run([*command, *words], cwd=cwd, env=environment, capture_output=True, text=True, timeout=120)


def inside(monkeypatch: pytest.MonkeyPatch, *words: str) -> subprocess.CompletedProcess[str]:
    """The same without a process of its own, which saves a second of imports."""
    monkeypatch.setattr(sys, "argv", ["pipetwin", *words])
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    out, said = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(said), pytest.raises(SystemExit) as end:
        cli.main()
    return subprocess.CompletedProcess(list(words), end.value.code, out.getvalue(), said.getvalue())


def test_help_is_quick_and_loads_nothing_heavy(tmp_path: Path) -> None:
    heavy = ("numpy", "scipy", "numba", "pydantic", "ruamel", "yaml", "rich", "cv2", "mujoco", "pyrender", "matplotlib")
    code = f"""
import atexit, sys
atexit.register(lambda: print("LOADED", [m for m in {heavy} if m in sys.modules]))
sys.argv = ["pipetwin", "--help"]
from scenarios.cli import main
main()
"""
    started = time.perf_counter()
    result = pipetwin(command=[sys.executable, "-c", code], cwd=tmp_path)
    elapsed_s = time.perf_counter() - started
    assert result.returncode == 0
    assert "LOADED []" in result.stdout
    for command in ("demo", "list", "run", "check", "schema", "dump-config", "export-stl", "doctor"):
        assert f"\n  {command} " in result.stdout
    assert elapsed_s < 2  # 0.15 s on an idle core; the figure itself is a benchmark's


def test_list_has_a_line_for_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    known = json.loads(inside(monkeypatch, "list", "--json").stdout)
    assert set(known) == {"scenarios", "drives", "features", "registrations"}
    assert set(known["scenarios"]) == set(library())
    assert {"pocket", "pit", "scratch"} <= set(known["features"])
    assert all(line for group in known.values() for line in group.values())
    assert all("\n" not in line for group in known.values() for line in group.values())


def test_check_says_every_fault_on_stderr(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("name: a\nwhy: b\npipes: {}\n")
    result = pipetwin("check", "s.yaml", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert [line.split(": got")[0] for line in result.stderr.splitlines()] == [
        "s.yaml:1:1: drive",
        "s.yaml:3:1: pipes",
    ]


def test_check_says_which_optics_points_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ("optics.dirt.film=0.2", "optics.focus_mm=100", "optics.water.depth_mm=5", "fidelity=points")
    changes = [word for one in asked for word in ("--set", f"sensing.{one}")]
    result = inside(monkeypatch, "check", "paper-gantry", *changes)
    assert "no effect: dirt, focus_mm;" in result.stderr
    assert not inside(monkeypatch, "check", "paper-gantry", *changes[:-2]).stderr


def test_check_of_a_good_one(monkeypatch: pytest.MonkeyPatch) -> None:
    result = inside(monkeypatch, "check", "paper-gantry")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == "paper-gantry: ok: paper-gantry, 1300 mm of pipe with 2 features, drive gantry\n"


def test_dump_config_goes_back_in(monkeypatch: pytest.MonkeyPatch) -> None:
    result = inside(monkeypatch, "dump-config", "paper-gantry", "--seed", "5", "--set", "drive.speed_mm_s=20")
    scenario = to_scenario(parse(result.stdout, "dump"))
    assert (scenario.seed, scenario.drive.speed_mm_s) == (5, 20)


def test_export_stl_writes_the_carved_pipe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "pipe.stl"
    result = inside(monkeypatch, "export-stl", "paper-gantry", str(file))
    assert (result.returncode, result.stderr) == (0, "")
    triangles = int.from_bytes(file.read_bytes()[80:84], "little")
    assert file.stat().st_size == 84 + 50 * triangles
    result = inside(monkeypatch, "export-stl", "paper-gantry", str(tmp_path / "none" / "pipe.stl"))
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == f"{tmp_path}/none/pipe.stl: cannot be written: No such file or directory\n"
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.stl"]


def test_schema_is_a_schema(monkeypatch: pytest.MonkeyPatch) -> None:
    schema = json.loads(inside(monkeypatch, "schema").stdout)
    assert {"pipe", "drive", "sensing", "method", "seed"} <= set(schema["properties"])
    assert schema["additionalProperties"] is False


def test_doctor_says_how_each_thing_stands(tmp_path: Path) -> None:
    result = pipetwin("doctor", "--json", cwd=tmp_path, PIPETWIN_SHARED=str(tmp_path))
    checks = {check["name"]: check for check in json.loads(result.stdout)}
    assert {"python", "packages", "libegl1", "EGL context", "numba cache", "cores", "memory"} <= set(checks)
    assert all(check["ok"] or check["mend"] for check in checks.values())
    assert not checks["reference data"]["ok"]
    missing = [check for check in checks.values() if not check["ok"] and not check["optional"]]
    assert result.returncode == (1 if missing else 0)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "Usage: pipetwin"),
        (("rum",), "rum"),
        (("run",), "SCENARIO"),
        (("run", "paper-gantry", "--sed", "1"), "--seed"),
        (("run", "paper-gantry", "-j", "0"), "-j"),
        (("run", "paper-gantry", "--seed", "x"), "--seed"),
    ],
)
def test_wrong_usage_is_bad_input(tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    result = pipetwin(*words, cwd=tmp_path)
    assert result.returncode == 2
    assert says in result.stdout + result.stderr
    assert "Traceback" not in result.stderr


def test_run_with_bad_input_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "dear.txt").write_text("")
    for words, line in [
        (("--set", "pipe.features.0.depth_mm=9"), "--set pipe.features.0.depth_mm: got 9; must be at most the wall"),
        (("-o", "mine"), f"{tmp_path}/mine: holds something that is no pipetwin run"),
    ]:
        result = pipetwin(*words, command=STAND_IN_RUN, cwd=tmp_path)
        assert (result.returncode, result.stdout) == (2, "")
        assert result.stderr.startswith(line)
        assert result.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_run_prints_its_score_and_where_the_report_is(tmp_path: Path) -> None:
    result = pipetwin(command=STAND_IN_RUN, cwd=tmp_path)
    assert result.returncode == 0
    assert result.stdout.splitlines() == [
        "defects_found       2",
        "depth_error_mm_max  0.123457",
        "eq30                -",
        f"workers             {len(os.sched_getaffinity(0))}",
        "report: runs/paper-gantry-seed0/report.html",
    ]
    assert result.stderr.startswith("draw: 2 of 2")
    again = pipetwin("--json", "-j", "1", command=STAND_IN_RUN, cwd=tmp_path)
    assert json.loads(again.stdout) == {
        "defects_found": 2,
        "depth_error_mm_max": 0.123456789,
        "eq30": None,
        "workers": 1,
    }
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["paper-gantry-seed0"]


@pytest.mark.parametrize(
    ("seed", "line"),
    [
        ("1", "pipetwin: failed: stuck at 3.2 s (PIPETWIN_DEBUG=1 shows where)\n"),
        ("2", "pipetwin: failed: ZeroDivisionError: division by zero (PIPETWIN_DEBUG=1 shows where)\n"),
    ],
)
def test_a_failed_run_is_one_line_and_leaves_nothing(tmp_path: Path, seed: str, line: str) -> None:
    result = pipetwin("--seed", seed, command=STAND_IN_RUN, cwd=tmp_path, PIPETWIN_DEBUG="")
    assert (result.returncode, result.stdout, result.stderr) == (1, "", line)
    assert list((tmp_path / "runs").iterdir()) == []


def test_debug_shows_where(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> list:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("scenarios.doctor.examine", broken)
    monkeypatch.setenv("PIPETWIN_DEBUG", "1")
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["pipetwin", "doctor"])
    with pytest.raises(ZeroDivisionError):
        cli.main()


@pytest.mark.parametrize(("sent", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_run_is_one_line_and_leaves_nothing(tmp_path: Path, sent: signal.Signals, status: int) -> None:
    command = [*STAND_IN_RUN, "--seed", "3"]
    # a shell that starts tests in the background has them ignore Ctrl-C, and children inherit that
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **heard
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "waiting\n"
        process.send_signal(sent)
        out, said = process.communicate(timeout=30)
    assert (process.returncode, out) == (status, "")
    assert said == "pipetwin: stopped; nothing half-written is left\n"
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_reader_that_leaves_early_is_no_error(tmp_path: Path) -> None:
    result = subprocess.run(
        ["sh", "-c", '"$@" | head -n 1', "sh", *PIPETWIN, "schema"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (result.stdout, result.stderr) == ("{\n", "")
