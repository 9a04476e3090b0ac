"""The closed blocks of a wall map: the latest in memory, those that lie further back where large arrays are."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from algorithms.large_arrays import let_go, room

Cells = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
KINDS = (np.float64, np.float32, np.float32, np.int32, np.float32)
"""A block's radius, spread, sigma, count and slope of the light."""
MOST_CELLS = 2**20  # in memory


@dataclass
class ClosedBlocks:
    """Blocks by their number along the pipe, all of one shape; the latest are those that were closed last."""

    latest: dict[int, Cells] = field(default_factory=dict)
    place: dict[int, np.ndarray] = field(default_factory=dict)
    """The bytes of each block that was ever put away."""
    spare: list[np.ndarray] = field(default_factory=list)

    @property
    def numbers(self) -> set[int]:
        """Which blocks there are."""
        return self.latest.keys() | self.place.keys()


def keep(blocks: ClosedBlocks, number: int, cells: Cells) -> None:
    """Keep a block, in place of what there was of it; the one unchanged for longest is put away.

    Raises:
        OSError: when there is no room for it.
    """
    blocks.latest.pop(number, None)
    blocks.latest[number] = cells
    while len(blocks.latest) > max(MOST_CELLS // cells[0].size, 1):
        oldest = next(iter(blocks.latest))
        _put_away(blocks, oldest)
        del blocks.latest[oldest]


def _put_away(blocks: ClosedBlocks, number: int) -> None:
    """Write a block where it was, or else to a new place, of which there are as many more as there are blocks."""
    held = np.concatenate([part.ravel().view(np.uint8) for part in blocks.latest[number]])
    if number not in blocks.place:
        blocks.spare = blocks.spare or list(room((len(blocks.numbers), held.size), np.uint8))
        blocks.place[number] = blocks.spare.pop()
    blocks.place[number][:] = held
    let_go(blocks.place[number])


def kept(blocks: ClosedBlocks, number: int, shape: tuple[int, int]) -> Cells | None:
    """A block's cells, or None where there is no such block."""
    if number in blocks.latest or number not in blocks.place:
        return blocks.latest.get(number)
    held = blocks.place[number].copy()
    let_go(blocks.place[number])
    ends = np.cumsum([0] + [shape[0] * shape[1] * np.dtype(kind).itemsize for kind in KINDS])
    radius, spread, sigma, count, slope = (
        held[ends[k] : ends[k + 1]].view(kind).reshape(shape) for k, kind in enumerate(KINDS)
    )
    return radius, spread, sigma, count, slope


def copied(blocks: ClosedBlocks) -> ClosedBlocks:
    """The blocks as they are now, to be read while the others go on."""
    return replace(blocks, latest=dict(blocks.latest), place=dict(blocks.place))
