"""Where a scenario leaves what the testbench was held against: real pictures, the paper, tests of its physics."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from scenarios.scenario import Scenario
from sensor_model.rig import preset_rig, rigs

PAPER = "the paper's scans"
REAL = "the real pictures"
PHYSICS = "the tests of the robot's physics"


class Range(NamedTuple):
    """A figure of a scenario, the range that something real or tested covers, and what that is."""

    name: str
    value: Callable[[Scenario], float | None]
    low: float
    high: float
    by: str


def _diameter_mm(scenario: Scenario) -> float:
    return 2 * scenario.pipe.bore_radius_mm


def _deepest(scenario: Scenario) -> float | None:
    pipe = scenario.pipe
    depths = [100 * feature.size(pipe.bore_radius_mm).depth_mm / pipe.wall_mm for feature in pipe.features]
    return max(depths, default=None)


def _shallowest(scenario: Scenario) -> float | None:
    pipe = scenario.pipe
    depths = [100 * feature.size(pipe.bore_radius_mm).depth_mm / pipe.wall_mm for feature in pipe.features]
    return min(depths, default=None)


def _tilt(scenario: Scenario) -> float | None:
    drive = scenario.drive
    if drive.kind == "recorded":
        return max(max(abs(row[5]), abs(row[6])) for row in drive.rows)
    return max(map(abs, drive.tilt_deg)) if drive.kind == "gantry" else None


def _offset(scenario: Scenario) -> float | None:
    drive = scenario.drive
    if drive.kind == "recorded":
        return max((row[2] ** 2 + row[3] ** 2) ** 0.5 for row in drive.rows)
    return (drive.offset_mm[0] ** 2 + drive.offset_mm[1] ** 2) ** 0.5 if drive.kind == "gantry" else None


def _roll(scenario: Scenario) -> float | None:
    drive = scenario.drive
    if drive.kind == "recorded":
        return max(row[4] for row in drive.rows) - min(row[4] for row in drive.rows)
    if drive.kind == "gantry":
        return max((abs(stage.roll_to_deg) for stage in drive.stages if stage.roll_to_deg is not None), default=None)
    return max((abs(stage.to_deg) for stage in drive.roll_to), default=None)


def _optics(name: str) -> Callable[[Scenario], float | None]:
    return lambda scenario: None if scenario.sensing.fidelity == "points" else getattr(scenario.sensing.optics, name)


def _travel(scenario: Scenario) -> float:
    low, high = scenario.drive.span_mm
    return high - low


RANGES = (
    Range("bore diameter (mm)", _diameter_mm, 136.0, 153.0, f"{REAL} (about 140 mm) and {PAPER} (152.4 mm)"),
    Range("deepest defect (% of the wall)", _deepest, 0.0, 100.0, f"{PAPER} (25 to 100 %)"),
    Range("shallowest defect (% of the wall)", _shallowest, 25.0, 100.0, f"{PAPER} (25 to 100 %)"),
    Range("tilt (degrees)", _tilt, 0.0, 3.5, f"{REAL} (up to 3.5 degrees)"),
    Range("offset from the axis (mm)", _offset, 0.0, 20.0, f"{REAL} (up to 20 mm)"),
    Range("roll (degrees)", _roll, 0.0, 25.0, f"{PAPER} and {PHYSICS} (up to 25 degrees)"),
    Range("speed (mm/s)", lambda scenario: scenario.drive.speed_mm_s, 0.0, 100.0, PHYSICS),
    Range("travel (mm)", _travel, 0.0, 10_000.0, "the drives of 10 m"),
    Range("inclination (degrees)", lambda scenario: abs(scenario.pipe.inclination_deg), 0.0, 90.0, PHYSICS),
    Range("ovality (%)", lambda scenario: scenario.pipe.ovality_pct, 0.0, 3.0, "the tests of the registrations"),
    Range("frames a second", lambda scenario: scenario.sensing.frame_rate_hz, 0.1, 15.0, "the real sensor's 15"),
    Range("haze", _optics("haze"), 0.0, 0.38, f"the look of {REAL}"),
    Range("defocus (px)", _optics("defocus_px"), 0.0, 5.0, f"the look of {REAL}"),
    Range("jaggedness of the slide (degrees)", _optics("slide_jag_deg"), 0.0, 0.32, f"the look of {REAL}"),
    Range("photon noise", _optics("shot_noise"), 0.0, 0.018, f"the look of {REAL}"),
    Range("read noise", _optics("read_noise"), 0.0, 0.004, f"the look of {REAL}"),
)
SEEN_FEATURES = {"pocket", "scratch"}  # milled into the paper's pipes


def extrapolated(scenario: Scenario) -> list[str]:
    """Why results of this scenario go beyond what was validated; nothing where they do not."""
    reasons = []
    for one in RANGES:
        value = one.value(scenario)
        if value is not None and not one.low <= value <= one.high * (1 + 1e-9):
            side = f"at least {one.low:g}" if value < one.low else f"at most {one.high:g}"
            reasons.append(f"{one.name}: {value:.4g}; validated for {side} by {one.by}")
    return reasons + _kinds(scenario)


def reasons_of(scenarios: Iterable[Scenario]) -> list[str]:
    """Why these are extrapolated: each figure once, with its first value."""
    reasons: dict[str, str] = {}
    for scenario in scenarios:
        for reason in extrapolated(scenario):
            reasons.setdefault(reason.partition(":")[0], reason)
    return list(reasons.values())


def _kinds(scenario: Scenario) -> list[str]:
    """What is there that nothing real was held against."""
    reasons = []
    others = sorted({feature.kind for feature in scenario.pipe.features} - SEEN_FEATURES)
    if others:
        reasons.append(f"features of kind {', '.join(others)}: only pockets and scratches are in {PAPER}")
    for name in ("joints", "debris", "tapers"):
        if getattr(scenario.pipe, name):
            reasons.append(f"{name}: in {PHYSICS} alone")
    camera, known = scenario.rig.camera, preset_rig().camera
    if (camera.width_px, camera.height_px) != (known.width_px, known.height_px):
        reasons.append(f"a camera of {camera.width_px} x {camera.height_px} px: the real one has 1664 x 1232")
    if not any(_alike(scenario.rig, preset_rig(name)) for name in rigs()):
        reasons.append("a rig of other slits than the real sensor's")
    return reasons


def _alike(one: Any, other: Any) -> bool:
    """Whether two rigs have the same slits to within half a degree."""
    a, b = one.projector.slits, other.projector.slits
    same = [x.name for x in a] == [y.name for y in b]
    return same and all(abs(x.half_angle_deg - y.half_angle_deg) < 0.5 for x, y in zip(a, b, strict=True))
