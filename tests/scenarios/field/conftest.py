"""Run folders as a robot's would be: a reconstruction, and nothing of the truth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from algorithms.types import Episode
from scenarios.artefacts import write_reconstruction


@pytest.fixture(scope="session")
def found_folder(small_scan, tmp_path_factory):
    """A run's folder without truth, score, recording or pictures, with a joint upstream of its pocket."""
    folder = tmp_path_factory.mktemp("field") / "run"
    tie = Episode("joint", "joint at 40.5 mm", 0, 0, 0.3)
    write_reconstruction(replace(small_scan.found, episodes=(tie,)), folder / "reconstruction")
    return folder
