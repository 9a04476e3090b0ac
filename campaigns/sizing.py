"""What sizing keeps over many scans in `points`: coverage, depths, false calls, POD, blind against oracle, leaks.

`python -m campaigns.sizing PART` scans what the part needs and prints its figures. With `--maps FOLDER` the wall maps
stay there, and the next call sizes them anew without a scan.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.trust.curve import NoCurve, size_at
from algorithms.trust.detection import a90_95
from algorithms.trust.exact_bounds import Rate, rate_of, run_of_hits_bound, share_lower, share_of
from algorithms.trust.hit_miss import HitMiss, fit_hit_miss
from campaigns.sizing_scans import FIRST_MM, SENSORS, Looked, looked, place_of, scenario_of, with_slide
from scenarios.equations import err_pct, error_pct
from scenarios.load import load_scenario
from scenarios.oracle import oracle_err_pct
from scenarios.trust.performance import DIMENSIONS, K95, Performance, depths_pct, intervals, performance_of_scans
from scenarios.trust.performance import sized as sized_targets
from scenarios.trust.performance_page import words
from scenarios.trust.runs import ScanOf, Target, scan_of, targets_of
from twin.features.pit import Pit

PASS_M = 10
LIT = "pocket, length at least 3 depths, from 20 % of the wall"
WALL_MM, ROWS, ROW_MM, CLOCKS_DEG = 7.5, 3, 120.0, (75.0, 180.0, 285.0)
SDR_11_WALL_MM = 6.625 * 25.4 / 11


def bare(asked: argparse.Namespace, maps: Path | None) -> Iterator[Looked]:
    """Bare wall, ten metres a scan."""
    for seed in range(asked.first, asked.first + ceil(asked.metres / PASS_M)):
        rng = np.random.default_rng([seed, 13])
        oval = {"ovality_pct": round(rng.uniform(0, asked.oval), 3), "ovality_clock_deg": round(rng.uniform(0, 180), 2)}
        yield looked(scenario_of(seed, asked.sensor, oval, 1000 * PASS_M, asked.set), maps)


def clean(asked: argparse.Namespace) -> Rate:
    """False calls per metre."""
    metres, calls = 0.0, 0
    for one in bare(asked, asked.maps):
        wall = one.found.wall
        metres += float(np.ptp(wall.z_mm[wall.scanned()])) / 1000
        calls += len(one.found.defects)
        for call in one.found.defects:
            print(f"seed {one.scenario.seed}: {call}", flush=True)
        rate = rate_of(calls, metres)
        print(f"{metres:.1f} m, {calls} false calls; at most {rate.upper_per_m:.5f} a metre (95 %)", flush=True)
    return rate_of(calls, metres)


def drawn(rng: np.random.Generator, wall_mm: float) -> dict[str, Any]:
    """A defect of any family and size; most pockets are long enough for light to reach their floor."""
    family = rng.choice(["pocket", "pocket", "pit", "scratch"])
    loss = rng.uniform(0.1, 1.0)
    if family == "pocket":
        depth = loss * wall_mm
        length = rng.uniform(max(3 * depth, 8), 80) if rng.random() < 0.8 else rng.uniform(8, 80)
        return {"kind": "pocket", "length_mm": length, "width_mm": rng.uniform(8, 45), "depth_mm": depth}
    if family == "pit":
        diameter, shape = rng.uniform(8, 30), rng.choice(["spherical", "conical"])
        return {"kind": "pit", "diameter_mm": diameter, "depth_mm": min(loss * wall_mm, 0.3 * diameter), "shape": shape}
    sizes = {"path_length_mm": rng.uniform(20, 70), "width_mm": rng.uniform(2.5, 7), "depth_mm": rng.uniform(0.8, 3)}
    return {"kind": "scratch", **sizes, "heading_deg": rng.uniform(-90, 90)}


def mixed(seed: int, asked: argparse.Namespace) -> Looked:
    """A pipe with nine defects of all families, away from the strut."""
    rng, features = np.random.default_rng([seed, 17]), []
    for row in range(ROWS):
        for clock in CLOCKS_DEG:
            size = {name: v if isinstance(v, str) else round(float(v), 3) for name, v in drawn(rng, WALL_MM).items()}
            features.append({**size, **place_of(rng, FIRST_MM + ROW_MM * row, clock)})
    return looked(
        scenario_of(seed, asked.sensor, {"features": features}, FIRST_MM + ROW_MM * ROWS, asked.set), asked.maps
    )


def sheets(asked: argparse.Namespace) -> Performance:
    """Coverage, depths and leaks as `pipetwin report` states them; then coverage on scans that set no constant."""
    scans = [judged(mixed(seed, asked)) for seed in range(asked.first, asked.first + asked.scans)]
    found = performance_of_scans(tuple(scans))
    print(words(found, None))
    for name, targets in families(sized_targets(found.targets)).items():
        measured, true = depths_pct(targets)
        away, n = np.abs(measured - true), len(targets)
        for most in (10, 5):
            print(f"{name}: within {most} % of the wall {share_said(int((away <= most).sum()), n)}")
    for name in DIMENSIONS:
        fit, judge = ([t for t in found.targets if int(t.run) % 2 == part] for part in (0, 1))
        factor = float(np.quantile(ratios(fit, name), 0.95)) / K95
        other = ratios(judge, name)
        for label, scale in (("as stated", 1.0), (f"with the other half's factor {factor:.3f}", factor)):
            print(f"{name}, odd scans, {label}: held {share_said(int((other <= K95 * scale).sum()), other.size)}")
        for family, targets in families(found.targets).items():
            own = ratios(targets, name)
            print(f"    {family}: held {share_said(int((own <= K95).sum()), own.size)}")
    return found


def judged(one: Looked) -> ScanOf:
    """As the report's machinery takes a scan, called by its seed."""
    return scan_of(Path(str(one.scenario.seed)), one.pipe, one.found.wall, one.found.defects)


def ratios(targets: Sequence[Target], name: str) -> np.ndarray:
    """Errors in stated standard deviations."""
    rows = [row for row in intervals(targets) if row["dimension"] == name]
    low, high, true = (np.array([row[key] for row in rows]) for key in ("low_mm", "high_mm", "true_mm"))
    return np.abs((low + high) / 2 - true) / ((high - low) / 2 / K95)


def families(targets: Sequence[Target]) -> dict[str, list[Target]]:
    """Targets by family; pockets whose floor is lit for a good part apart, from a fifth of the wall on."""
    out: dict[str, list[Target]] = {"all": list(targets)}
    for t in targets:
        name = t.feature.shape + " pit" if isinstance(t.feature, Pit) else t.kind
        if t.kind == "pocket" and t.true.length_mm >= 3 * t.true.depth_mm and t.true.depth_mm >= 0.2 * t.wall_mm:
            name = LIT
        out.setdefault(name, []).append(t)
    return out


def share_said(count: int, n: int) -> str:
    """A share with its two-sided interval and its one-sided lower bound."""
    share = share_of(count, n)
    bounds = f"[{100 * share.low:.1f}, {100 * share.high:.1f}], one-sided at least {100 * share_lower(count, n):.1f}"
    return f"{count} of {n}, {100 * share.share:.1f} % {bounds}" if n else "none"


SWEPT: dict[str, dict[str, Any]] = {
    "pit-10": {"kind": "pocket", "length_mm": 10, "width_mm": 10, "corner_radius_mm": 5},  # flat-floored
    "scratch-3": {"kind": "scratch", "path_length_mm": 40, "width_mm": 3},
    "scratch-1": {"kind": "scratch", "path_length_mm": 40, "width_mm": 1},
}
FINE = [  # for what is narrower than a cell of 1 degree
    "method.map={cell_theta_deg: 0.25, cell_z_mm: 0.5}",
    "sensing.points.azimuths=1440",
    "drive.speed_mm_s=25",
]
SDR_11 = {"standard": {"material": "PE", "series": "SDR 11", "nominal_size_in": 6}}
SWEPT_PCT, SWEPT_ROWS, SWEPT_ROW_MM = (1.0, 16.0), 12, 70.0


def pod(asked: argparse.Namespace) -> tuple[np.ndarray, np.ndarray]:
    """POD over wall loss of one kind of defect in PE SDR 11, all around the pipe; on all and on seen wall.

    Returns the sizes on seen wall, in per cent of the wall, and whether each was found.
    """
    targets: list[Target] = []
    calls, metres = 0, 0.0
    changes = [*(FINE if asked.kind == "scratch-1" else []), *asked.set]
    for seed in range(asked.first, asked.first + asked.scans):
        rng, features = np.random.default_rng([seed, 19]), []
        for row in range(SWEPT_ROWS):
            turn = rng.uniform(0, 360)
            for clock in (turn, turn + 120, turn + 240):
                depth = round(float(np.exp(rng.uniform(*np.log(SWEPT_PCT)))) / 100 * SDR_11_WALL_MM, 4)
                features.append(
                    {**SWEPT[asked.kind], "depth_mm": depth, **place_of(rng, FIRST_MM + SWEPT_ROW_MM * row, clock)}
                )
        pipe = {**SDR_11, "inner_radius_mm": None, "wall_thickness_mm": None, "features": features}
        scenario = scenario_of(seed, asked.sensor, pipe, FIRST_MM + SWEPT_ROW_MM * SWEPT_ROWS, changes)
        scan = judged(looked(scenario, asked.maps))
        some, false = targets_of(scan, scan.pipe, scan.seen_share)
        targets, calls, metres = targets + some, calls + len(false), metres + scan.length_m
    print(f"{asked.kind}, {asked.sensor}: {len(targets)} targets, {metres:.2f} m, {calls} false calls")
    for name, some in (("all wall", targets), ("seen wall", [t for t in targets if t.inspected])):
        size = np.array([100 * t.true.depth_mm / t.wall_mm for t in some])
        hit = np.array([t.found is not None for t in some])
        print(f"{name}: {pod_said(size, hit)}")
        for low, high in pairwise((1, 2, 3, 4, 6, 8, 10, 16.1)):
            part = (size >= low) & (size < high)
            print(f"    {low} to {high} % of the wall: {share_said(int(hit[part].sum()), int(part.sum()))}")
    return size, hit


def pod_said(size_pct: np.ndarray, hit: np.ndarray) -> str:
    """a50, a90 and a90/95, or why there is none; and the bound of no curve."""
    whole = f"bound of 29 in a row {run_of_hits_bound(size_pct, hit)}"
    curve = fit_hit_miss(HitMiss(size_pct, hit, np.ones(hit.size)))
    if isinstance(curve, NoCurve):
        return f"{curve.outcome}: {curve.reason}; {whole}"
    bounds = ", ".join(f"a90/95 {bound.size} ({bound.convention})" for bound in a90_95(curve))
    return f"a50 {size_at(curve, 0.5):.3g}, a90 {size_at(curve, 0.9):.3g}, {bounds} % of the wall; {whole}"


def paper(asked: argparse.Namespace) -> np.ndarray:
    """The paper's pockets, driven by the robot: Eqs 29, 30 and 32, and blind against oracle, seed by seed.

    Returns a row a pocket: its depth, the errors of length, width and depth (mm), Eq. 29, the oracle's, Eq. 30 (%).
    """
    rows = []
    for seed in range(asked.first, asked.first + asked.scans):
        settings = (*SENSORS[asked.sensor], *asked.set)
        scenario = load_scenario("paper-wall-loss", ["sensing.fidelity=points", *settings], seed)
        one = looked(with_slide(scenario, settings), asked.maps)
        for feature, (true, d) in zip(one.pipe.features, one.pairs(), strict=True):
            if d is None:
                raise SystemExit(f"seed {seed}: the pocket at {feature.distance_mm} mm was missed")
            size = np.array([d.length_mm, d.width_mm, d.depth_mm])
            blind = err_pct(size[0], size[1], true.length_mm, true.width_mm)
            oracle = oracle_err_pct(one.pipe, [feature], one.found)[0]
            rows.append([feature.depth_mm, *(size - np.array(true)), blind, oracle, error_pct(size, np.array(true))])
    table = np.array(rows)
    for depth in np.unique(table[:, 0])[::-1]:
        part = table[table[:, 0] == depth, 1:]
        quality = 100 * (1 - np.abs(part[:, 2]) / depth)
        print(f"{depth:g} mm deep, {len(part)} seeds")
        for k, name in enumerate(("length error mm", "width error mm", "depth error mm")):
            column = part[:, k]
            print(f"    {name}: median {np.median(column):+.3f}, worst {np.abs(column).max():.3f}")
        for name, column in (("Eq. 29", part[:, 3]), ("oracle's", part[:, 4]), ("Eq. 30", part[:, 5])):
            print(f"    {name}: median {np.median(column):.2f}, worst {column.max():.2f} %")
        gap = part[:, 3] - part[:, 4]
        print(f"    blind less oracle: median {np.median(gap):+.2f}, worst {gap.max():+.2f} points")
        print(f"    Eq. 32: mean {quality.mean():.2f}, worst {quality.min():.2f} %; bias {part[:, 2].mean():+.4f} mm")
    return table


PARTS: dict[str, Callable[[argparse.Namespace], object]] = {
    "clean": clean,
    "sheets": sheets,
    "pod": pod,
    "paper": paper,
}


def options_of(description: str | None) -> argparse.ArgumentParser:
    """What every part is asked."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--kind", choices=SWEPT, default="pit-10", help="what `pod` sweeps")
    options.add_argument("--sensor", choices=SENSORS, default="preset")
    options.add_argument("--first", type=int, default=1000, help="the first scan's seed")
    options.add_argument("--scans", type=int, default=20)
    options.add_argument("--metres", type=float, default=100.0, help="of bare wall")
    options.add_argument(
        "--oval", type=float, default=0.0, help="ovality of bare wall, per cent, up to which it is drawn"
    )
    options.add_argument("--maps", type=Path, default=None, help="a folder where wall maps stay")
    options.add_argument("--set", nargs="*", default=[], help="settings, as in `pipetwin run --set`")
    return options


def main() -> None:
    """One part."""
    options = options_of(__doc__)
    options.add_argument("part", choices=PARTS)
    asked = options.parse_args()
    PARTS[asked.part](asked)


if __name__ == "__main__":
    main()
