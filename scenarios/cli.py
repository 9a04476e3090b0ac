"""The command `pipetwin`: each command parses, calls one function and prints; nothing heavy is imported before that."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from scenarios import calibrate_commands
from scenarios.bench.commands import app as bench_commands
from scenarios.cores import cores
from scenarios.fidelity import commands as fidelity_commands
from scenarios.field import commands as field_commands
from scenarios.field import identify_commands, pages_commands
from scenarios.options import AsJson, Jobs
from scenarios.paper.commands import app as paper_commands
from scenarios.plan import commands as plan_commands
from scenarios.study import commands as study_commands
from scenarios.trust import commands as trust_commands

FAILED, BAD_INPUT, INTERRUPTED, TERMINATED = 1, 2, 130, 143

app = typer.Typer(
    help="Scan a carved pipe with a simulated inspection robot, measure it blindly, and score the measurement.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
)
calibrate_commands.register(app)
identify_commands.register(app)

app.add_typer(bench_commands, name="bench")
app.add_typer(paper_commands, name="paper")

ScenarioName = Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `list` shows, or a YAML file.")]
OutFolder = Annotated[
    Path | None, typer.Option("-o", "--out", metavar="DIR", help="Run folder.  [default: runs/NAME-seedN]")
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed instead of the scenario's.")]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change one setting, as pipe.features.0.depth_mm=3; may repeat."),
]
MethodFile = Annotated[
    Path | None, typer.Option("--method", metavar="METHOD", help="Measure by these: a file, or field.")
]


@app.command()
def demo(out: OutFolder = None, seed: Seed = None, as_json: AsJson = False, jobs: Jobs = None) -> None:
    """Run `paper-robot`, from the drive to the scored report."""
    _run("paper-robot", out, seed, [], as_json, jobs)


@app.command()
def run(
    scenario: ScenarioName,
    out: OutFolder = None,
    seed: Seed = None,
    changes: Changes = None,
    method: MethodFile = None,
    as_json: AsJson = False,
    jobs: Jobs = None,
) -> None:
    """Run a scenario and print its score and where the report is."""
    _run(scenario, out, seed, changes or [], as_json, jobs, method)


def _run(
    name: str,
    out: Path | None,
    seed: int | None,
    changes: list[str],
    as_json: bool,
    jobs: int | None,
    method: Path | None = None,
) -> None:
    from scenarios.load import load_scenario

    scenario = load_scenario(name, changes, seed, method)
    from scenarios.extrapolated import extrapolated
    from scenarios.progress import Progress
    from scenarios.run import run as run_scenario

    _say_without_effect(scenario)
    out = out or Path("runs") / f"{scenario.name}-seed{scenario.seed}"
    progress = Progress()
    try:
        score = run_scenario(scenario, out, jobs or cores(), progress)
    finally:
        progress.close()
    report = out / "report.html"
    if as_json:
        _print_json(score)
        print(f"report: {report}", file=sys.stderr)
        return
    width = max(map(len, score), default=0)
    for key, value in score.items():
        print(f"{key:<{width}}  {_figure(value)}")
    for reason in extrapolated(scenario):
        print(f"extrapolated: {reason}")
    print(f"report: {report}")


def _say_without_effect(scenario: Any) -> None:
    from sensor_model.sense import without_effect

    if said := without_effect(scenario.sensing):
        print(f"{scenario.name}: {said}", file=sys.stderr)


@app.command()
def view(
    run_dir: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that `run` made.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Page.  [default: RUN/view.html]")
    ] = None,
) -> None:
    """Make a page that plays a run's drive: the robot in the pipe, its light, slip and roll; it opens offline."""
    from scenarios.view.drive import read_run
    from scenarios.view.page import write_view

    out = out or run_dir / "view.html"
    write_view(read_run(run_dir), out)
    print(f"page: {out}")


@app.command("list")
def list_all(as_json: AsJson = False) -> None:
    """List scenarios, drives, features and registrations."""
    known = _known()
    if as_json:
        _print_json(known)
        return
    width = max(len(name) for group in known.values() for name in group)
    for heading, group in known.items():
        print(heading)
        for name, line in group.items():
            print(f"  {name:<{width}}  {line}")


def _known() -> dict[str, dict[str, str]]:
    from algorithms.registration import REGISTRATIONS
    from scenarios.document import read_file
    from scenarios.load import library
    from twin.drives import DRIVES
    from twin.features import FAMILIES

    return {
        "scenarios": {name: str(read_file(path).data["why"]) for name, path in library().items()},
        "drives": {name: _line(drive.settings) for name, drive in DRIVES.items()},
        "features": {name: _line(family) for name, family in FAMILIES.items()},
        "registrations": {name: _line(method.settings) for name, method in REGISTRATIONS.items()},
    }


def _line(settings: type) -> str:
    """The sentence that the settings' module says of itself."""
    return (sys.modules[settings.__module__].__doc__ or "").strip().splitlines()[0]


@app.command()
def check(file: ScenarioName, changes: Changes = None) -> None:
    """Say all that is wrong with a scenario file."""
    from scenarios.load import load_scenario

    scenario = load_scenario(file, changes or [])
    _say_without_effect(scenario)
    pipe = scenario.pipe
    count = f"{len(pipe.features)} feature{'' if len(pipe.features) == 1 else 's'}"
    print(f"{file}: ok: {scenario.name}, {pipe.length_mm:g} mm of pipe with {count}, drive {scenario.drive.kind}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of a scenario, for an editor."""
    from scenarios.scenario import Scenario

    _print_json(Scenario.model_json_schema())


@app.command("dump-config")
def dump_config(scenario: ScenarioName = "paper-robot", seed: Seed = None, changes: Changes = None) -> None:
    """Print a scenario with every setting written out."""
    from scenarios.load import load_scenario
    from scenarios.settings_yaml import settings_yaml

    sys.stdout.write(settings_yaml(load_scenario(scenario, changes or [], seed)))


@app.command("export-stl")
def export_stl(
    scenario: ScenarioName,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The STL file to write.")],
    changes: Changes = None,
) -> None:
    """Write a scenario's carved pipe as a watertight STL."""
    from scenarios.load import load_scenario
    from scenarios.run_folder import whole_file
    from twin.mesh import save_stl

    pipe = load_scenario(scenario, changes or []).pipe
    with whole_file(file) as work:
        save_stl(pipe, work)
    print(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


@app.command()
def doctor(as_json: AsJson = False) -> None:
    """Say what this machine lacks, and the command that mends it."""
    from scenarios.doctor import examine

    checks = examine()
    if as_json:
        _print_json([item._asdict() for item in checks])
    else:
        for item in checks:
            state = "ok" if item.ok else "none" if item.optional else "missing"
            mend = "" if item.ok else f"  ->  {item.mend}"
            print(f"{state:<7}  {item.name}: {item.seen}{mend}")
    if not all(item.ok or item.optional for item in checks):
        raise typer.Exit(FAILED)


trust_commands.register(app)
study_commands.register(app)
fidelity_commands.register(app)
plan_commands.register(app)
pages_commands.register(app)
field_commands.register(app)


def _figure(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _print_json(value: Any) -> None:
    print(json.dumps(value, indent=2))


def main() -> NoReturn:
    """Run the command line; exit with 0, 1 (failed), 2 (bad input), 130 (Ctrl-C) or 143 (terminated)."""
    # a plain SIGTERM would skip the clean-up of a half-written run folder
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(TERMINATED))
    try:
        app(prog_name="pipetwin")
    except SystemExit as end:
        if end.code in (INTERRUPTED, TERMINATED):
            print("pipetwin: stopped; nothing half-written is left", file=sys.stderr)
        raise
    except Exception as error:
        if os.environ.get("PIPETWIN_DEBUG", "0") not in ("", "0"):
            raise
        sys.exit(_report(error))
    sys.exit(0)


def _report(error: Exception) -> int:
    """Say an error in one line (bad input: one for each fault), and give the exit status."""
    from scenarios.document import BadInput

    if isinstance(error, BadInput):
        print("\n".join(error.lines), file=sys.stderr)
        return BAD_INPUT
    first = (str(error) or type(error).__name__).splitlines()[0]
    ours = type(error).__module__.split(".")[0] in ("twin", "sensor_model", "algorithms", "scenarios")
    kind = "" if ours or isinstance(error, OSError) else f"{type(error).__name__}: "
    print(f"pipetwin: failed: {kind}{first} (PIPETWIN_DEBUG=1 shows where)", file=sys.stderr)
    return FAILED


if __name__ == "__main__":
    main()
