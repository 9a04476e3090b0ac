"""One line of a comparison."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    """One figure of both; `spread` is how far another stretch of the log itself would lie off 95 times in 100."""

    name: str
    log: float
    replay: float
    spread: float
    blocks: int

    @property
    def difference(self) -> float:
        """Replay less log."""
        return self.replay - self.log

    @property
    def inside(self) -> bool:
        """Whether the replay lies within the spread."""
        return bool(abs(self.difference) <= self.spread)
