"""The rooms import only what they may, and the contracts that say so do catch a planted import."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("twin", "sensor_model", "algorithms", "scenarios")
LINT = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command()"


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", LINT, "--no-cache"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A copy of the code to plant imports in."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_the_contracts_hold() -> None:
    result = lint_imports(ROOT)
    assert result.returncode == 0, result.stdout
    assert "4 kept, 0 broken" in result.stdout


@pytest.mark.parametrize(
    ("file", "line", "chain"),
    [
        ("algorithms/planted.py", "from twin.pipe import Pipe", "algorithms.planted -> twin.pipe"),
        ("algorithms/planted.py", "def f():\n    import mujoco", "algorithms.planted -> mujoco"),
        ("algorithms/planted.py", "from sensor_model.sense import sense", "algorithms.planted -> sensor_model.sense"),
        ("sensor_model/rig.py", "import pyrender", "sensor_model.rig -> pyrender"),
        ("sensor_model/recording.py", "from twin.truth import Truth", "sensor_model.recording -> twin.truth"),
        (
            "sensor_model/settings.py",
            "from sensor_model.points import x",
            "sensor_model.settings -> sensor_model.points",
        ),
        ("twin/planted.py", "from sensor_model.rig import Rig", "twin.planted -> sensor_model.rig"),
        ("twin/planted.py", "import algorithms", "twin.planted -> algorithms"),
        (
            "sensor_model/planted.py",
            "from algorithms.method import Method",
            "sensor_model.planted -> algorithms.method",
        ),
        ("sensor_model/planted.py", "import scenarios", "sensor_model.planted -> scenarios"),
        ("algorithms/planted.py", "import scenarios.scenario", "algorithms.planted -> scenarios.scenario"),
    ],
)
def test_a_planted_import_is_caught(house: Path, file: str, line: str, chain: str) -> None:
    with (house / file).open("a") as planted:
        planted.write(f"\n{line}\n")
    result = lint_imports(house)
    assert result.returncode == 1, result.stdout + result.stderr
    assert chain in " ".join(result.stdout.split())


def test_a_module_that_nobody_opened_is_closed(house: Path) -> None:
    (house / "sensor_model" / "fresh.py").write_text("")
    (house / "algorithms" / "planted.py").write_text("from sensor_model import fresh\n")
    result = lint_imports(house)
    assert result.returncode == 1
    assert "algorithms.planted -> sensor_model.fresh" in " ".join(result.stdout.split())
