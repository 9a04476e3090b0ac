"""What gives every Dask worker, also one that joins later, all it needs of a study once and not with every task."""

from __future__ import annotations

from typing import Any

from distributed import WorkerPlugin

from scenarios.study import cluster


class Recipe(WorkerPlugin):
    """The study's setup, known by its name; with the study's end its processes end too."""

    def __init__(self, name: str, setup: dict[str, Any], time_limit_s: float) -> None:
        self.name, self.what, self.time_limit_s = name, setup, time_limit_s

    def setup(self, worker: Any) -> None:  # noqa: ARG002  Dask's signature
        """Keep it."""
        cluster.learn(self.name, self.what, self.time_limit_s)

    def teardown(self, worker: Any) -> None:  # noqa: ARG002  Dask's signature
        """Forget it."""
        cluster.forget(self.name)
