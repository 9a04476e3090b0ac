"""The cheap fidelities against pictures: the same scenarios and seeds, score by score, and where they agree."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from scenarios.document import BadInput, read_file
from scenarios.fidelity.agreed import PICTURE, Compared, Comparison, Cost, optics_of, read_comparisons
from scenarios.load import load_scenario
from scenarios.provenance import versions
from scenarios.run_folder import whole_file
from scenarios.study.code import code_version
from scenarios.study.conduct import How, conduct, opened
from scenarios.study.gather import mean_of
from scenarios.study.ledger import DONE, STATES
from scenarios.study.study import save_study

LIBRARY = Path(__file__).with_name("library.yaml")
JSON_FILE, CSV_FILE, PAGE_FILE = "fidelity.json", "fidelity.csv", "fidelity.html"
SHORTEST_S = 1e-3
CODE_DIGITS = 8
NEVER_COMPARED = {"ms_per_frame"}

Changes = Mapping[str, Any]
Report = Callable[[str, int, int], None]
Say = Callable[[str], None]


def of_library(names: list[str]) -> dict[str, Changes]:
    """Scenarios of the library, those named or all, each with what makes its pictures affordable.

    Raises:
        BadInput: for a name that is not compared.
    """
    known: dict[str, Changes] = read_file(LIBRARY).data
    if unknown := [name for name in names if name not in known]:
        raise BadInput([f"{', '.join(unknown)}: --library has {', '.join(known)}"])
    return {name: known[name] for name in names or known}


def compare(
    bases: Mapping[str, Changes],
    fidelities: list[str],
    seeds: int,
    noise: str,
    out: Path,
    how: How,
    progress: Report,
    say: Say,
) -> list[Comparison]:
    """Run scenarios with their changes in every fidelity with the same seeds, and write what agrees.

    Every scenario is written when it is done, beside those that the folder holds already.

    Raises:
        BadInput: when a scenario is none, too few seeds are left to compare, or the folder is of another noise.
    """
    from scenarios.fidelity.page import write_page

    out.mkdir(parents=True, exist_ok=True)
    found = _kept(out / JSON_FILE, noise)
    for base, changes in bases.items():
        study, folder = _study(base, changes, [*fidelities, PICTURE], seeds, noise, out)
        say(f"{base}: {len(fidelities) + 1} fidelities x {seeds} seeds")
        conduct(study, folder, how, progress, say)
        found[folder.name] = _comparison(base, changes, fidelities, seeds, folder)
        _write(out, list(found.values()), noise)
        write_page(out / PAGE_FILE, list(found.values()), noise)
    return list(found.values())


def _kept(file: Path, noise: str) -> dict[str, Comparison]:
    """What an earlier comparison left in the folder, by scenario."""
    if not file.exists():
        return {}
    of, kept = read_comparisons(file)
    if of != noise:
        raise BadInput([f"{file}: compares with the noise {of}; choose another folder with --out"])
    return {one.scenario: one for one in kept}


def _comparison(base: str, changes: Changes, fidelities: list[str], seeds: int, folder: Path) -> Comparison:
    names, scores, seconds = _scores(folder)
    scene = load_scenario(base)
    return Comparison(
        scenario=folder.name,
        seeds=seeds,
        version=versions()["pipetwin"],
        code=code_version()[:CODE_DIGITS],
        changes=dict(changes),
        optics=optics_of(scene),
        bore_radius_mm=scene.pipe.bore_radius_mm,
        costs=[Cost(one, seconds[one], seconds[PICTURE] / seconds[one]) for one in fidelities],
        scores=[
            _compared(one, name, scores[one][:, k], scores[PICTURE][:, k])
            for one in fidelities
            for k, name in enumerate(names)
            if name not in NEVER_COMPARED
        ],
    )


def _study(base: str, changes: Changes, fidelities: list[str], seeds: int, noise: str, out: Path) -> tuple[Path, Path]:
    file = Path(base)
    name = file.stem
    document = {
        "name": name,
        "why": "The same seeds in every fidelity.",
        "base": str(file.resolve()) if file.is_file() else base,
        "set": {"sensing.points": noise, **changes},
        "factors": {"sensing.fidelity": fidelities},
        "design": {"kind": "grid", "seeds": seeds},
    }
    study = out / f"{name}.yaml"
    save_study(document, study)
    return study, out / name


def _scores(folder: Path) -> tuple[list[str], dict[str, Float[np.ndarray, "seeds scores"]], dict[str, float]]:
    """Names of the scores; each fidelity's by seed, NaN where there is none; and the median seconds of its runs."""
    values: dict[str, dict[int, list[Any]]] = {}
    seconds: dict[str, list[float]] = {}
    with opened(folder) as ledger:
        names = ledger.about("identity")["record"]
        for row in ledger.rows(by_key=False):
            (fidelity,) = row.values
            whole = row.state == STATES[DONE]
            values.setdefault(fidelity, {})[row.seed] = row.figures if whole else [None] * len(names)
            seconds.setdefault(fidelity, []).extend(
                [max(row.seconds, SHORTEST_S)] if whole and row.seconds is not None else []
            )
    if empty := [name for name, spent in seconds.items() if not spent]:
        raise BadInput([f"{folder}: no run in {', '.join(empty)} ended well; `pipetwin status {folder}` says why"])
    tables = {name: np.array([rows[seed] for seed in sorted(rows)], dtype=float) for name, rows in values.items()}
    return names, tables, {name: float(np.median(spent)) for name, spent in seconds.items()}


def _compared(fidelity: str, name: str, cheap: np.ndarray, dear: np.ndarray) -> Compared:
    mean = mean_of(cheap - dear)
    there = dear[np.isfinite(dear)]
    spread = float(there.std(ddof=1)) if there.size > 1 else float("nan")
    center = float(there.mean()) if there.size else float("nan")
    half = float("nan") if mean.half is None else mean.half
    return Compared(fidelity, name, center, spread, mean.mean, half, mean.n)


def _write(out: Path, found: list[Comparison], noise: str) -> None:
    scenarios = [asdict(one) for one in found]
    for one in scenarios:
        one["scores"] = [{key: _plain(value) for key, value in row.items()} for row in one["scores"]]
    with whole_file(out / JSON_FILE) as work:
        work.write_text(json.dumps({"noise": noise, "scenarios": scenarios}, indent=1) + "\n")
    lines = [{"scenario": one.scenario, **asdict(row), "verdict": row.verdict} for one in found for row in one.scores]
    with whole_file(out / CSV_FILE) as work, work.open("w", newline="") as text:
        rows = csv.DictWriter(text, list(lines[0]))
        rows.writeheader()
        rows.writerows(lines)


def _plain(value: Any) -> Any:
    """JSON has no NaN; and nobody reads more than five digits of an interval."""
    if not isinstance(value, float):
        return value
    return float(f"{value:.5g}") if math.isfinite(value) else None
