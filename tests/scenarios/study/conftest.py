"""Small studies: one whose runs cost nothing and do as they are told, and one of real short scans."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from scenarios.study import conduct as conduct_module
from scenarios.study.conduct import How, conduct, opened
from scenarios.study.export import export

ROOT = Path(__file__).resolve().parents[3]
STAND_IN = """\
name: stand-in
base: paper-gantry
set: {sensing.fidelity: points}
factors:
  pipe.features.0.depth_mm: [1, 2, 3]
  sensing.points.pixel_noise_px: {low: 0.1, high: 0.4, steps: 2}
design: {kind: grid, seeds: 4}
methods:
  default: {}
  coarse: {map.cell_z_mm: 5}
"""
SCAN = """\
name: scan
base: paper-gantry
set:
  sensing.fidelity: points
  sensing.frame_rate_hz: 5
  sensing.points.azimuths: 180
  pipe.end_mm: 500
  pipe.features: [{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]
  drive.stages: [{to_mm: 100}]
  method.map.cell_z_mm: 4
factors:
  sensing.points.pixel_noise_px: {distribution: log-uniform, low: 0.1, high: 1}
design: {kind: latin-hypercube, points: 2}
methods:
  default: {}
  wide: {map.cell_theta_deg: 2}
"""


@pytest.fixture(autouse=True)
def _apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of its own for every test, and the stand-in where workers find it."""
    monkeypatch.setenv("PIPETWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(conduct_module, "write_page", lambda *_, **__: None)  # drawn in its own tests
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "campaigns"), os.environ.get("PYTHONPATH", "")]))


@dataclass(frozen=True)
class Lab:
    """Writes studies, runs them here, and reads what they leave."""

    folder: Path
    stand_in: str = STAND_IN
    scan: str = SCAN

    def write(self, *replace: tuple[str, str], text: str = STAND_IN, name: str = "study.yaml") -> Path:
        """A study file, with replacements made in its text."""
        for old, new in replace:
            assert old in text
            text = text.replace(old, new)
        (self.folder / name).write_text(text)
        return self.folder / name

    def run(self, file: Path, out: str, workers: int = 1, make: str = "standin:maker", **how: object) -> dict[str, int]:
        """Run a study; returns how many runs are in each state."""
        counts, _ = self.run_saying(file, out, workers, make, **how)
        return counts

    def run_saying(
        self, file: Path, out: str, workers: int = 1, make: str = "standin:maker", **how: object
    ) -> tuple[dict[str, int], list[str]]:
        """The same, with what it said."""
        said: list[str] = []
        _, counts = conduct(file, self.folder / out, How(workers, make=make, **how), lambda *_: None, said.append)
        return counts, said

    def exported(self, out: str, to: str = "csv") -> list[bytes]:
        """The bytes of its exported tables."""
        with opened(self.folder / out) as ledger:
            return [file.read_bytes() for file in export(ledger, self.folder / out, to)]


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path)


@pytest.fixture
def lone_scheduler(tmp_path: Path) -> Iterator[str]:
    """A scheduler without workers."""
    with _scheduler(tmp_path / "scheduler.json") as address:
        yield address


@pytest.fixture
def two_workers(lone_scheduler: str, tmp_path: Path) -> Iterator[list[subprocess.Popen]]:
    """Two workers of that scheduler, to do harm to."""
    words = _worker(lone_scheduler, tmp_path)
    with _dask(words, tmp_path / "one.log") as one, _dask(words, tmp_path / "two.log") as two:
        yield [one, two]


@contextmanager
def _scheduler(file: Path) -> Iterator[str]:
    """A scheduler of our own on loopback, as the recipe in the documentation starts it."""
    words = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    with _dask(words, file.with_suffix(".log")) as process:
        ends_s = time.monotonic() + 30
        while not (file.exists() and file.read_text().endswith("}")):
            assert process.poll() is None
            assert time.monotonic() < ends_s
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"]


@pytest.fixture(scope="session")
def dask_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A scheduler and two worker processes."""
    folder = tmp_path_factory.mktemp("dask")
    with _scheduler(folder / "scheduler.json") as address:
        words = _worker(address, folder)
        with _dask(words, folder / "one.log"), _dask(words, folder / "two.log"):
            yield address


def _worker(address: str, folder: Path) -> list[str]:
    plain = ["--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    return ["worker", address, *plain, "--local-directory", str(folder)]


@contextmanager
def _dask(words: list[str], log: Path) -> Iterator[subprocess.Popen]:
    path = os.pathsep.join([str(ROOT), str(ROOT / "campaigns")])
    environment = {**os.environ, "PYTHONPATH": path, "PIPETWIN_CACHE": str(log.parent / "cache")}
    with log.open("wb") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words], env=environment, stdout=said, stderr=said, cwd=log.parent
        )
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
