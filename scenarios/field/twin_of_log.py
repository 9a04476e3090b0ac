"""A scenario out of what was identified: each value with its interval and source beside it, all else at its default."""

from __future__ import annotations

from io import StringIO
from typing import Any, NamedTuple

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from algorithms.identification.estimate import Estimate, Quantity, Unknown
from algorithms.identification.identify import Identified
from algorithms.identification.shaking import Band
from algorithms.identification.way import Way
from algorithms.types import Defect
from scenarios.document import BadInput
from sensor_model.optics import Optics
from sensor_model.recording import NominalPipe
from sensor_model.rig import Rig, preset_rig, rigs
from twin.robot import SIZES, Robot

BEHIND_MM, AHEAD_RADII, ROOM_MM = 400.0, 4.0, 100.0
CORNER_MM, EDGE_MM, LEAST_SIDE_MM = 3.0, 2.0, 2.0
SURE_SHARE = 0.7  # bands are many, and a rate that is none would swing the IMU on its lever: about four deviations
JAG_OF_RMS = 3.0  # a centre line between two edges, each straight between knots that lie evenly within +-1: RMS of 1/3
WHEEL_TOLERANCE = 0.02
WIDTH = 110


class Given(NamedTuple):
    """What the log brought along or the user said."""

    name: str
    rig: Rig
    pipe: NominalPipe
    fidelity: str
    optics: Optics


class Setting(NamedTuple):
    """One setting and the quantity that it is from."""

    group: str
    key: str
    value: Any
    quantity: Quantity


def scenario_text(given: Given, found: Identified, drive: dict[str, Any]) -> str:
    """The scenario as YAML with comments; it reads back as a scenario.

    Raises:
        BadInput: for a rig that no robot of ours can have.
    """
    settings = _settings(given, found.quantities)
    data = CommentedMap()
    data["name"] = given.name
    data["why"] = "The twin of a log, as `pipetwin identify` has it."
    data["pipe"] = _pipe(given, found, drive)
    robot = _robot(given)
    if robot:
        data["robot"] = robot
    data["drive"] = _commented_drive(drive, found)
    data["nominal_pipe"] = CommentedMap(given.pipe.model_dump())
    data["rig"] = _rig(given.rig)
    sensing = CommentedMap(fidelity=given.fidelity)
    for group in ("", "optics", "points", "imu", "encoders", "timing"):
        held = sensing if not group else CommentedMap(_base_optics(given) if group == "optics" else {})
        for one in settings:
            if one.group == group:
                held[one.key] = one.value
                held.yaml_add_eol_comment(told(one.quantity), one.key)
        if group and held:
            sensing[group] = held
    data["sensing"] = sensing
    data["seed"] = 0
    data.yaml_set_start_comment(_head(found))
    yaml = YAML()
    yaml.width = 4096  # a line that wraps would lose its comment's place
    text = StringIO()
    yaml.dump(data, text)
    return text.getvalue()


def told(quantity: Quantity) -> str:
    """A quantity in one line."""
    if not isinstance(quantity, Estimate):
        return f"not estimated: {quantity.reason}"
    interval = f"{quantity.value:.4g}, 95 % within {quantity.low:.4g} to {quantity.high:.4g}"
    return f"{interval} (n = {quantity.count}): {quantity.source}"


def _head(found: Identified) -> str:
    unknown = [f"{name}: {one.reason}" for name, one in found.quantities.items() if not isinstance(one, Estimate)]
    lines = ["Identified from a log. Beside each value: estimate, 95 % interval, how many values it rests on, source."]
    lines += list(found.said)
    if unknown:
        lines += ["Not estimated, and left at the default:", *(f"  {line}" for line in unknown)]
    return "\n".join(lines)


def _settings(given: Given, known: dict[str, Quantity]) -> list[Setting]:
    """Everything below `sensing` that was estimated."""
    rows: list[Setting] = []

    def add(group: str, key: str, name: str, factor: float = 1.0) -> None:
        quantity = known.get(name)
        if isinstance(quantity, Estimate):
            rows.append(Setting(group, key, _rounded(quantity.value * factor), quantity.scaled(factor)))

    add("", "frame_rate_hz", "frame_rate_hz")
    if given.fidelity == "points":
        add("points", "pixel_noise_px", "pixel_noise_px")
        add("points", "drop_out_share", "drop_out_share")
    else:
        add("optics", "shot_noise", "shot_noise")
        add("optics", "read_noise", "read_noise")
        add("optics", "haze", "haze")
        add("optics", "slide_jag_deg", "edge_jitter_deg", JAG_OF_RMS)
        add("optics", "slide_jag_cells", "edge_jitter_cells")
    add("imu", "update_rate", "imu_rate_hz")
    for key in ("gyroscope_noise_density", "accelerometer_noise_density"):
        add("imu", key, key)
        add("imu", key.replace("noise_density", "random_walk"), key.replace("noise_density", "random_walk"))
    add("imu", "gyroscope_bias_deg_s", "gyroscope_bias_deg_s")
    add("imu", "attitude_noise_deg", "attitude_noise_deg")
    add("encoders", "update_rate", "encoder_rate_hz")
    add("timing", "dropped_share", "dropped_share")
    rows = [row._replace(value=_bounded(row)) for row in rows]
    errors, quantity = _wheel_errors(known)
    if errors:
        listed = CommentedSeq(errors)
        listed.fa.set_flow_style()
        rows.append(Setting("encoders", "wheel_diameter_error_pct", listed, quantity))
    return rows


def _bounded(row: Setting) -> Any:
    """Within what the settings take; an estimate below zero is zero."""
    if row.key == "slide_jag_cells":
        return whole_cells(row.value)
    if row.key == "haze":
        return float(np.clip(row.value, 0, 1))
    return max(row.value, 0.0)


def whole_cells(value: float) -> int:
    """Cells of a slide as the optics take them."""
    return int(np.clip(round(value), 16, 4096))


def _wheel_errors(known: dict[str, Quantity]) -> tuple[list[float], Quantity]:
    """How much larger each wheel rolls than it is stated to: beside the mean, and all together where that is known."""
    beside = [one for name, one in known.items() if name.endswith("_scale_beside_mean_pct")]
    common = known.get("wheel_common_scale_pct", Unknown("nothing tells it"))
    if not any(isinstance(one, Estimate) for one in beside):
        return [], Unknown("the log has no wheels that roll")
    shared = common.value if isinstance(common, Estimate) else 0.0
    each = [one.value if isinstance(one, Estimate) else 0.0 for one in beside]
    errors = [_rounded(100 * ((1 + one / 100) * (1 + shared / 100) - 1)) for one in each]
    if isinstance(common, Estimate):
        return errors, common
    return errors, Unknown(f"beyond what the wheels have beside each other: {common.reason}")


def _pipe(given: Given, found: Identified, drive: dict[str, Any]) -> CommentedMap:
    known, pipe = found.quantities, CommentedMap()
    diameter, ovality = known.get("diameter_mm"), known.get("ovality_pct")
    radius = diameter.value / 2 if isinstance(diameter, Estimate) else given.pipe.inner_radius_mm
    places = [row[1] for row in drive["rows"]] if "rows" in drive else [0.0, drive["stages"][-1]["to_mm"]]
    features = [_pocket(one, given.pipe.wall_thickness_mm) for one in found.defects]
    lows = [min(places) - BEHIND_MM, *(one["distance_mm"] - one["length_mm"] / 2 - ROOM_MM for one in features)]
    highs = [
        max(places) + AHEAD_RADII * radius,
        *(one["distance_mm"] + one["length_mm"] / 2 + ROOM_MM for one in features),
    ]
    pipe["inner_radius_mm"] = _rounded(radius, 6)
    if diameter is not None:
        pipe.yaml_add_eol_comment(told(diameter.scaled(0.5)), "inner_radius_mm")
    pipe["wall_thickness_mm"] = given.pipe.wall_thickness_mm
    pipe["start_mm"], pipe["end_mm"] = float(np.floor(min(lows))), float(np.ceil(max(highs)))
    if isinstance(ovality, Estimate):
        pipe["ovality_pct"] = _rounded(ovality.value) if ovality.low > 0 else 0.0
        pipe.yaml_add_eol_comment(told(ovality), "ovality_pct")
    widest = known.get("widest_deg")
    if isinstance(widest, Estimate):
        pipe["ovality_clock_deg"] = _rounded(widest.value % 360)
        pipe.yaml_add_eol_comment(told(widest), "ovality_clock_deg")
    slope = known.get("inclination_deg")
    if isinstance(slope, Estimate):
        pipe["inclination_deg"] = _rounded(slope.value) if slope.low * slope.high > 0 else 0.0
        pipe.yaml_add_eol_comment(told(slope), "inclination_deg")
    if features:
        pipe["features"] = CommentedSeq(features)
        pipe.yaml_set_comment_before_after_key("features", before="as measured, each as a pocket of its size", indent=2)
    return pipe


def _pocket(defect: Defect, wall_mm: float) -> CommentedMap:
    length, width = (_rounded(max(side, LEAST_SIDE_MM), 5) for side in (defect.length_mm, defect.width_mm))
    shorter = min(length, width)
    pocket = CommentedMap(
        kind="pocket",
        distance_mm=_rounded(defect.distance_mm, 6),
        clock_deg=_rounded(float(np.degrees(defect.theta_rad)) % 360, 5),
        length_mm=length,
        width_mm=width,
        depth_mm=_rounded(min(defect.depth_mm, wall_mm), 4),
        edge_width_mm=min(EDGE_MM, shorter),
        corner_radius_mm=min(CORNER_MM, shorter / 2),
    )
    pocket.fa.set_flow_style()
    return pocket


def _robot(given: Given) -> CommentedMap | str | None:
    """The robot with the rig's wheels: one of ours, or the 6 inch one with other wheels."""
    diameters = given.rig.wheels.diameters_mm
    if not 3 <= len(diameters) <= 6:
        raise BadInput(
            [f"rig: wheels.diameters_mm: got {len(diameters)} values; a robot of ours has 3 to 6 encoder wheels"]
        )
    radius = float(np.mean(diameters)) / 2
    for name, robot in SIZES.items():
        if abs(robot.wheel_radius_mm / radius - 1) < WHEEL_TOLERANCE and robot.leg_count == len(diameters):
            return None if robot == Robot() else name
    out = CommentedMap(leg_count=len(diameters), wheel_radius_mm=_rounded(radius, 6))
    out["wheel_spacing_mm"] = max(2.2 * _rounded(radius, 6), Robot().wheel_spacing_mm)
    out["bore_radius_mm"] = max(
        given.pipe.inner_radius_mm, radius + Robot().leg_travel_mm + Robot().chassis_radius_mm + 1
    )
    return out


def _rig(rig: Rig) -> Any:
    """Its name, where it is one of ours."""
    for name in rigs():
        if preset_rig(name) == rig:
            return name
    return rig.model_dump(mode="json")


def _base_optics(given: Given) -> dict[str, Any]:
    """What the look given has beyond the default."""
    default = Optics()
    held = {name: getattr(given.optics, name) for name in Optics.model_fields}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in held.items()
        if value != getattr(default, name) and given.fidelity != "points"
    }


def drive_of(way: Way, bands: list[Band]) -> dict[str, Any]:
    """A drive that goes the same way again, with each wheel's slip and the shaking that was seen beyond chance."""
    degrees = np.column_stack([way.rows[:, :4], np.degrees(way.rows[:, 4:])])
    rows = [[_rounded(v, 7) for v in row] for row in degrees.round(5).tolist()]
    rows[0][0] = 0.0
    drive: dict[str, Any] = {"kind": "recorded", "rows": rows}
    slip = (way.slip_mm - way.slip_mm[0]).round(3)
    if np.abs(slip).max() > 0:
        drive["slip_mm"] = slip.tolist()
    shaking = [band for band in map(_band, bands) if band]
    if shaking:
        drive["vibration"] = shaking
    return drive


def _band(band: Band) -> dict[str, Any] | None:
    """What of a band is beyond chance; nothing where nothing is."""
    force, rate = (
        [one.value if one.low > SURE_SHARE * one.value else 0.0 for one in values]
        for values in (band.force_m_s2, band.rate_rad_s)
    )
    if not any(force) and not any(rate):
        return None
    return {
        "from_hz": band.from_hz,
        "to_hz": round(band.to_hz, 6),
        "acceleration_m_s2": [_rounded(v) for v in force],
        "rate_deg_s": [_rounded(float(np.degrees(v))) for v in rate],
    }


def _commented_drive(drive: dict[str, Any], found: Identified) -> CommentedMap:
    out = CommentedMap()
    for key, value in drive.items():
        if key in ("rows", "slip_mm", "vibration", "stages"):
            held = CommentedSeq([_flow(row) for row in value])
            out[key] = held
        else:
            out[key] = _flow(value) if isinstance(value, list) else value
    if "rows" in out:
        words = "time (s), z, x, y (mm), roll, tilt about x, tilt about y (degrees)"
        travel = found.quantities.get("travel_mm")
        words += f"; travel {told(travel)}" if isinstance(travel, Estimate) else ""
        out.yaml_set_comment_before_after_key("rows", before=words, indent=2)
    if "slip_mm" in out:
        out.yaml_set_comment_before_after_key(
            "slip_mm", before="of each wheel's rim beyond the robot, so far", indent=2
        )
    if "vibration" in out:
        words = "RMS in motion beyond the white noise, camera axes x, y, z; bands that are not sure are left out"
        out.yaml_set_comment_before_after_key("vibration", before=words, indent=2)
    return out


def _flow(value: Any) -> Any:
    if isinstance(value, dict):
        out: Any = CommentedMap(value)
    else:
        out = CommentedSeq(value)
    out.fa.set_flow_style()
    return out


def _rounded(value: float, figures: int = 4) -> float:
    """To so many figures, as a plain number."""
    return float(f"{value:.{figures}g}")
