"""A run's folder: written beside its place under another name, and put there in one step when it is whole."""

from __future__ import annotations

import ctypes
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenarios.document import BadInput

MARK = "run.json"  # the last file of a run; a folder without it is not ours to replace
RUN_PARTS = {"scenario.yaml", "recording", "truth", "reconstruction", "score.json", "report.html", "view.html"}
FIELD_PARTS = {"twin.html", "export", "match.csv", "match.json", "verify.csv", "verify.json", "method.yaml"}
FIELD_PARTS |= {"health.json"}
BENCH_PARTS = {"rows.csv", "pairs.csv", "frames.csv", "report.html", "artefacts.json", "artefacts.csv"}
PAPER_NAMES = [f"table{n}" for n in (1, 2, 3, 4)] + [f"fig{n}" for n in (5, 11, 12, 14, 15, 16, 17, 18)]
PAPER_PARTS = {f"{name}.{ending}" for name in PAPER_NAMES for ending in ("json", "csv", "png")}
FIG7_PARTS = {"log.csv", "poses.csv", "fig7.yaml", "fig7-imu.html"}
TRUST_PARTS = {"pod.json", "curve.csv", "gauge.json", "performance.json", "rows.json", "looks.csv", "looks.json"}
PARTS = {MARK} | RUN_PARTS | FIELD_PARTS | BENCH_PARTS | PAPER_PARTS | FIG7_PARTS | TRUST_PARTS
AT_FDCWD, RENAME_EXCHANGE = -100, 2


@contextmanager
def run_folder(target: Path) -> Iterator[Path]:
    """Give an empty folder beside the target, which becomes the target when the block ends well.

    An older run there is replaced whole; when the block fails, its work is removed and the older run stays.

    Raises:
        BadInput: when the target cannot be written, or is something that is no pipetwin run.
        RuntimeError: when the block ends without having written `run.json`.
    """
    target = Path(os.path.abspath(target))  # noqa: PTH100  resolve() would follow a link to somewhere else
    _check_replaceable(target)
    work = target.with_name(f".{target.name}.partial-{secrets.token_hex(4)}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        work.mkdir()
    except (OSError, ValueError) as error:
        raise BadInput([f"{target}: cannot be written: {_why(error)}; choose another folder with -o"]) from error
    try:
        yield work
        if not (work / MARK).is_file():
            raise RuntimeError(f"{target}: the run ended without writing {MARK}")
        _check_replaceable(target)  # it may have come into being meanwhile
        _put_in_place(work, target)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _check_replaceable(target: Path) -> None:
    """Raise unless the target is free, or an older run."""
    try:
        if not target.name:
            raise BadInput([f"{target}: is no place for a run; choose another folder with -o"])
        if target.is_symlink() or (target.exists() and not target.is_dir()):
            raise BadInput([f"{target}: is there already and is no folder; choose another with -o"])
        if target.is_dir() and Path.cwd().is_relative_to(target):
            raise BadInput([f"{target}: is the folder you are in; choose another with -o"])
        if target.is_dir() and any(target.iterdir()) and not _is_run(target):
            raise BadInput([f"{target}: holds something that is no pipetwin run; choose another folder with -o"])
    except (OSError, ValueError) as error:
        raise BadInput([f"{target}: cannot be written: {_why(error)}; choose another folder with -o"]) from error


def _is_run(folder: Path) -> bool:
    """Whether a folder holds a run and nothing else."""
    try:
        if not (folder / MARK).is_file():  # a pipe would be waited for
            return False
        said = json.loads((folder / MARK).read_text())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(said, dict) and "pipetwin" in said and {path.name for path in folder.iterdir()} <= PARTS


def _why(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _put_in_place(work: Path, target: Path) -> None:
    """Rename the work onto the target; an older run there is exchanged for it in one step, then removed."""
    if not target.exists():
        work.rename(target)
    elif not _exchange(work, target):
        old = target.with_name(f".{target.name}.old-{secrets.token_hex(4)}")
        target.rename(old)
        try:
            work.rename(target)
        except OSError:
            old.rename(target)
            raise
        shutil.rmtree(old, ignore_errors=True)


def _exchange(one: Path, other: Path) -> bool:
    """Swap two folders' names atomically, where the kernel and the file system can."""
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except (AttributeError, OSError):
        return False
    return renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Give a file beside the target, with the same ending, which becomes the target when the block ends well.

    Raises:
        BadInput: when the target cannot be written.
    """
    work = target.with_name(f".{target.stem}.partial-{secrets.token_hex(4)}{target.suffix}")
    try:
        if target.is_dir() or not target.name:
            raise BadInput([f"{target}: is a folder; give a file to write"])
        work.touch(exist_ok=False)
    except (OSError, ValueError) as error:
        raise BadInput([f"{target}: cannot be written: {_why(error)}"]) from error
    try:
        yield work
        work.replace(target)
    finally:
        work.unlink(missing_ok=True)


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """Give an empty folder beside the target, which becomes the target when the block ends well.

    Raises:
        BadInput: when the target is there already, or cannot be written.
    """
    work = target.with_name(f".{target.name}.partial-{secrets.token_hex(4)}")
    try:
        if target.exists() or target.is_symlink() or not target.name:
            raise BadInput([f"{target}: is there already; remove it, or choose another place with -o"])
        work.mkdir(parents=True)
    except (OSError, ValueError) as error:
        raise BadInput([f"{target}: cannot be written: {_why(error)}"]) from error
    try:
        yield work
        work.rename(target)
    finally:
        shutil.rmtree(work, ignore_errors=True)
