"""The folder of a table or a figure made from one scenario: it appears whole, and says what made it."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenarios.run import provenance
from scenarios.run_folder import run_folder
from scenarios.scenario import Scenario
from scenarios.settings_yaml import settings_yaml


@contextmanager
def paper_folder(name: str, scenario: Scenario, out: Path) -> Iterator[Path]:
    """A folder to write into; the scenario, versions, seed and seconds are added at the end.

    Raises:
        BadInput: when the folder cannot be written.
    """
    with run_folder(out) as folder:
        start = time.perf_counter()
        yield folder
        (folder / "scenario.yaml").write_text(settings_yaml(scenario))
        seconds = {name: round(time.perf_counter() - start, 3)}
        (folder / "run.json").write_text(json.dumps(provenance(scenario, seconds, {}), indent=1) + "\n")
