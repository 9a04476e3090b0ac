"""What the report says in plain sentences: the verdict, what was scanned, what was not seen, what is an oracle."""

from __future__ import annotations

from collections import Counter
from importlib.metadata import version
from math import radians, sin

import numpy as np

from algorithms.large_arrays import lines
from algorithms.localisation.upright import VERTICAL_COSINE
from algorithms.types import seen_share
from scenarios.report.numbers import figure, score_figure, signed
from scenarios.report.wall_figures import stretches
from scenarios.run import Run, Scan
from sensor_model.geometry import clock_position
from sensor_model.rig import Rig
from sensor_model.sense import without_effect
from twin.pipe import Pipe

PAPER = (
    "IMU-assisted robotic structured light sensing with featureless registration under uncertainties for pipeline "
    "inspection"
)
MOST_REASONS = 5
LONGEST_LIST = 9
NEVER_SEEN_SHARE = 0.02  # a clock position seen along less of the scan than this counts as never seen


def verdict(run: Run) -> str:
    """The outcome in one line."""
    score = run.score
    calls = _calls(score.false_calls)
    if run.truth.pipe.scanned is not None and score.defects_true == 0:
        return f"The bore is a scan: {_count(len(run.found.defects), 'defect')} measured, none listed to judge by."
    if score.defects_true == 0:
        return f"The pipe has no defect; {calls}."
    found = f"{score.defects_found} of {_count(score.defects_true, 'defect')} found, {calls}."
    if score.defects_found == 0:
        return found
    worst = [
        f"{word} {score_figure(f'{word}_error_mm_max', getattr(score, f'{word}_error_mm_max'), 2)}"
        for word in ("length", "width", "depth")
    ]
    return f"{found} Worst errors: {', '.join(worst)}."


def _calls(number: int | None) -> str:
    if number is None:
        return "calls are not judged, for nobody listed what the scanned bore shows"
    return "no false call" if number == 0 else _count(number, "false call")


def _count(number: int, word: str) -> str:
    return f"{number} {word}" + ("" if number == 1 else "s")


def scanned(run: Run) -> list[tuple[str, str]]:
    """What was scanned, by what, and how: label and value."""
    scenario, pipe, rig = run.scenario, run.truth.pipe, run.recording.rig
    standard = pipe.standard
    trade = f"{standard.material} {standard.nominal_size_in} inch {standard.series}, " if standard else ""
    slope = "level" if pipe.inclination_deg == 0 else f"inclined {pipe.inclination_deg:g}° downhill"
    oval = f", {pipe.ovality_pct:g} % oval" if pipe.ovality_pct else ""
    z = run.truth.position_mm[:, 2]
    slits = " ".join(f"{slit.name} {slit.half_angle_deg:g}°" for slit in rig.projector.slits)
    sensing = scenario.sensing
    return [
        (
            "Pipe",
            f"{trade}bore radius {pipe.bore_radius_mm:g} mm, wall {pipe.wall_mm:g} mm, from {pipe.start_mm:g} to "
            f"{pipe.end_mm:g} mm, {slope}{oval}{_bends(pipe)}",
        ),
        (
            "Drive",
            f"{scenario.drive.kind}, camera from {z[0]:.0f} to {z[-1]:.0f} mm at {scenario.drive.speed_mm_s:g} mm/s",
        ),
        (
            "Sensor",
            f"{rig.camera.width_px} x {rig.camera.height_px} px fisheye, {len(rig.projector.slits)} slits between "
            f"{len(rig.projector.band_colors)} colour bands (half angles {slits}), {len(run.recording)} frames at "
            f"{sensing.frame_rate_hz:g} frames/s",
        ),
        ("Radius found", radius_found(run)),
        ("Fidelity", FIDELITY.get(sensing.fidelity, sensing.fidelity)),
        ("Calibration", _calibration(run)),
        ("Clock positions", _datum(run)),
        ("Seed and version", f"seed {scenario.seed}, pipetwin {version('pipetwin')}"),
        ("Follows", f"“{PAPER}”"),
    ]


def _bends(pipe: Pipe) -> str:
    each = [f"{b.towards} from {b.from_mm:g} to {b.to_mm:g} mm at {b.radius_od:g} outer diameters" for b in pipe.bends]
    return f"; bends {', '.join(each)}, and is drawn straight, as the measurement takes it to be" if each else ""


FIDELITY = {
    "picture": "picture: every frame drawn by the renderer, then decoded",
    "raycast": "raycast: every frame drawn by the ray-caster, then decoded",
    "points": "points: slit pixels straight from the wall radius with stated noise and drop-outs; no pictures",
}


def _calibration(run: Run) -> str:
    scenario = run.scenario
    if scenario.calibration is not None:
        return _calibrated(scenario.true_rig or scenario.rig, run.recording.rig, scenario.calibration.boards)
    if scenario.true_rig is None or scenario.true_rig == scenario.rig:
        return "the rig is as the measurement believes (no calibration error)"
    true, nominal = flat(scenario.true_rig.model_dump()), flat(scenario.rig.model_dump())
    parts = [
        f"{key} is {_brief(true[key])}, believed {_brief(nominal.get(key))}"
        for key in true
        if true[key] != nominal.get(key)
    ]
    return "the true rig differs from what the measurement believes: " + "; ".join(parts)


def _brief(value: object) -> str:
    """A value, or how many there are of it."""
    long = isinstance(value, list | tuple) and len(value) > LONGEST_LIST
    return f"a list of {len(value)}" if long else str(value)  # type: ignore[arg-type]


def _calibrated(true: Rig, nominal: Rig, boards: int) -> str:
    """What the calibration before the scan got wrong."""
    apex_mm = np.linalg.norm(np.subtract(true.projector.apex_mm, nominal.projector.apex_mm))
    axis, believed = (rig.projector.T_camera_projector[:3, 2] for rig in (true, nominal))
    axis_deg = np.degrees(np.linalg.norm(np.cross(axis, believed)))
    off_deg = np.degrees(np.abs(true.projector.slit_half_angles_rad - nominal.projector.slit_half_angles_rad).max())
    return (
        f"the projector was calibrated on {boards} boards in closed loop: apex off by {apex_mm:.3f} mm, axis by "
        f"{axis_deg:.4f}°, half angles by up to {off_deg:.4f}°; the camera is taken as known"
    )


def _datum(run: Run) -> str:
    looking = "h:mm, seen looking downstream from the launch point (increasing distance)"
    if abs(sin(radians(run.truth.pipe.inclination_deg))) > VERTICAL_COSINE:
        return f"{looking}; the pipe is (nearly) vertical: 12:00 is the camera's own upright at launch"
    return f"{looking}; 12:00 is up"


def flat(settings: object, prefix: str = "") -> dict[str, object]:
    """Nested settings as dotted names."""
    if isinstance(settings, dict):
        pairs = [(str(key), value) for key, value in settings.items()]
    elif isinstance(settings, list | tuple) and any(isinstance(part, dict) for part in settings):
        pairs = [(str(key), value) for key, value in enumerate(settings)]
    else:
        return {prefix: settings}
    return {
        name: leaf for key, value in pairs for name, leaf in flat(value, f"{prefix}.{key}" if prefix else key).items()
    }


def radius_found(run: Scan) -> str:
    """The radius that the frames show beside the one the measurement was told: a wrong one is not to go unnoticed."""
    path, told = run.found.trajectory, run.recording.pipe.inner_radius_mm
    seen = path.radius_mm[path.registered & np.isfinite(path.radius_mm)]
    if not seen.size:
        return f"none; told {told:g} mm"
    middle = float(np.median(seen))
    return f"{middle:.2f} mm in the median frame, {100 * (middle / told - 1):+.2f} % off the {told:g} mm it was told"


def not_seen(run: Scan) -> list[str]:
    """What the scan did not show, and why."""
    wall, projector = run.found.wall, run.recording.rig.projector
    columns = wall.scanned()
    z = wall.z_mm[columns]
    said = []
    share = seen_share(wall)
    if share is not None:
        said.append(
            f"{100 * (1 - share):.1f} % of the wall scanned between {z[0]:.0f} and {z[-1]:.0f} mm held no "
            "point. It is drawn hatched grey, never filled in, and counts in no figure. The pipe outside these ends "
            "was not scanned."
        )
    strut = clock_position(radians(projector.strut_clock_deg))
    hidden = never_seen(run)
    where = (
        f"over the whole scan, nothing was seen at {_listed(hidden)}"
        if hidden
        else "no clock position was hidden all the way (the sensor turned)"
    )
    said.append(
        f"Strut: it hides {projector.strut_width_deg:g}° of the circumference, at {strut} of the sensor; {where}. A "
        "defect there would not be found."
    )
    hidden_floor = run.score.not_seen_share if isinstance(run, Run) else None
    floor = "" if hidden_floor is None else f" No ring showed {100 * hidden_floor:.1f} % of the true defects' floor."
    innermost, outermost = np.tan(projector.slit_half_angles_rad[[0, -1]])
    said.append(
        f"Shadow under steep edges: light comes from behind and reaches only {innermost:.2f} (innermost slit) to "
        f"{outermost:.2f} (outermost) of the distance past a rim in depth, so the first stretch of a steep floor stays "
        f"dark.{floor}"
    )
    path = run.found.trajectory
    lost = Counter(
        reason or "no reason given" for reason, ok in zip(path.reason, path.registered, strict=True) if not ok
    )
    if lost:
        reasons = "; ".join(f"{count} x {reason}" for reason, count in sorted(lost.items()))
        said.append(
            f"{_count(sum(lost.values()), 'frame')} of {len(path.reason)} not registered, whose points are left out: "
            f"{reasons}."
        )
    weak = Counter(reason for reason, ok in zip(path.reason, path.registered, strict=True) if ok and reason)
    if weak:
        reasons = "; ".join(f"{count} x {reason}" for reason, count in weak.most_common(MOST_REASONS))
        said.append(f"{_count(sum(weak.values()), 'frame')} of {len(path.reason)} registered weakly: {reasons}.")
    if isinstance(run, Run) and (unseen := without_effect(run.scenario.sensing)):
        said.append(f"{unseen[0].upper()}{unseen[1:]}.")
    if isinstance(run, Run) and not run.truth.pipe.backed:
        said.append("The wall has no backing: a place that takes the whole wall returns no light and is not seen.")
    return said


def never_seen(run: Scan) -> list[tuple[str, str]]:
    """Ranges of clock positions that the scan never showed."""
    wall = run.found.wall
    count = wall.count[:, wall.scanned()]
    if count.shape[1] == 0:
        return []
    blind = np.array([np.mean(line > 0) < NEVER_SEEN_SHARE for (line,) in lines(count)])
    if blind.all():
        return [("12:00", "12:00")]
    first = int(np.flatnonzero(~blind)[0])  # start where the wall is seen, so that no range is cut in two
    cell = 2 * np.pi / blind.size
    return [
        (clock_position((a + first) * cell), clock_position((b + 1 + first) * cell))
        for a, b in stretches(np.roll(blind, -first))
    ]


def _listed(ranges: list[tuple[str, str]]) -> str:
    return ", ".join(f"{a} to {b}" for a, b in ranges)


def oracle(run: Run) -> str:
    """What the oracle figure is, and the gap between it and the blind one."""
    score = run.score
    said = (
        "Eq. 29 as the paper uses it chooses the threshold with the TRUE size in hand. That is an oracle: it cannot "
        "run in the field, where the size is what is sought. It stands here as a labelled reference; every size in "
        "this report is measured blind."
    )
    blind, known = score.eq29_err_pct_max, score.eq29_oracle_err_pct_max
    if blind is None or known is None:
        return f"{said} Without a found defect there is neither figure."
    gap = f"{said} Worst defect: blind {figure(blind)} %, oracle {figure(known)} %"
    gap += f" (gap {signed(blind - known, 2)} points)."
    if blind < known:
        gap += " Blind is better here: it sizes each defect at half its own depth."
    return gap
