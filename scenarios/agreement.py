"""What the parts of a scenario must agree on: features and drive with the pipe, the rigs with the robot."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, pi
from typing import Any

from scenarios.document import Keys, shown
from scenarios.faults import Fault
from scenarios.scenario import Scenario
from twin.features.base import HALF_BOX_ARC, HALF_BOX_Z, Feature
from twin.pipe import Pipe
from twin.simulate import check_room

TOLERANCE_MM = 1e-9
WHEEL_TOLERANCE = 0.02
WIDEST_PLANAR_SHARE = 0.4  # of half the circumference: a flat floor cannot reach around


def cross_checks(pipe: Pipe | None, features: dict[int, Feature], drive: Any) -> list[Fault]:
    """Faults that lie between sound parts: features and drive against the pipe (None where a part is unsound)."""
    if pipe is None:
        return []
    faults = [fault for index, feature in features.items() for fault in _feature_faults(pipe, index, feature)]
    return faults + list(_drive_faults(pipe, drive))


def whole_checks(scenario: Scenario) -> list[Fault]:
    """Faults that only a scenario sound in all its parts can show: room for the drive, a figure for every wheel."""
    faults = []
    try:
        check_room(scenario.pipe, scenario.robot, scenario.drive)
    except ValueError as error:
        faults.append(Fault(("drive",), scenario.drive.kind, str(error)))
    faults += _rig_faults(scenario)
    wheels, errors = len(scenario.rig.wheels.diameters_mm), scenario.sensing.encoders.wheel_diameter_error_pct
    if wheels != scenario.robot.leg_count:
        allowed = f"one for each of the robot's {scenario.robot.leg_count} legs"
        faults.append(Fault(("rig", "wheels", "diameters_mm"), f"{wheels} values", allowed))
    if len(errors) != scenario.robot.leg_count:
        allowed = f"one for each of the robot's {scenario.robot.leg_count} legs"
        keys: Keys = ("sensing", "encoders", "wheel_diameter_error_pct")
        faults.append(Fault(keys, f"{len(errors)} values", allowed))
    return faults


def _rig_faults(scenario: Scenario) -> Iterator[Fault]:
    """What two rigs and a robot must agree on: the true one differs in calibration, not in kind."""
    rig, true = scenario.rig, scenario.true_rig or scenario.rig
    turned = 2 * scenario.robot.wheel_radius_mm
    for i, diameter in enumerate(rig.wheels.diameters_mm):
        if abs(diameter / turned - 1) > WHEEL_TOLERANCE:
            allowed = f"the robot's wheels measure {turned:g} mm; small errors go into sensing.encoders"
            yield Fault(("rig", "wheels", "diameters_mm", i), f"{diameter:g}", allowed)
    if true.wheels != rig.wheels:
        allowed = "as in rig; what wheels really roll goes into sensing.encoders.wheel_diameter_error_pct"
        yield Fault(("true_rig", "wheels"), "other wheels", allowed)
    size, expected = ((r.camera.width_px, r.camera.height_px) for r in (true, rig))
    if size != expected:
        yield Fault(("true_rig", "camera"), f"{size} px", f"a picture of {expected} px, as in rig")
    if [s.name for s in true.projector.slits] != [s.name for s in rig.projector.slits]:
        yield Fault(("true_rig", "projector", "slits"), "other colours", "the same colour pairs as in rig")


def _feature_faults(pipe: Pipe, index: int, feature: Feature) -> Iterator[Fault]:
    keys: Keys = ("pipe", "features", index)
    half_z, half_arc = (float(half) for half in feature.row()[[HALF_BOX_Z, HALF_BOX_ARC]])
    widest = pi * pipe.bore_radius_mm * (WIDEST_PLANAR_SHARE if getattr(feature, "floor", "") == "planar" else 1.0)
    if half_arc > widest:
        allowed = f"would be {2 * half_arc:.4g} mm wide; at most {2 * widest:.4g} mm go around this bore"
        yield Fault(keys, feature.kind, allowed)  # type: ignore[attr-defined]
        return
    deepest = feature.size(pipe.bore_radius_mm).depth_mm
    if not feature.inward and deepest > pipe.wall_mm + TOLERANCE_MM:
        at = "" if deepest == feature.depth_mm else f" ({deepest:.4g} mm where it is deepest)"
        allowed = f"must be at most the wall, {pipe.wall_mm:g} mm{at}"
        yield Fault((*keys, "depth_mm"), f"{feature.depth_mm:g}", allowed)
    low, high = feature.distance_mm - half_z, feature.distance_mm + half_z
    if low < pipe.start_mm - TOLERANCE_MM or high > pipe.end_mm + TOLERANCE_MM:
        where = f"the {feature.kind} would reach from {low:g} to {high:g} mm"  # type: ignore[attr-defined]
        allowed = f"{where}, and the pipe from {pipe.start_mm:g} to {pipe.end_mm:g} mm"
        yield Fault((*keys, "distance_mm"), f"{feature.distance_mm:g}", allowed)


def _drive_faults(pipe: Pipe, drive: Any) -> Iterator[Fault]:
    named = {"start_mm", "end_mm"} & set(getattr(type(drive), "model_fields", ()))
    places: dict[Keys, Any] = {(name,): getattr(drive, name) for name in sorted(named)}
    places |= {("stages", i, "to_mm"): stage.to_mm for i, stage in enumerate(getattr(drive, "stages", ()))}
    for keys, place in places.items():
        if not pipe.start_mm <= place <= pipe.end_mm:
            allowed = f"must lie in the pipe, from {pipe.start_mm:g} to {pipe.end_mm:g} mm"
            yield Fault(("drive", *keys), f"{place:g}", allowed)
    offset = getattr(drive, "offset_mm", (0.0, 0.0))
    if hypot(*offset) >= pipe.bore_radius_mm:
        yield Fault(("drive", "offset_mm"), shown(offset), f"must lie within the bore, {pipe.bore_radius_mm:g} mm")
