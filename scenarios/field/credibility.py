"""How far a twin's figures can be believed, in the spirit of NASA-STD-7009: verified, validated, assumed, inputs."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import BaseModel

from scenarios.extrapolated import extrapolated
from scenarios.report.calibration_page import Section
from scenarios.scenario import Scenario
from sensor_model.plain_yaml import plain_data
from sensor_model.settings import Settings

SOURCES = Path(__file__).parent / "sources.yaml"

VERIFIED = (  # the model computes what it says it does
    (
        "one wall for light, wheels and scoring",
        "mesh, ray-caster and contacts agree on r(theta, z)",
        "tests/twin/test_mesh.py",
    ),
    ("pictures", "two renderers that share no code agree", "tests/sensor_model/test_drawing.py"),
    ("contact", "Coulomb's limits, energy, a ring of 48 boxes", "tests/twin/test_physics.py, test_box_ring.py"),
    ("IMU", "Allan deviation of an 8 hour rest log within 10 %", "tests/sensor_model/test_imu_device.py"),
    ("registration", "at the Cramer-Rao bound on exact frames", "pipetwin bench registration"),
    ("statistics", "printed answers of handbooks", "docs/trust.md"),
)
VALIDATED = (  # the model is like the real thing
    ("camera and projector", "calibrated on the real sensor's boards, beside the published figures", "README"),
    ("decoding", "two real frames in a pipe, 499 slit places labelled by eye", "README"),
    ("look of the pictures", "the look endoscope within 16 % of both real frames", "pipetwin decode --twin endoscope"),
    ("attitude", "hand-eye calibration on the published log", "pipetwin calibrate imu"),
)
ASSUMED = (
    "The robot's springs, masses, friction and slip: no real drive of this robot was at hand.",
    "Sizing: the paper prints sizes of its defects, but no scan of them is public.",
    "The pipe is straight, its wall matt, and nothing moves in it but the robot.",
    "What was identified from a log holds for that log's conditions; quantities it does not tell stay at defaults.",
)


class Source(Settings):
    """Where a group's default values come from."""

    kind: Literal["measured", "published", "guessed"]
    of: str


@cache
def sources() -> dict[str, Source]:
    """By group of settings, the path as in a scenario."""
    held = plain_data(SOURCES.read_text())
    return {group: Source.model_validate(row) for group, row in held.items()}


def credibility(scenario: Scenario | None) -> list[Section]:
    """The sections of a page; without a scenario, those that hold for every one."""
    parts = [
        Section("Verified: it computes what it says", [], [("part", "how", "where"), *VERIFIED]),
        Section("Validated: it is like the real thing", [], [("part", "against what", "where"), *VALIDATED]),
        Section("Assumed", list(ASSUMED)),
    ]
    return [*parts, _inputs(scenario), _range(scenario)] if scenario else parts


def _inputs(scenario: Scenario) -> Section:
    """Each group: at its default, with that one's source; or as the scenario states it."""
    rows: list[tuple[str, ...]] = [("settings", "values", "source")]
    for group, source in sources().items():
        changed = _changed(scenario, group)
        said = "stated by the scenario" if changed else source.kind
        rows.append((group, said, f"by default {source.kind}: {source.of}" if changed else source.of))
    return Section("Inputs, and where they come from", [], rows)


def _changed(scenario: Scenario, group: str) -> bool:
    """Whether a group is something else than what one gets by leaving it out; what must be given is always stated."""
    held: BaseModel = scenario
    *outer, last = group.split(".")
    for name in outer:
        held = getattr(held, name)
    default = type(held).model_fields[last]
    if outer[:1] == ["rig"]:
        return getattr(held, last) != getattr(Scenario.model_fields["rig"].default, last)
    return default.is_required() or getattr(held, last) != default.get_default()


def _range(scenario: Scenario) -> Section:
    reasons = extrapolated(scenario)
    if reasons:
        return Section("Extrapolated", ["This scenario goes beyond what was validated:", *reasons])
    return Section("Within the validated range", ["Nothing in this scenario goes beyond what was validated."])
