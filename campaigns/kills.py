"""Kills a study at random instants, parent, worker or whole group, and checks that nothing finished is ever lost."""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from scenarios.study.conduct import opened
from scenarios.study.export import export
from scenarios.study.ledger import FILE

ROOT = Path(__file__).resolve().parents[1]
STUDY = """
name: kills
base: paper-gantry
set: {{sensing.fidelity: points}}
factors:
  sensing.points.pixel_noise_px: [0.1, 0.2, 0.3]
design: {{kind: grid, seeds: {seeds}}}
methods:
  default: {{}}
  coarse: {{map.cell_z_mm: 5}}
"""
DRIVER = """
import sys, time
started = time.time()
from pathlib import Path
from scenarios.study import conduct as study
from scenarios.study.conduct import How, conduct

study.write_page = lambda *_, **__: None  # its pictures take longer than all the rest

def said(stage, done, total):
    global started
    if started:
        print("first job after", time.time() - started, flush=True)
        started = 0

conduct(Path(sys.argv[1]), Path(sys.argv[2]), How(2, make="standin:maker"), said, lambda line: None)
"""
TARGETS = ("parent", "worker", "group")
DIES_WITHIN_S = 5.0
LATEST_KILL_S = 2.5


@dataclass
class Campaign:
    """What has been seen so far."""

    folder: Path
    study: Path
    log: Path
    rng: random.Random
    kept: dict[str, list] = field(default_factory=dict)
    kills: Counter = field(default_factory=Counter)
    log_lines: int = 0
    longest_orphan_s: float = 0.0
    slowest_start_s: float = 0.0


def main() -> None:
    """Kill as often as asked, then let the study end and compare it with one that nobody disturbed."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--kills", type=int, default=200)
    words.add_argument("--seeds", type=int, default=3000)
    words.add_argument("--pause-s", type=float, default=0.02)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("folder", type=Path)
    asked = words.parse_args()
    print(run(asked.folder, asked.kills, asked.seeds, asked.pause_s, asked.seed))


def run(folder: Path, kills: int, seeds: int, pause_s: float, seed: int) -> str:
    """Make the campaign in an empty folder; returns what was seen, in words.

    Raises:
        AssertionError: when a promise was broken.
    """
    folder.mkdir(parents=True)
    study = folder / "study.yaml"
    study.write_text(STUDY.format(seeds=seeds))
    seen = Campaign(folder / "out", study, folder / "started.log", random.Random(seed))
    parent = None
    while sum(seen.kills.values()) < kills:
        if parent is None or parent.poll() is not None:
            parent = start(seen, pause_s)
        time.sleep(seen.rng.uniform(0, LATEST_KILL_S))
        if parent.poll() is not None:
            raise AssertionError(f"the study came to an end after {seen.kills}; give more seeds")
        strike(seen, parent)
    if parent is not None and parent.returncode is None:
        parent.kill()
        end(seen, parent)
    for _ in range(2):  # a killed worker's run is a failure, which the next start tries again
        assert end(seen, start(seen, 0.0)) == 0, "the last start failed"  # noqa: S101
    look(seen)
    again = Campaign(folder / "undisturbed", study, folder / "undisturbed.log", seen.rng)
    assert end(again, start(again, 0.0)) == 0, "the undisturbed study failed"  # noqa: S101
    assert rows(seen.folder) == rows(again.folder), "the rows differ from those of an undisturbed study"  # noqa: S101
    return (
        f"{sum(seen.kills.values())} kills {dict(seen.kills)}: {len(seen.kept)} runs done, none lost, none run again "
        f"once done, rows as undisturbed; children gone after at most {seen.longest_orphan_s:.2f} s, first job at most "
        f"{seen.slowest_start_s:.2f} s after a start"
    )


def start(seen: Campaign, pause_s: float) -> subprocess.Popen:
    """Start or resume the study as a process group of its own."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "campaigns"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "STANDIN_LOG": str(seen.log), "STANDIN_PAUSE_S": str(pause_s)}
    command = [sys.executable, "-c", DRIVER, str(seen.study), str(seen.folder)]
    return subprocess.Popen(command, env=environment, start_new_session=True, stdout=subprocess.PIPE, text=True)


def strike(seen: Campaign, parent: subprocess.Popen) -> None:
    """Kill one of the processes, or all, and check what must hold after it."""
    target = seen.rng.choice(TARGETS)
    workers = children(parent.pid)
    seen.kills[target] += 1
    if target == "worker" and workers:
        with suppress(ProcessLookupError):
            os.kill(seen.rng.choice(workers), signal.SIGKILL)
        return
    if target == "group":
        os.killpg(parent.pid, signal.SIGKILL)
    else:
        parent.kill()
    end(seen, parent)
    killed_s = time.monotonic()
    while any(alive(worker) for worker in workers):
        assert time.monotonic() - killed_s < DIES_WITHIN_S, "a worker outlives its parent"  # noqa: S101
        time.sleep(0.01)
    seen.longest_orphan_s = max(seen.longest_orphan_s, time.monotonic() - killed_s)
    look(seen)


def end(seen: Campaign, parent: subprocess.Popen) -> int:
    """Wait for the parent's end, and take the time that it needed to its first job."""
    said = parent.communicate()[0].split()
    if said:
        seen.slowest_start_s = max(seen.slowest_start_s, float(said[-1]))
    return parent.returncode


def look(seen: Campaign) -> None:
    """Open the ledger and the log of started runs: what was done is still done, and was not started again."""
    lines = seen.log.read_text().splitlines() if seen.log.exists() else []
    again = {line.split()[0] for line in lines[seen.log_lines :]} & seen.kept.keys()
    assert not again, f"{len(again)} runs were made again although done"  # noqa: S101
    seen.log_lines = len(lines)
    if not (seen.folder / FILE).exists():
        return
    with opened_or_begun(seen.folder) as ledger:
        now = {row.key: row.figures for row in ledger.rows() if row.state == "done"}
    lost = [key for key, figures in seen.kept.items() if now.get(key) != figures]
    assert not lost, f"{len(lost)} finished runs are lost"  # noqa: S101
    seen.kept = now


def opened_or_begun(folder: Path):
    """The ledger to read; one that was killed while its first page was written is begun by whoever writes next."""
    from scenarios.study.ledger import Ledger

    return Ledger(folder) if (folder / FILE).stat().st_size == 0 else opened(folder)


def rows(folder: Path) -> list[bytes]:
    """The exported rows."""
    with opened(folder) as ledger:
        return [file.read_bytes() for file in export(ledger, folder, "csv")]


def children(pid: int) -> list[int]:
    """Processes whose parent this is."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            after_name = stat.read_text().rpartition(")")[2].split()
            if int(after_name[1]) == pid:
                found.append(int(stat.parent.name))
    return found


def alive(pid: int) -> bool:
    """Whether a process runs (one that is dead but not yet buried does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except OSError:
        return False


if __name__ == "__main__":
    main()
