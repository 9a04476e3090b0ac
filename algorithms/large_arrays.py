"""Arrays as long as the pipe: the large ones in a file, of which only what is in use is in memory."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from math import prod
from mmap import MADV_DONTNEED, mmap

import numpy as np
from numpy.typing import DTypeLike

LARGE_BYTES = 2**25  # 32 MB: a smaller array is held in memory
PIECE_CELLS = 2**19
ON_DISK = "/var/tmp"  # noqa: S108  a file without a name is nobody else's


def room(shape: tuple[int, ...], kind: DTypeLike) -> np.ndarray:
    """A new array, its values not set; a large one lies in a file without a name, which goes when the array does.

    The file is where `TMPDIR` says, or else where large ones belong: /tmp may itself be memory.

    Raises:
        OSError: when the file system has no room for it.
    """
    size = prod(shape) * np.dtype(kind).itemsize
    if size < LARGE_BYTES:
        return np.empty(shape, kind)
    folder = os.environ.get("TMPDIR") or next(filter(os.path.isdir, [ON_DISK]), None)
    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            # now, for to write to an array on a disk that is full would kill the process
            os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            words = (
                f"no room for {size / 1e6:.0f} MB of the wall map ({error.strerror}); TMPDIR may name another folder"
            )
            raise OSError(error.errno, words, folder) from error
        return np.frombuffer(mmap(file.fileno(), size), kind).reshape(shape)


def let_go(*arrays: np.ndarray) -> None:
    """Let the memory go that arrays in files take; their values stay, and are read again when asked for."""
    for array in arrays:
        held: object = array
        while isinstance(held, np.ndarray):
            held = held.base
        if isinstance(held, memoryview) and isinstance(held.obj, mmap):
            held.obj.madvise(MADV_DONTNEED)


def pieces(*maps: np.ndarray, rows: int = 1) -> Iterator[slice]:
    """Stretches of the second axis of (around, along) maps, each so many times `rows` long, which are let go after."""
    around, along = maps[0].shape
    step = max(PIECE_CELLS // max(around * rows, 1), 1) * rows
    for first in range(0, along, step):
        yield slice(first, min(first + step, along))
        let_go(*maps)


def lines(*maps: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
    """The lines along the pipe of (around, along) maps, which are let go after."""
    for line in zip(*maps, strict=True):
        yield line
        let_go(*maps)


def percentile(values: np.ndarray, pct: float) -> float:
    """`numpy.nanpercentile` of an (around, along) map, of which only the values beyond are held; NaN of nothing."""
    count = sum(np.count_nonzero(np.isfinite(line)) for (line,) in lines(values))
    place = max(count - 1, 0) * (pct / 100)
    below, low = int(place), pct < 50
    most, ends = below + 2 if low else count - below, np.zeros(0)
    for (line,) in lines(values):
        ends = np.concatenate([ends, line[np.isfinite(line)]])
        if ends.size > most:
            ends = np.partition(ends, most - 1)[:most] if low else np.partition(ends, ends.size - most)[-most:]
    if count == 0:
        return float("nan")
    a, b = np.resize(np.sort(ends)[below if low else 0 :][:2], 2)
    share = place - below
    return float(b - (b - a) * (1 - share) if share >= 0.5 else a + (b - a) * share)
