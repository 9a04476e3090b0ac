"""One random stream a noise source (and a frame), so that no source, worker or order changes another's draws."""

from __future__ import annotations

import numpy as np

SOURCES = ("drive", "imu", "attitude", "picture", "points", "bench", "boards", "encoders", "stamps")


def stream(seed: int, source: str, index: int = 0) -> np.random.Generator:
    """The generator of one noise source; `index` counts its independent parts, such as frames."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SOURCES.index(source), index)))
