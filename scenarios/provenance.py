"""What made a result: versions of us and of what we stand on, and the state of the checkout."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

PACKAGES = ("mujoco", "numpy", "scipy", "numba", "opencv-python-headless", "pyrender", "trimesh")


def versions() -> dict[str, Any]:
    """Versions and git state; null where there is no git."""
    import platform

    changed = _git("status", "--porcelain")
    return {
        "pipetwin": version("pipetwin"),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES},
        "git_commit": _git("rev-parse", "HEAD"),
        "git_changed": None if changed is None else bool(changed),
    }


def write_versions(folder: Path) -> None:
    """Write them as the `run.json` of a folder."""
    (folder / "run.json").write_text(json.dumps(versions(), indent=1) + "\n")


def _git(*words: str) -> str | None:
    import subprocess

    try:
        done = subprocess.run(  # noqa: S603
            ["git", *words],  # noqa: S607
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None  # no git here, or no checkout
    return done.stdout.strip()
