"""The page of a replayed log: its health first, then what was measured; no truth, no score."""

from __future__ import annotations

from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np

from scenarios.field.finding import Finding
from scenarios.field.health_figures import light_over_time, wheels_over_time
from scenarios.field.replay import Replay
from scenarios.report.comparison import Row, pose_std
from scenarios.report.numbers import fixed
from scenarios.report.page import figure_html
from scenarios.report.path_figures import yield_over_distance
from scenarios.report.photographs import sample_pictures
from scenarios.report.shell import page_html
from scenarios.report.statements import not_seen, radius_found
from scenarios.report.tables import WALL_LOSS, facts, remarks
from scenarios.report.wall_figures import pipe_in_space, wall_map
from scenarios.run import Scan
from sensor_model.geometry import clock_position

VERDICTS = {
    "good": "The log is sound: nothing was found that the result would suffer from.",
    "weak": "The log has weaknesses: the result stands, with the reservations below.",
    "bad": "The log has faults that the result must not be trusted across; they stand first below.",
}
TONE = {"good": "clean", "weak": "weak", "bad": "faulty"}
HEADS = (
    "Defect",
    "Distance (mm)",
    "Clock (h:mm)",
    "Length (mm)",
    "Width (mm)",
    "Depth (mm)",
    "Wall loss (%)",
    "Remarks",
)


def write_page(replay: Replay, name: str, file: Path) -> None:
    """Write the page of one replay; the same log gives the same bytes."""
    sections = {"health": ("Health of the log", _health(replay))}
    if replay.found is not None:
        scan = Scan(replay.recording, replay.found, replay.samples)
        rows = [Row(k, "measured", None, defect) for k, defect in enumerate(replay.found.defects, start=1)]
        sections |= {
            "defects": ("Defects as measured", _defects(scan)),
            "map": ("Wall map", figure_html(wall_map(scan, rows))),
            "not-seen": (
                "What was not seen",
                "<ul>" + "".join(f"<li>{escape(t)}</li>" for t in not_seen(scan)) + "</ul>",
            ),
            "space": ("The pipe in space", figure_html(pipe_in_space(scan))),
            "frames": ("Frames and pictures", _frames(scan)),
        }
    body = "".join(
        f'<section id="{key}"><h2>{title}</h2>{inside}</section>\n' for key, (title, inside) in sections.items()
    )
    links = "".join(f'<a href="#{key}">{title}</a> ' for key, (title, _) in sections.items())
    verdict = f'<p class="verdict {TONE[replay.health.verdict]}">{escape(VERDICTS[replay.health.verdict])}</p>'
    outcome = f"No reconstruction: {replay.why}." if replay.found is None else _outcome(replay)
    head = f"""<h1>Replay of {escape(name)}</h1>
<p class="lead">{escape(outcome)}</p>
{verdict}
<nav aria-label='On this page'>{links}</nav>"""
    footer = "A log measured without any knowledge of the truth. Lengths in millimetres, clock positions in h:mm."
    scanned = f'<section id="scan"><h2>What was read</h2>{facts(_facts(replay))}</section>\n'
    file.write_text(page_html(f"{name}: replay", head, body + scanned, footer), encoding="utf-8")


def _outcome(replay: Replay) -> str:
    assert replay.found is not None  # noqa: S101  asked for only then
    count = len(replay.found.defects)
    return f"{count} defect{'' if count == 1 else 's'} measured. There is no truth to hold it against, and so no score."


def _health(replay: Replay) -> str:
    rows = "".join(_row(one) for one in replay.health.findings)
    head = "".join(f'<th scope="col">{title}</th>' for title in ("Verdict", "What", "Seen", "What it means"))
    table = (
        '<div class="scroll" tabindex="0"><table class="health"><caption>The worst first.</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    )
    return table + figure_html(light_over_time(replay)) + figure_html(wheels_over_time(replay.recording))


def _row(one: Finding) -> str:
    return (
        f'<tr><td><span class="tag {one.verdict}">{one.verdict}</span></td>'
        f'<th scope="row">{escape(one.part)}: {escape(one.name)}</th><td>{escape(one.says)}</td>'
        f'<td class="remark">{escape(one.means)}</td></tr>'
    )


def _defects(scan: Scan) -> str:
    if not scan.found.defects:
        return "<p>No defect was measured.</p>"
    lines = ""
    for number, d in enumerate(scan.found.defects, start=1):
        z_std, _ = pose_std(scan.found.trajectory, d.distance_mm)
        cells = [
            _with_std(d.distance_mm, float(np.hypot(d.length_std_mm / 2, z_std)), 1),
            escape(clock_position(d.theta_rad)),
            _with_std(d.length_mm, d.length_std_mm, 1),
            _with_std(d.width_mm, d.width_std_mm, 1),
            _with_std(d.depth_mm, d.depth_std_mm, 2),
            _with_std(d.wall_loss_pct, d.wall_loss_std_pct, 1),
        ]
        inside = "".join(f"<td>{cell}</td>" for cell in cells)
        said = escape("; ".join(remarks(d, scan.recording.rig)))
        lines += f'<tr><th scope="row">{number}</th>{inside}<td class="remark">{said}</td></tr>'
    head = "".join(f'<th scope="col">{title}</th>' for title in HEADS)
    return (
        '<div class="scroll" tabindex="0"><table class="defects"><caption>± is one standard deviation as the '
        f"measurement states it. {WALL_LOSS}</caption><thead><tr>{head}</tr></thead>"
        f"<tbody>{lines}</tbody></table></div>"
    )


def _with_std(value: float, std: float, decimals: int) -> str:
    return f'{fixed(value, decimals)} <span class="std">± {fixed(std, decimals)}</span>'


def _frames(scan: Scan) -> str:
    pictures = [picture for sample in scan.samples for picture in sample_pictures(scan, sample)]
    shown = "".join(figure_html(picture, scrolls=False) for picture in pictures)
    words = f'<div class="photographs">{shown}</div>' if shown else "<p>The log holds slit pixels, and no pictures.</p>"
    return words + figure_html(yield_over_distance(scan))


def _facts(replay: Replay) -> list[tuple[str, str]]:
    recording, rig = replay.recording, replay.recording.rig
    seconds = (recording.frame_stamps_ns[-1] - recording.frame_stamps_ns[0]) / 1e9
    slits = " ".join(f"{slit.name} {slit.half_angle_deg:g}°" for slit in rig.projector.slits)
    told = recording.pipe
    pairs = [
        ("Log", f"{len(recording)} frames in {seconds:.1f} s"),
        ("Rig", f"{rig.camera.width_px} x {rig.camera.height_px} px fisheye, slits {slits}"),
        ("Pipe as told", f"bore radius {told.inner_radius_mm:g} mm, wall {told.wall_thickness_mm:g} mm"),
    ]
    if replay.found is not None:
        z = replay.found.trajectory.T_pipe_camera[:, 2, 3]
        pairs += [
            ("Drive", f"camera from {z.min():.0f} to {z.max():.0f} mm"),
            ("Radius found", radius_found(Scan(recording, replay.found, ()))),
        ]
    return [*pairs, ("Version", f"pipetwin {version('pipetwin')}")]
