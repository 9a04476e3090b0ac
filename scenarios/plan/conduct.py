"""A plan from its file to its page; called again, it goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from scenarios.plan.findings import read_scans
from scenarios.plan.plan_file import load_plan
from scenarios.plan.result import Result, as_json, result_of
from scenarios.plan.scans import scans_needed
from scenarios.plan.studies import keep_time, studies_of, write_study
from scenarios.run_folder import whole_file
from scenarios.study.conduct import How, conduct

FOLDER = "plans"
FEW_SCANS = 20

Report = Callable[[str, int, int], None]
Say = Callable[[str], None]


def make_plan(file: Path, out: Path | None, how: How, progress: Report, say: Say) -> tuple[Path, Result]:
    """Run what is left of a plan's studies, and write what they say.

    Raises:
        BadInput: when the plan is unsound, its scene cannot be scanned, or the time limit cannot be kept.
    """
    from scenarios.plan.page import write_page

    plan = load_plan(file)
    folder = out or Path(FOLDER) / plan.file.name
    folder.mkdir(parents=True, exist_ok=True)
    scans, few = scans_needed(plan), min(scans_needed(plan), FEW_SCANS)
    studies = studies_of(plan, scans, few)
    keep_time(plan, {name: rows for name, (_, rows) in studies.items()}, how, say)
    found = {}
    for name, (changes, rows) in studies.items():
        study = write_study(plan, folder / f"{name}.yaml", changes, rows)
        conduct(study, folder / name, how, progress, say)
        found[name] = read_scans(folder / name, plan)
    result = result_of(plan, found, few)
    with whole_file(folder / "plan.json") as work:
        work.write_text(json.dumps(as_json(result), indent=2) + "\n")
    write_page(folder / "plan.html", result)
    return folder, result
