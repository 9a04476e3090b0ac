"""All that sizing must show, as asked, as measured, and whether it holds: the parts of `campaigns.sizing`, one table.

`python -m campaigns.sizing_asked --maps FOLDER`; stopped and called again with the same folder it goes on where it was.
`--only paper --set sensing.fidelity=picture --scans 3` confirms a part in pictures.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from algorithms.reconstruct import sized as sized_map
from algorithms.trust.curve import NoCurve
from algorithms.trust.detection import a90_95
from algorithms.trust.exact_bounds import run_of_hits_bound, share_lower
from algorithms.trust.hit_miss import HitMiss, fit_hit_miss
from campaigns.sizing import LIT, SWEPT_PCT, WALL_MM, clean, families, options_of, paper, pod, sheets
from campaigns.sizing_scans import FIRST_MM, scenario_of, wall_map
from scenarios.scenario import nominal_pipe
from scenarios.trust.performance import depths_pct, sized

QUALITY_PCT = {75: 97.0, 50: 95.0, 25: 90.0}
LEAST_HELD, MOST_HELD = 0.93, 0.97
SCANS = {"paper": 10, "sheets": 200, "pit-10": 8, "scratch-3": 6, "scratch-1": 3}
REAL = ("pit-10", "scratch-3")  # with the real sensor's noise and slide
MAP_DEFECTS, MAP_MM = 50, 3000.0


class Row(NamedTuple):
    """One line: what is asked, what was measured, and whether that keeps it."""

    what: str
    asked: str
    got: str
    holds: bool


def most(what: str, values: np.ndarray, limit: float, unit: str) -> Row:
    """The worst of some values is at most so much; beside it the median."""
    got = f"worst {values.max():.3g}, median {np.median(values):.3g} {unit}"
    return Row(what, f"at most {limit:g} {unit}", got, bool(values.max() <= limit))


def of_paper(asked: argparse.Namespace) -> Iterator[Row]:
    """The paper's pockets."""
    table = paper(asked)
    whole = table[np.isclose(table[:, 0], WALL_MM)]
    for k, (name, limit) in enumerate((("length", 1.5), ("width", 1.0), ("depth", 0.3))):
        yield most(f"70 x 35 x 7.5 mm: {name}", np.abs(whole[:, 1 + k]), limit, "mm")
    yield most("Eq. 29, every scan", whole[:, 4], 2.0, "%")
    yield most("Eq. 30, every scan", whole[:, 6], 2.0, "%")
    for pct, least in QUALITY_PCT.items():
        part = table[np.isclose(table[:, 0], pct / 100 * WALL_MM)]
        quality = 100 * (1 - np.abs(part[:, 3]) / part[:, 0])  # Eq. 32
        got = f"worst {quality.min():.4g}, median {np.median(quality):.4g} %"
        yield Row(f"Eq. 32 at {pct} % of the wall", f"at least {least:g} %", got, bool(quality.min() >= least))
        yield most(f"bias at {pct} % of the wall", np.abs([part[:, 3].mean()]), 0.1, "mm")
    yield most("blind less oracle in Eq. 29", table[:, 4] - table[:, 5], 1.0, "points")


def of_sheets(asked: argparse.Namespace) -> Iterator[Row]:
    """Pipes full of defects."""
    found = sheets(asked)
    for name, one in found.coverage.items():
        got = f"{100 * one.held.share:.1f} % of {one.n}"
        holds = LEAST_HELD <= one.held.share <= MOST_HELD
        yield Row(f"stated 95 % intervals: {name}", "hold in 93 to 97 %", got, holds)
    measured, true = depths_pct(families(sized(found.targets)).get(LIT, []))
    for pct, least, bound in ((10, 95, 90), (5, 80, 0)):
        near, n = int(np.sum(np.abs(measured - true) <= pct)), measured.size
        lower_pct = 100 * share_lower(near, n)
        got, holds = f"{near} of {n}, one-sided at least {lower_pct:.1f} %", 100 * near >= least * n
        what = f"depth within {pct} % of the wall, lit pockets"
        yield Row(what, f"{least} %, bound at least {bound} %", got, holds and lower_pct >= bound)
    share = found.least.share
    yield Row(
        "depth at least x, floor not seen", "holds in 95 %", f"{100 * share:.1f} % of {found.least.n}", share >= 0.95
    )
    wrong = found.shuffled
    got = f"{100 * wrong.moved.share:.1f} %, by chance {100 * wrong.by_chance:.1f} %"
    yield Row("truth shuffled: found", "no more than chance", got, not wrong.leak)


def of_pod(kind: str, limit_pct: float) -> Callable[[argparse.Namespace], Iterator[Row]]:
    """A sweep of one kind of defect."""

    def rows(asked: argparse.Namespace) -> Iterator[Row]:
        size, hit = pod(argparse.Namespace(**{**vars(asked), "kind": kind}))
        curve = fit_hit_miss(HitMiss(size, hit, np.ones(hit.size)))
        # where a size parts all misses from all hits there is no curve, but 29 hits in a row are a bound
        bound = run_of_hits_bound(size, hit) if isinstance(curve, NoCurve) else a90_95(curve)[0].size
        limit = f"at most {limit_pct:g} %" if limit_pct < SWEPT_PCT[1] else "whatever it is"
        got = "no bound" if bound is None else f"{bound:.3g} % of the wall"
        yield Row(f"a90/95 of {kind}, seen wall", limit, got, bound is not None and bound <= limit_pct)

    return rows


def of_clean(asked: argparse.Namespace) -> Iterator[Row]:
    """Bare wall."""
    rate = clean(asked)
    got = f"{rate.calls} on {rate.length_m:.0f} m, at most {rate.upper_per_m:.4f} (95 %)"
    yield Row("false calls a metre", "at most 0.002", got, rate.upper_per_m <= 0.002)


def of_speed(asked: argparse.Namespace) -> Iterator[Row]:
    """What one core takes over a map of 3 m, the best of five."""
    pocket = {"kind": "pocket", "length_mm": 30, "width_mm": 20, "depth_mm": 3}
    places = [{"distance_mm": FIRST_MM + 55 * k, "clock_deg": 75 + 105 * (k % 3)} for k in range(MAP_DEFECTS)]
    pipe = {"features": [pocket | place for place in places]}
    scenario = scenario_of(asked.first, asked.sensor, pipe, MAP_MM + FIRST_MM, asked.set)
    path, wall = wall_map(scenario, asked.maps)
    taken, found = [], None
    for _ in range(5):
        start = time.process_time()
        found = sized_map(path, wall, scenario.rig, nominal_pipe(scenario), scenario.method)
        taken.append(time.process_time() - start)
    length_m = float(np.ptp(wall.z_mm[wall.scanned()])) / 1000
    got = f"{min(taken):.2f} s for {len(found.defects) if found else 0} in {length_m:.2f} m"
    yield Row(f"3 m of map, {MAP_DEFECTS} defects", "at most 1 s", got, min(taken) <= 1)


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "speed": of_speed,
    "paper": of_paper,
    "pit-10": of_pod("pit-10", 10.0),
    "scratch-3": of_pod("scratch-3", 10.0),
    "scratch-1": of_pod("scratch-1", SWEPT_PCT[1]),
    "sheets": of_sheets,
    "clean": of_clean,
}


def main() -> None:
    """Every part, then the table."""
    options = options_of(__doc__)
    options.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    options.set_defaults(first=7000, scans=None, metres=1500.0)
    asked, table = options.parse_args(), []
    for name in asked.only:
        own = {"scans": asked.scans or SCANS.get(name), "sensor": "real" if name in REAL else asked.sensor}
        print(f"\n{name}", flush=True)
        table += list(PARTS[name](argparse.Namespace(**{**vars(asked), **own})))
    wide = [max(len(str(row[k])) for row in table) for k in range(3)]
    print()
    for row in table:
        cells = [str(row[k]).ljust(wide[k]) for k in range(3)]
        print("  ".join([*cells, "holds" if row.holds else "FALLS SHORT"]))


if __name__ == "__main__":
    main()
