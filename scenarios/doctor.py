"""What pipetwin needs of this machine: what is there, what is missing, and the command that mends it."""

from __future__ import annotations

import ctypes.util
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from scenarios.cores import cores

ROOT = Path(__file__).resolve().parents[1]
LEAST_MEMORY_GB = 1.5
SYSTEM_PACKAGES = {"libegl1": "EGL", "libgl1": "GL"}
INSTALL_GL = "apt-get install -y libegl1 libgl1 libgl1-mesa-dri"
EGL_SECONDS = 120
EGL_TRIAL = """
from pyrender.platforms.egl import EGLPlatform
platform = EGLPlatform(8, 8)
platform.init_context()
platform.make_current()
from OpenGL.GL import GL_RENDERER, glGetString
print(glGetString(GL_RENDERER).decode())
"""


class Check(NamedTuple):
    """One line of the doctor's: how it stands, what was seen, and the command that mends it when it is missing."""

    name: str
    ok: bool
    seen: str
    mend: str = ""
    optional: bool = False


def examine() -> list[Check]:
    """Every check, in order; none of them changes anything."""
    checks: tuple[Callable[[], Iterator[Check]], ...]
    checks = (_python, _packages, _gl_libraries, _egl, _numba_cache, _machine, _shared)
    return [result for check in checks for result in check()]


def _python() -> Iterator[Check]:
    mend = "apt-get install -y python3 python3-venv"
    yield Check("python", sys.version_info >= (3, 11), platform.python_version(), mend)


def locked_versions(lock: Path) -> dict[str, str]:
    """Name and version of each package that the lock wants on this machine."""
    from packaging.markers import Marker

    wanted = {}
    for line in lock.read_text(encoding="utf-8").splitlines():
        if match := re.match(r"([A-Za-z0-9_.-]+)==(\S+)\s*(?:;\s*(.*?))?\s*\\?$", line):
            name, version, marker = match.groups()
            if not marker or Marker(marker).evaluate():
                wanted[name] = version
    return wanted


def _packages() -> Iterator[Check]:
    lock, mend = ROOT / "requirements.lock", "pip install --no-deps --require-hashes -r requirements.lock"
    if not lock.is_file():
        yield Check("packages", True, "no requirements.lock beside the code, versions not compared", optional=True)
        return
    try:
        wanted = locked_versions(lock)
    except ImportError:
        yield Check("packages", False, "packaging is not installed", mend)
        return
    wrong = []
    for name, version in wanted.items():
        try:
            have = metadata.version(name)
        except metadata.PackageNotFoundError:
            have = "none"
        if have != version:
            wrong.append(f"{name} {have} (want {version})")
    yield Check("packages", not wrong, ", ".join(wrong) or f"{len(wanted)} at their locked versions", mend)


def _gl_libraries() -> Iterator[Check]:
    for package, library in SYSTEM_PACKAGES.items():
        found = ctypes.util.find_library(library)
        yield Check(package, found is not None, found or f"lib{library} not found", INSTALL_GL)


def _egl() -> Iterator[Check]:
    settings = {"PYOPENGL_PLATFORM": "egl", "PYGLET_HEADLESS": "1", "MUJOCO_GL": "egl"}
    try:
        trial = subprocess.run(  # noqa: S603  our own text; apart, because a broken driver may crash the process
            [sys.executable, "-W", "ignore", "-c", EGL_TRIAL],
            env={**os.environ, **settings},
            capture_output=True,
            text=True,
            timeout=EGL_SECONDS,
        )
        lines = (trial.stdout if trial.returncode == 0 else trial.stderr).strip().splitlines()
        seen = lines[-1] if lines else f"ended with status {trial.returncode}"
        yield Check("EGL context", trial.returncode == 0, seen, INSTALL_GL)
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Check("EGL context", False, str(error), INSTALL_GL)


def _numba_cache() -> Iterator[Check]:
    folders = [Path(os.environ["NUMBA_CACHE_DIR"])] if os.environ.get("NUMBA_CACHE_DIR") else []
    folders += [ROOT / "twin", Path.home() / ".cache"]
    usable = next((folder for folder in folders if _writable(folder)), None)
    seen = str(usable) if usable else "nowhere to keep compiled code: every start compiles anew"
    yield Check("numba cache", usable is not None, seen, "export NUMBA_CACHE_DIR=/tmp/numba")


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _machine() -> Iterator[Check]:
    yield Check("cores", True, str(cores()))
    meminfo = Path("/proc/meminfo")
    match = re.search(r"MemAvailable:\s+(\d+) kB", meminfo.read_text()) if meminfo.exists() else None
    if match:
        free_gb = int(match[1]) / 1e6
        yield Check("memory", free_gb >= LEAST_MEMORY_GB, f"{free_gb:.1f} GB free", "pipetwin run SCENARIO -j 1")


def _shared() -> Iterator[Check]:
    given = os.environ.get("PIPETWIN_SHARED")
    folder = Path(given) if given else ROOT.parent / "shared"
    found = (folder / "reference").is_dir()
    seen = str(folder) if found else "none; the tests that compare with it are skipped"
    yield Check("reference data", found, seen, "export PIPETWIN_SHARED=FOLDER", optional=True)
