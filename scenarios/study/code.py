"""Which code makes a number: a hash of all source that can change one, and of the packages below it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = {"world": ("twin", "sensor_model"), "all": ("twin", "sensor_model", "algorithms", "scenarios")}
PACKAGES = ("numpy", "scipy", "numba", "mujoco", "opencv-python-headless", "pyrender", "filterpy", "scikit-image")
NO_NUMBERS = {"cli.py", "doctor.py", "artefacts.py", "run_folder.py", "progress.py"}
DIGITS = 16


@cache
def code_version(rooms: str = "all") -> str:
    """The hash of the `world` alone, or of `all` rooms, with the versions of what they compute by."""
    text = sha256()
    for file in sorted(_sources(ROOMS[rooms])):
        text.update(f"{file.relative_to(ROOT).as_posix()} {sha256(file.read_bytes()).hexdigest()}\n".encode())
    for name in PACKAGES:
        text.update(f"{name} {_version(name)}\n".encode())
    return text.hexdigest()[:DIGITS]


def _sources(rooms: tuple[str, ...]) -> Iterator[Path]:
    """Every source file of the rooms; of the bench only the chain itself, not report, study or command line."""
    for room in rooms:
        if room == "scenarios":
            yield from (file for file in (ROOT / room).glob("*.py") if file.name not in NO_NUMBERS)
            yield ROOT / room / "study" / "scan.py"
            continue
        files = (file for file in (ROOT / room).rglob("*") if file.is_file() and "__pycache__" not in file.parts)
        yield from (file for file in files if not file.name.startswith("."))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"
