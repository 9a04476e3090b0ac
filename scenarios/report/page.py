"""The run's page: one HTML file that opens offline, without a script or a second file."""

from __future__ import annotations

from html import escape
from pathlib import Path

from scenarios.extrapolated import extrapolated
from scenarios.report.alarm_table import alarms
from scenarios.report.canvas import Picture
from scenarios.report.comparison import Row, rows
from scenarios.report.numbers import score_figure
from scenarios.report.path_figures import errors_over_distance, true_path, yield_over_distance
from scenarios.report.photographs import sample_pictures
from scenarios.report.robot_picture import robot_in_pipe
from scenarios.report.shell import page_html
from scenarios.report.statements import not_seen, oracle, scanned, verdict
from scenarios.report.tables import defect_table, facts, score_tables, settings_table, slit_table
from scenarios.report.wall_figures import pipe_in_space, profiles, wall_map
from scenarios.run import Run

MOST_PROFILES = 8
TILES = {
    "length_error_mm_max": "worst length error",
    "width_error_mm_max": "worst width error",
    "depth_error_mm_max": "worst depth error",
    "center_rms_mm": "camera centre, RMS error",
    "roll_rms_deg": "roll, RMS error",
    "seen_share": "of the scanned wall seen",
}


def write_report(run: Run, file: Path) -> None:
    """Write the page of one run; the same run gives the same bytes."""
    every = rows(run)
    sections = {
        "defects": ("Defects, measured beside true", defect_table(run, every)),
        "map": ("Wall map", figure_html(wall_map(run, every))),
        "not-seen": ("What was not seen", _list(not_seen(run))),
        "profiles": ("Depth profiles", _profiles(run, every)),
        "space": ("The pipe in space", figure_html(pipe_in_space(run))),
        "score": ("Score", score_tables(run) + f'<p class="note"><b>Oracle.</b> {escape(oracle(run))}</p>'),
        "pose": ("Pose errors", figure_html(errors_over_distance(run))),
        "alarms": ("Slip alarms", alarms(run)),
        "path": ("The true path", _drive(run)),
        "frames": ("Frames and pictures", _frames(run)),
        "settings": ("Settings", _settings(run)),
    }
    body = "".join(
        f'<section id="{key}"><h2>{title}</h2>{inside}</section>\n' for key, (title, inside) in sections.items()
    )
    links = "".join(f'<a href="#{key}">{title}</a> ' for key, (title, _) in sections.items())
    file.write_text(_page(run, f"<nav aria-label='On this page'>{links}</nav>", body), encoding="utf-8")


def _page(run: Run, links: str, body: str) -> str:
    name, score = escape(run.scenario.name), run.score
    clean = score.defects_found == score.defects_true and score.false_calls == 0
    tiles = "".join(
        f"<li><b>{escape(score_figure(key, getattr(score, key), 2))}</b><span>{escape(words)}</span></li>"
        for key, words in TILES.items()
    )
    return page_html(
        f"{run.scenario.name}: pipe scan report",
        f"""<h1>Pipe scan report: {name}</h1>
<p class="lead">{escape(run.scenario.why)}</p>
<p class="verdict {"clean" if clean else "faulty"}">{escape(verdict(run))}</p>
{_beyond(run)}<ul class="tiles">{tiles}</ul>
{links}""",
        f"""<section id="scan"><h2>What was scanned</h2>{facts(scanned(run))}</section>
{body}""",
        """\
A simulated scan: the measurement never saw the truth it is compared with here. Lengths in millimetres, angles
in degrees, clock positions in h:mm.""",
    )


def _beyond(run: Run) -> str:
    """Where the scenario leaves what the testbench was held against."""
    reasons = "; ".join(extrapolated(run.scenario))
    return f'<p class="note"><b>Extrapolated.</b> {escape(reasons)}.</p>\n' if reasons else ""


def _drive(run: Run) -> str:
    """What really happened: the robot in the pipe, where a robot drove, and its path."""
    shown = figure_html(robot_in_pipe(run)) if run.scenario.drive.kind == "robot" else ""
    return shown + figure_html(true_path(run))


def figure_html(picture: Picture, scrolls: bool = True) -> str:
    """A picture with its caption."""
    size = f'width="{picture.width_px}" height="{picture.height_px}"'
    image = f'<img src="{picture.source}" {size} alt="{escape(picture.alt)}">'
    inside = f'<div class="scroll" tabindex="0">{image}</div>' if scrolls else image
    return f"<figure>{inside}<figcaption>{escape(picture.caption)}</figcaption></figure>"


def _list(lines: list[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def _profiles(run: Run, every: list[Row]) -> str:
    if not every:
        return "<p>No defect to show.</p>"
    shown = "".join(figure_html(profiles(run, row)) for row in every[:MOST_PROFILES])
    rest = len(every) - MOST_PROFILES
    return shown + (f"<p>{rest} further defects are in the table only.</p>" if rest > 0 else "")


def _frames(run: Run) -> str:
    pictures = [picture for sample in run.samples for picture in sample_pictures(run, sample)]
    shown = "".join(figure_html(picture, scrolls=False) for picture in pictures)
    words = (
        "<p>Decoded slit centres laid over the camera's pictures; neighbouring slits have unlike colours.</p>"
        f'<div class="photographs">{shown}</div>'
        if shown
        else "<p>No pictures to show: at this fidelity slit pixels come straight from the wall, without a picture.</p>"
    )
    return words + figure_html(yield_over_distance(run)) + slit_table(run)


def _settings(run: Run) -> str:
    return f"<details><summary>Every setting of this scenario</summary>{settings_table(run)}</details>"
