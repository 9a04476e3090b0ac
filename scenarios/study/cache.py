"""Results of stages on disk, each under the hash of what it depends on, and checked before it is used again."""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenarios.document import BadInput
from scenarios.study.plain import canonical

STAGES = ("drive", "recording", "slits", "map")
GB = 1e9
DEFAULT_GB = 20.0
LIST = "contents"
LONGEST_LIST = 64 * 2**20
KEY = re.compile(r"[0-9a-f]{40}")
CHUNK = 1 << 20
DEAD_AFTER_S = 60.0
LOOK_AGAIN_SHARE = 0.05  # of the limit, written by one process, before it looks whether the limit is passed


class StageSize(NamedTuple):
    """What one stage holds of the cache."""

    stage: str
    entries: int
    bytes: int


def default_folder() -> Path:
    """Where the cache is, unless PIPETWIN_CACHE says otherwise."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(os.environ.get("PIPETWIN_CACHE") or base / "pipetwin")


def default_limit_bytes() -> float:
    """How large the cache may grow: 20 GB, unless PIPETWIN_CACHE_GB says otherwise.

    Raises:
        BadInput: when that is no number from 0 up.
    """
    given = os.environ.get("PIPETWIN_CACHE_GB", "")
    try:
        limit = float(given or DEFAULT_GB)
    except ValueError:
        limit = -1.0
    if not 0 <= limit < float("inf"):
        raise BadInput([f"PIPETWIN_CACHE_GB: got {given[:40]!r}; must be a number of gigabytes, 0 or more"])
    return limit * GB


def entry_key(*parts: Any) -> str:
    """The key of what depends on these parts (settings, plain data, other keys)."""
    return sha256(canonical(list(parts)).encode()).hexdigest()[:40]


class Cache:
    """A folder of entries, each a folder of files with a list of their sizes and check sums."""

    def __init__(self, folder: Path, limit_bytes: float) -> None:
        self.folder, self.limit_bytes = folder, limit_bytes
        self.written_bytes = 0

    @contextmanager
    def entry(self, stage: str, key: str, make: Callable[[Path], None]) -> Iterator[Path]:
        """The files of an entry, made if they are not there or damaged; they stay while the block lasts."""
        place = self.folder / stage / key
        with ExitStack() as held:
            if not held.enter_context(_held(place)):
                with _locked(self.folder / ".locks" / f"{stage}-{key[:2]}"):  # nested makes go down the stages only
                    if not held.enter_context(_held(place)):
                        self._make(place, make)
                        if not held.enter_context(_held(place, just_made=True)):
                            raise OSError(f"{place}: was removed as it was written")
            yield place
        if self.written_bytes > LOOK_AGAIN_SHARE * self.limit_bytes:
            self.written_bytes = 0
            self.prune()

    def arrays(self, stage: str, key: str, make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """An entry that is a set of arrays."""

        def save(folder: Path) -> None:
            np.savez(folder / "arrays.npz", **make())  # type: ignore[arg-type]  # none is called allow_pickle

        with (
            self.entry(stage, key, save) as place,
            np.load(place / "arrays.npz", allow_pickle=False) as found,
        ):
            return {name: found[name] for name in found.files}

    def _make(self, place: Path, make: Callable[[Path], None]) -> None:
        """Make an entry beside its place and put it there when it is whole."""
        work = place.with_name(f".partial-{place.name[:8]}-{secrets.token_hex(6)}")
        work.mkdir(parents=True)
        try:
            with _directory(work) as handle:
                if handle is not None:
                    fcntl.flock(handle, fcntl.LOCK_EX)  # says that somebody still works here
                make(work)
                self.written_bytes += _list_contents(work)
                _discard(place)
                work.rename(place)
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise

    # ---- looking and cleaning

    def sizes(self) -> list[StageSize]:
        """How much each stage holds."""
        entries = self._entries()
        by_stage = {stage: [size for name, _, size, _ in entries if name == stage] for stage in STAGES}
        return [StageSize(stage, len(sizes), sum(sizes)) for stage, sizes in by_stage.items()]

    def prune(self, limit_bytes: float | None = None) -> int:
        """Remove what dead builders left, and the entries longest unused until the limit holds; returns the bytes."""
        limit = self.limit_bytes if limit_bytes is None else limit_bytes
        freed = 0
        with _locked(self.folder / ".locks" / "prune", wait=False) as alone:
            if not alone:
                return 0
            self._clear_away()
            entries = self._entries()
            total = sum(size for _, _, size, _ in entries)
            for _, place, size, _ in sorted(entries, key=lambda entry: entry[3]):
                if total - freed <= limit:
                    break
                freed += size if _discard(place) else 0
        return freed

    def _entries(self) -> list[tuple[str, Path, int, float]]:
        """Stage, place, bytes and time of last use of every entry."""
        found = []
        for stage in STAGES:
            folder = self.folder / stage
            for place in folder.iterdir() if folder.is_dir() else ():
                if KEY.fullmatch(place.name):
                    try:
                        found.append((stage, place, _stated_bytes(place), place.stat().st_mtime))
                    except OSError:
                        continue  # another process has just removed it
        return found

    def _clear_away(self) -> None:
        for stage in STAGES:
            folder = self.folder / stage
            for place in folder.iterdir() if folder.is_dir() else ():
                if place.name.startswith(".trash-"):
                    shutil.rmtree(place, ignore_errors=True)
                elif place.name.startswith(".partial-") and _age_s(place) > DEAD_AFTER_S:
                    _discard(place)


@contextmanager
def _held(place: Path, just_made: bool = False) -> Iterator[bool]:
    """Hold an entry so that nobody removes it; false when it is not there, or not what its list says.

    What was just made was read back for its list, and is not read again.
    """
    with _directory(place) as handle:
        if handle is None:
            yield False
            return
        fcntl.flock(handle, fcntl.LOCK_SH)
        try:
            still_there = os.fstat(handle).st_ino == place.stat().st_ino
        except OSError:
            still_there = False
        if whole := still_there and (just_made or _is_whole(place)):
            os.utime(place)
        else:
            fcntl.flock(handle, fcntl.LOCK_UN)
        yield whole


@contextmanager
def _directory(place: Path) -> Iterator[int | None]:
    try:
        handle = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        yield None
        return
    try:
        yield handle
    finally:
        os.close(handle)


@contextmanager
def _locked(file: Path, wait: bool = True) -> Iterator[bool]:
    """Hold a lock that a kill lets go of; without waiting, false when somebody else has it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
            return
        yield True
    finally:
        os.close(handle)


def _discard(place: Path) -> bool:
    """Remove an entry unless somebody holds it."""
    with _directory(place) as handle:
        if handle is None:
            return False
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        trash = place.with_name(f".trash-{secrets.token_hex(6)}")
        try:
            place.rename(trash)
        except OSError:
            return False
        shutil.rmtree(trash, ignore_errors=True)
    return True


def _list_contents(folder: Path) -> int:
    """Write the list of an entry's files, last of all: total bytes, then check sum, size and name of each."""
    lines, total = [], 0
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        size, check = _sum(file)
        lines.append(f"{check:08x} {size} {file.relative_to(folder).as_posix()}")
        total += size
    text = "\n".join([str(total), *lines])
    (folder / LIST).write_text(f"{text}\n{zlib.crc32(text.encode()):08x}\n")
    return total


def _is_whole(folder: Path) -> bool:
    """Whether an entry holds exactly what its list says."""
    try:
        with (folder / LIST).open("rb") as file:
            listed = file.read(LONGEST_LIST).decode()
        text, _, check = listed.removesuffix("\n").rpartition("\n")
        if check != f"{zlib.crc32(text.encode()):08x}":
            return False
        names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} - {LIST}
        lines = [line.split(" ", 2) for line in text.split("\n")[1:]]
        if {name for _, _, name in lines} != names:
            return False
        return all(_sum(folder / name) == (int(size), int(check, 16)) for check, size, name in lines)
    except (OSError, ValueError):
        return False


def _stated_bytes(place: Path) -> int:
    """The total that an entry's list states; the true one when the list is damaged."""
    try:
        with (place / LIST).open("rb") as file:
            return int(file.readline(24))
    except (OSError, ValueError):
        return sum(path.stat().st_size for path in place.rglob("*") if path.is_file())


def _sum(file: Path) -> tuple[int, int]:
    size, check = 0, 0
    with file.open("rb") as data:
        while chunk := data.read(CHUNK):
            size, check = size + len(chunk), zlib.crc32(chunk, check)
    return size, check


def _age_s(place: Path) -> float:
    try:
        return time.time() - place.stat().st_mtime
    except OSError:
        return 0.0
