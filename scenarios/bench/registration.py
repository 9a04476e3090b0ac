"""The registration bench: what is asked, run, tabled, and put into a folder."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from algorithms.registration import REGISTRATIONS
from scenarios.bench.clouds import Cloud
from scenarios.bench.errors import FrameError
from scenarios.bench.frames import CASES, FrameCase
from scenarios.bench.statistics import Pair, Row, by_scenario, nearest_method, pairs, rows, winner_words
from scenarios.document import BadInput, nearest, shown
from scenarios.provenance import versions
from scenarios.run_folder import run_folder
from sensor_model.plain_yaml import scalar
from sensor_model.settings import Settings

DEFAULT_CASES = ("clean", "defect-30", "hard")
DEFAULT_SCANS = ("paper-gantry",)
DEFAULT_SEEDS = {"frame": 40, "scan": 1}
NEEDS = {"gicp": "small_gicp", "vgicp": "small_gicp"}

Report = Callable[[str, int, int], None]


class Bench(NamedTuple):
    """What came of it: every frame's errors, a row a method, method against method, and each scan's first clouds."""

    level: str
    seeds: int
    errors: list[FrameError]
    rows: list[Row]
    pairs: list[Pair]
    clouds: list[Cloud]


def bench(
    names: Sequence[str],
    methods: str | None,
    seeds: int | None,
    level: str,
    changes: Sequence[str],
    out: Path,
    workers: int,
    progress: Report,
) -> Bench:
    """Run the methods over the cases or scans and write the folder, which appears when it is whole.

    Raises:
        BadInput: for an unknown case, scenario, method or setting, or a folder that cannot be written.
    """
    chosen, seeds = chosen_methods(methods), seeds or DEFAULT_SEEDS[level]
    start = time.perf_counter()
    clouds: list[Cloud] = []
    with run_folder(out) as folder:
        if level == "frame":
            cases = chosen_cases(names or DEFAULT_CASES, changes)
            errors = _on_frames(cases, chosen, seeds, workers, progress)
        else:
            errors, clouds = _on_scans(names or DEFAULT_SCANS, chosen, seeds, changes, workers, progress)
        result = Bench(level, seeds, errors, rows(errors, level), pairs(errors), clouds)
        _write(result, folder, time.perf_counter() - start)
        from scenarios.bench.page import write_page

        write_page(result, cases if level == "frame" else {}, chosen, folder / "report.html")
    return result


def chosen_methods(words: str | None) -> dict[str, Settings]:
    """Methods by name with their default settings; all that this machine can run when none is named.

    Raises:
        BadInput: for a name that is not registered.
    """
    if words is None:
        return {name: method.settings() for name, method in REGISTRATIONS.items() if _runs_here(name)}
    named = [name.strip() for name in words.split(",") if name.strip()]
    known = list(REGISTRATIONS)
    wrong = [name for name in named if name not in REGISTRATIONS]
    if wrong or not named:
        lines = [f"--methods: {shown(n)}: no such method; known: {', '.join(known)}{nearest(n, known)}" for n in wrong]
        raise BadInput(lines or [f"--methods: nothing named; known: {', '.join(known)}"])
    return {name: REGISTRATIONS[name].settings() for name in dict.fromkeys(named)}


def _runs_here(name: str) -> bool:
    from importlib.util import find_spec

    return name not in NEEDS or find_spec(NEEDS[name]) is not None


def chosen_cases(names: Sequence[str], changes: Sequence[str]) -> dict[str, FrameCase]:
    """Frame cases by name, with changes laid over each.

    Raises:
        BadInput: for an unknown case, or a change that is none.
    """
    known = list(CASES)
    if wrong := [name for name in names if name not in CASES]:
        raise BadInput([f"{shown(n)}: no such frame case; known: {', '.join(known)}{nearest(n, known)}" for n in wrong])
    update: dict[str, Any] = {}
    for change in changes:
        key, equals, text = change.partition("=")
        if not equals or key not in FrameCase.model_fields:
            fields = list(FrameCase.model_fields)
            hint = nearest(key, fields)
            raise BadInput([f"--set {shown(change)}: give FIELD=VALUE with one of {', '.join(fields)}{hint}"])
        update[key] = scalar(text)
    try:
        return {name: CASES[name].model_copy(update=update) for name in dict.fromkeys(names)}
    except ValidationError as error:
        lines = [f"--set {e['loc'][0]}: got {shown(e['input'])}; {e['msg'].lower()}" for e in error.errors()]
        raise BadInput(list(dict.fromkeys(lines))) from None


def _on_frames(
    cases: dict[str, FrameCase], methods: dict[str, Settings], seeds: int, workers: int, progress: Report
) -> list[FrameError]:
    from scenarios.bench.frame_bench import frame_errors

    errors, total = [], len(cases) * seeds * len(methods)
    for error in frame_errors(cases, methods, seeds, workers):
        errors.append(error)
        progress("frames by methods", len(errors), total)
    return errors


def _on_scans(
    names: Sequence[str],
    methods: dict[str, Settings],
    seeds: int,
    changes: Sequence[str],
    workers: int,
    progress: Report,
) -> tuple[list[FrameError], list[Cloud]]:
    from scenarios.bench.scans import scan_errors
    from scenarios.load import load_scenario

    errors, clouds = [], []
    for scenario in [load_scenario(name, changes) for name in dict.fromkeys(names)]:
        for seed in range(scenario.seed, scenario.seed + seeds):
            for found, cloud in scan_errors(scenario, seed, methods, workers, progress):
                errors += found
                clouds += [cloud] if seed == scenario.seed else []
    return errors, clouds


def table(result: Bench) -> str:
    """The result as text: a block a scenario, and the nearest method against each other one."""
    lines = []
    for scenario, errors in by_scenario(result.errors).items():
        lines += [f"{scenario}: {result.level} level, {_frames(errors)} frames", *_block(errors, result.level), ""]
        best = nearest_method(rows(errors, result.level))
        told = [p for p in result.pairs if p.scenario == scenario and best is not None and best.method in (p.a, p.b)]
        lines += [*(f"  {_pair_words(p)}" for p in told), ""]
    return "\n".join(lines).rstrip()


def _frames(errors: list[FrameError]) -> int:
    return len({(e.seed, e.frame) for e in errors})


def _block(errors: list[FrameError], level: str) -> list[str]:
    head = f"  {'method':18s} {'failed':>7s} {'weak':>5s}  {'centre mm: median [95 %]':26s} {'axis deg':>9s} "
    head += f"{'radius mm':>10s} {'x bound: axis':>14s} {'centre':>7s} {'radius':>7s} {'travel mm':>10s} {'ms':>8s}"
    lines = [head]
    for row in rows(errors, level):
        c = row.center_median_mm
        center = f"{c.median:.4f} [{c.low:.4f}, {c.high:.4f}]" if row.failures < row.frames else "-"
        axis = f"{row.axis_median_deg.median:9.4f}" if row.frames > row.failures else f"{'-':>9s}"
        ratios = [_short(v) for v in (row.crb_ratio_axis, row.crb_ratio_center, row.crb_ratio_radius)]
        lines.append(
            f"  {row.method:18s} {row.failures:7d} {row.weak:5d}  {center:26s} {axis} {_short(row.radius_rms_mm):>10s} "
            f"{ratios[0]:>14s} {ratios[1]:>7s} {ratios[2]:>7s} {_short(row.travel_rms_mm):>10s} {row.ms_median:8.2f}"
        )
    return lines


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _pair_words(pair: Pair) -> str:
    d = pair.difference_mm
    floor = "" if pair.floor_mm is None else f", noise floor {pair.floor_mm:.4f} mm"
    return (
        f"{pair.a} less {pair.b}: {d.median:+.4f} [{d.low:+.4f}, {d.high:+.4f}] mm, p {pair.p:.1g}, "
        f"{pair.frames} frames{floor}: {winner_words(pair)}"
    )


def _write(result: Bench, folder: Path, seconds: float) -> None:
    """Tables without times, which are in `run.json`."""
    per_scenario = [
        {"scenario": scenario, **_flat(row)}
        for scenario, errors in by_scenario(result.errors).items()
        for row in rows(errors, result.level)
    ]
    _csv(folder / "rows.csv", per_scenario)
    _csv(folder / "pairs.csv", [{**p._asdict(), **_spread("difference_mm", p.difference_mm)} for p in result.pairs])
    _csv(folder / "frames.csv", [_frame(e) for e in result.errors])
    times = {
        scenario: {row.method: round(row.ms_median, 4) for row in rows(errors, result.level)}
        for scenario, errors in by_scenario(result.errors).items()
    }
    made = {**versions(), "level": result.level, "seeds": result.seeds, "seconds": round(seconds, 3), "ms": times}
    (folder / "run.json").write_text(json.dumps(made, indent=1) + "\n")


def _flat(row: Row) -> dict[str, Any]:
    out = {k: v for k, v in row._asdict().items() if k not in ("ms_median", "scenarios")}
    return {
        **out,
        **_spread("center_median_mm", row.center_median_mm),
        **_spread("axis_median_deg", row.axis_median_deg),
    }


def _spread(name: str, value: Any) -> dict[str, float]:
    return {name: value.median, f"{name}_low": value.low, f"{name}_high": value.high}


def _frame(error: FrameError) -> dict[str, Any]:
    out = {k: v for k, v in error._asdict().items() if k not in ("ms", "bound")}
    return {**out, **{f"bound_{k}": v for k, v in error.bound._asdict().items()}, "failed": error.failed}


def _csv(file: Path, lines: list[dict[str, Any]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as out:
        if not lines:
            return
        writer = csv.DictWriter(out, list(lines[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: "" if v is None else v for k, v in line.items()} for line in lines)
