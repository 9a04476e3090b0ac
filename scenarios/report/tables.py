"""The report's tables as HTML; every string is escaped here."""

from __future__ import annotations

from html import escape
from math import isfinite, radians

from algorithms.sizing.depth import visible_depth_mm
from algorithms.sizing.disposition import at_least
from algorithms.trust.feature_class import CLASSES
from algorithms.types import Defect
from scenarios.report.comparison import Quantity, Row, quantities
from scenarios.report.numbers import NONE, fixed, score_figure, signed
from scenarios.report.statements import flat
from scenarios.run import Run
from scenarios.score import MEANINGS
from sensor_model.geometry import clock_position
from sensor_model.rig import Rig

LONGEST_SETTING = 200
GROUPS = {
    "Defects found and sized (blind)": (
        "defects_true defects_found false_calls length_error_mm_max width_error_mm_max depth_error_mm_max "
        "depth_bias_mm floors_not_seen at_least_wrong not_seen_share clock_spread_deg"
    ),
    "The paper's figures of size": "eq29_err_pct_max eq29_oracle_err_pct_max eq30_error_pct_max eq32_quality_pct",
    "Pose against the truth": "center_rms_mm tilt_rms_deg roll_rms_deg roll_max_deg distance_error_pct",
    "The paper's figures of registration": (
        "radius_closeness_pct radius_closeness_wall_pct normal_variance center_variance_mm2 center_variance_wall_mm2"
    ),
    "Frames and wall map": "frames frames_registered decode_yield wrong_words map_rms_mm seen_share",
}
NOTES = {
    "The paper's figures of size": "Eq. 30 divides the norm of three relative errors by three, so it flatters; "
    "the errors in mm are the plain ones.",
    "The paper's figures of registration": "With rings on cones these cannot rank methods by themselves: a defect "
    "pulls the fitted circle and plane even at the true pose. Read them beside the errors against the truth.",
}
UNITS = {"distance": "mm", "clock": "h:mm", "length": "mm", "width": "mm", "depth": "mm", "wall loss": "%"}
DECIMALS = {"distance": 1, "length": 1, "width": 1, "depth": 2, "wall loss": 1}
INFORMATIVE = "informative in plastic"
WALL_LOSS = "Wall loss is of the nominal wall, whose tolerance its ± holds; only loss from inside is seen."
NO_CLOCK_SPREAD = "fewer than two found defects share a clock position"


def defect_table(run: Run, rows: list[Row]) -> str:
    """Every defect measured beside true; misses and false calls are rows of their own."""
    if not rows:
        return "<p>No defect in the pipe, and none called.</p>"
    heads = [f"{name} ({unit})" for name, unit in UNITS.items()]
    head = "".join(f'<th scope="col">{escape(text.capitalize())}</th>' for text in ["defect", "", *heads, "remarks"])
    return (
        '<div class="scroll" tabindex="0"><table class="defects"><caption>± is one standard deviation as the '
        f"measurement states it; error is measured less true. {WALL_LOSS}</caption>"
        f"<thead><tr>{head}</tr></thead>{''.join(_defect(run, row) for row in rows)}</table></div>"
    )


def _defect(run: Run, row: Row) -> str:
    every = quantities(row, run)
    lines = []
    if row.defect is not None:
        lines.append(("measured", [_measured(q) for q in every]))
    if row.feature is not None:
        lines.append(("true", [_true(q) for q in every]))
    if row.defect is not None and row.feature is not None:
        lines.append(("error", [_error(q) for q in every]))
    kind = str(row.feature.model_dump()["kind"]) if row.feature is not None else ""
    label = (
        f'<th scope="rowgroup" rowspan="{len(lines)}"><span class="number">{row.number}</span> {escape(kind)}'
        f'<br><span class="tag {row.kind.replace(" ", "-")}">{escape(row.kind)}</span></th>'
    )
    remark = f'<td class="remark" rowspan="{len(lines)}">{escape("; ".join(_remarks(run, row)))}</td>'
    body = ""
    for k, (name, cells) in enumerate(lines):
        columns = "".join(f"<td>{cell}</td>" for cell in cells)
        first, last = (label, remark) if k == 0 else ("", "")
        body += f'<tr class="{name}">{first}<th scope="row">{name}</th>{columns}{last}</tr>'
    return f'<tbody class="{row.kind.replace(" ", "-")}">{body}</tbody>'


def _measured(q: Quantity) -> str:
    if q.name == "clock":
        return f'{_clock(q.measured)} <span class="std">± {fixed(q.std, 1)}°</span>'
    return f'{fixed(q.measured, DECIMALS[q.name])} <span class="std">± {fixed(q.std, DECIMALS[q.name])}</span>'


def _true(q: Quantity) -> str:
    return _clock(q.true) if q.name == "clock" else fixed(q.true, DECIMALS[q.name])


def _error(q: Quantity) -> str:
    return f"{signed(q.error, 1)}°" if q.name == "clock" else signed(q.error, DECIMALS[q.name])


def _clock(degrees: float) -> str:
    return clock_position(radians(degrees)) if isfinite(degrees) else NONE


def _remarks(run: Run, row: Row) -> list[str]:
    said = []
    if row.kind == "missed":
        said.append("not found by the measurement")
    if row.kind == "false call":
        said.append("no true defect here")
    if row.kind == "part of the pipe":
        said.append("a joint, debris or taper of the true pipe; no defect")
    if row.defect is not None:
        said += remarks(row.defect, run.recording.rig)
    pipe = run.truth.pipe
    feature = row.feature
    if feature and not feature.inward and feature.size(pipe.bore_radius_mm).depth_mm >= pipe.wall_mm - 1e-6:
        said.append(
            "takes the whole wall; " + ("shows its backing" if pipe.backed else "unbacked, a hole returns no light")
        )
    return said


def remarks(d: Defect, rig: Rig) -> list[str]:
    """What a measured defect's figures leave unsaid."""
    said = []
    if d.unseen_share > 0:
        said.append(f"{100 * d.unseen_share:.0f} % of its box not seen")
    if not d.floor_seen:
        least = at_least(d.depth_mm, d.depth_std_mm)
        limit = visible_depth_mm(d.length_mm, float(rig.projector.slit_half_angles_rad[-1]))
        said.append(f"depth at least {fixed(least, DECIMALS['depth'])} mm, its floor was not seen")
        said.append(f"under a steep edge light reaches {fixed(limit, 1)} mm deep over such a length")
    if d.cut_by_scan_end:
        said.append("cut by the end of the scan, its length is a lower bound")
    if not all(map(isfinite, (d.length_mm, d.width_mm, d.depth_mm))):
        said.append("n/a: an edge was not seen")
    return said + [text for text in (d.disposition, _class_words(d)) if text]


def _class_words(defect: Defect) -> str:
    """The class, with what it is worth; what stands inward has a height for its depth."""
    if defect.inward:
        return f"{defect.feature_class}: stands in by its depth, and takes no wall"
    if defect.feature_class in CLASSES:
        return f"{defect.feature_class} (POF class, {INFORMATIVE})"
    return defect.feature_class


def score_tables(run: Run) -> str:
    """The score, grouped, each figure with its meaning."""
    grouped = {title: names.split() for title, names in GROUPS.items()}
    known = {name for names in grouped.values() for name in names}
    if rest := [name for name in MEANINGS if name not in known]:
        grouped["Further figures"] = rest
    parts = []
    for title, names in grouped.items():
        lines = "".join(_score_row(run, name) for name in names)
        note = f'<p class="note">{escape(NOTES[title])}</p>' if title in NOTES else ""
        table = f'<table class="score"><tbody>{lines}</tbody></table>'
        parts.append(f'<div class="group"><h3>{escape(title)}</h3>{table}{note}</div>')
    return f'<div class="groups">{"".join(parts)}</div>'


def _score_row(run: Run, name: str) -> str:
    value = getattr(run.score, name)
    text = score_figure(name, value)
    why = f' <span class="std">({escape(_why(run, name))})</span>' if text == NONE else ""
    badge = ' <span class="tag oracle">oracle</span>' if "oracle" in name else ""
    return (
        f'<tr><th scope="row">{escape(MEANINGS.get(name, name))}{badge}<br><code>{escape(name)}</code></th>'
        f"<td>{escape(text)}{why}</td></tr>"
    )


def _why(run: Run, name: str) -> str:
    """Why a figure has no value."""
    if run.score.defects_true == 0:
        return "no defect in the pipe"
    if name == "clock_spread_deg":
        return NO_CLOCK_SPREAD
    if run.score.defects_found == 0:
        return "no defect found"
    return "not defined in this run"


def facts(pairs: list[tuple[str, str]]) -> str:
    """Labels and values."""
    return "<dl>" + "".join(f"<dt>{escape(label)}</dt><dd>{escape(value)}</dd>" for label, value in pairs) + "</dl>"


def slit_table(run: Run) -> str:
    """How much of each slit was decoded in the sample frames."""
    slits, possible = run.recording.rig.projector.slits, _azimuths(run)
    if not run.samples:
        return "<p>No sample frame was kept.</p>"
    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in ["Slit", "Half angle", *_frame_names(run)])
    body = ""
    for k, slit in enumerate(slits):
        cells = "".join(f"<td>{100 * int((s.seen.slit == k).sum()) / possible:.0f} %</td>" for s in run.samples)
        body += f'<tr><th scope="row">{escape(slit.name)}</th><td>{slit.half_angle_deg:g}°</td>{cells}</tr>'
    return (
        '<div class="scroll" tabindex="0"><table class="slits"><caption>Azimuths of each slit found in the sample '
        f"frames (of {possible}), innermost slit first.</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _azimuths(run: Run) -> int:
    """How many azimuths a frame was looked at: by the decoder, or by what stood for it."""
    sensing = run.scenario.sensing
    return sensing.points.azimuths if sensing.fidelity == "points" else run.scenario.method.decode.azimuths


def _frame_names(run: Run) -> list[str]:
    return [f"frame {sample.index}, {sample.z_mm:.0f} mm" for sample in run.samples]


def settings_table(run: Run) -> str:
    """Every setting of the scenario by the name under which it can be set."""
    lines = "".join(
        f'<tr><th scope="row"><code>{escape(name)}</code></th><td>{escape(_setting(value))}</td></tr>'
        for name, value in flat(run.scenario.model_dump(mode="json")).items()
    )
    return f'<table class="settings"><tbody>{lines}</tbody></table>'


def _setting(value: object) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_setting, value)) + "]"
    text = "none" if value is None else str(value)
    return text if len(text) <= LONGEST_SETTING else f"{text[:40]}... ({len(text)} characters)"
