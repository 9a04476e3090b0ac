"""Runs that cost nothing and misbehave on demand, for tests of the engine."""

from __future__ import annotations

import math
import os
import signal
import time
from pathlib import Path
from typing import Any


def maker(recipe: dict[str, Any]):
    """A run is told by its first value what to do; it leaves a line in the file that STANDIN_LOG names."""
    log = os.environ.get("STANDIN_LOG")
    told = int(os.environ.get("STANDIN_ACT", "0"))
    pause_s = float(os.environ.get("STANDIN_PAUSE_S", "0"))

    def make(job: dict[str, Any]):
        if log:
            with Path(log).open("a") as said:
                said.write(f"{job['key']} {os.getpid()}\n")
        act(told or (job["values"][0] if job["values"] else 0))
        time.sleep(pause_s)
        n = float(int(job["key"][:8], 16))
        return [n / (k + 3) for k in range(len(recipe["record"]))], [[1.0, 2.0, 3.0, n, 5.0, 6.0]]

    return make


def tunable(recipe: dict[str, Any]):
    """A scan whose depth error is least at x = 2, where a false call begins to appear; x is the last value."""

    def make(job: dict[str, Any]):
        x, noise = float(job["values"][-1]), (job["seed"] * 7919 % 100) / 1000
        known = {
            "defects_true": 2,
            "defects_found": 2,
            "false_calls": int(x > 2.5),
            "depth_error_mm_max": 0.1 + (x - 2) ** 2 + noise,
            "ms_per_frame": 10 - x,
        }
        return [known.get(name) for name in recipe["record"]], []

    return make


def blind(recipe: dict[str, Any]):
    """A scan that finds nothing."""

    def make(_: dict[str, Any]):
        known = {"defects_true": 2, "defects_found": 0, "false_calls": 0}
        return [known.get(name) for name in recipe["record"]], []

    return make


def ishigami(recipe: dict[str, Any]):
    """A run whose every figure is Ishigami's function (a = 7, b = 0.1) of its three values, from -pi to pi."""

    def make(job: dict[str, Any]):
        x, y, z = job["values"]
        value = math.sin(x) + 7 * math.sin(y) ** 2 + 0.1 * z**4 * math.sin(x)
        return [value] * len(recipe["record"]), []

    return make


def biased(recipe: dict[str, Any]):
    """A run whose figures are its seed's, but for the first, which is 100 more in `points`."""

    def make(job: dict[str, Any]):
        drawn = float(job["seed"] * 7919 % 100) / 10
        more = 100.0 * (job["values"][0] == "points")
        return [drawn + more * (k == 0) for k in range(len(recipe["record"]))], []

    return make


def planned(recipe: dict[str, Any]):
    """A scan that finds what is deeper than 1 mm, give or take the seed's tenth, and sizes it 0.1 mm too deep."""
    from twin.features import FAMILIES

    bore = recipe["base"]["pipe"]["inner_radius_mm"]

    def make(job: dict[str, Any]):
        told = dict(zip(recipe["paths"], job["values"], strict=True))
        defects = []
        for feature in told["pipe.features"]:
            true = list(FAMILIES[feature["kind"]].model_validate(feature).size(bore))
            found = true[2] > 1 + 0.1 * (job["seed"] % 7 - 3)
            defects.append([*true, true[0] + 0.2, true[1] - 0.3, true[2] + 0.1] if found else true)
        known = {"seen_share": 0.86, "false_calls": 0, "distance_error_pct": 0.01, "roll_rms_deg": 0.2}
        return [known.get(name, 1.0) for name in recipe["record"]], defects

    return make


def act(what: Any) -> None:
    """Misbehave."""
    if what == -1:
        raise RuntimeError("it broke\nin two lines")
    if what == -2:
        time.sleep(600)
    if what == -3:
        os.kill(os.getpid(), signal.SIGKILL)
    if what == -4:
        hog = [bytearray(50_000_000) for _ in range(10_000)]
        raise AssertionError(len(hog))
    if what == -5:
        raise OSError(28, "No space left on device")
    if what == -6:
        print("noise on stdout " * 10_000, flush=True)
    if what == -7:
        os._exit(3)
