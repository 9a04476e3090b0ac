"""The twin page: one file that opens offline: the wall unrolled and in space, defects to click, path and pictures."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path

import numpy as np

from scenarios.field.export_tally import intervals, remarks
from scenarios.field.twin_data import Shots, camera_shots, page_data, sized
from scenarios.found_run import FoundRun, read_found, recording_of
from scenarios.report.shell import page_html
from scenarios.report.tables import WALL_LOSS
from scenarios.run_folder import whole_file
from scenarios.view.page import SCENE
from sensor_model.geometry import clock_position

SCRIPT = Path(__file__).parent / "twin.js"
HEADS = ("Defect", "Place mm", "Clock", "Length mm", "Width mm", "Depth mm", "Loss %", "Disposition", "Remark")
STYLE = "width:100%;touch-action:pan-y;outline-offset:2px"


def write_twin_page(run_folder: Path, file: Path) -> None:
    """Write the page of a run's folder; truth, score and pictures may be missing. The same run gives the same bytes.

    Raises:
        BadInput: when the run cannot be read, or the file cannot be written.
    """
    run = read_found(run_folder)
    log = recording_of(run_folder)
    shots = camera_shots(run, log)
    data = json.dumps(page_data(run, shots, log), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    name = run_folder.resolve().name
    head = f"<h1>{escape(name)}</h1><p class='lead'>{escape(lead(run))}</p>"
    body = (
        f"{_controls(run)}{_wall(run)}{_shot(shots)}{_space()}{_path(log is not None)}"
        f'<script type="application/json" id="twin">{data}</script>'
    )
    script = "".join(part.read_text(encoding="utf-8") for part in (SCENE, SCRIPT))
    footer = (
        "Made by pipetwin twin-page from the measurement alone. Lengths in mm, angles in degrees, clock positions h:mm."
    )
    with whole_file(file) as work:
        work.write_text(page_html(f"{name}: the pipe as found", head, body, footer, script=script), encoding="utf-8")


def lead(run: FoundRun) -> str:
    """What was scanned, in one sentence."""
    scanned = run.wall.scanned()
    z, count = run.wall.z_mm[scanned], len(run.defects)
    defects = f"{count} defect{'' if count == 1 else 's'}"
    if not z.size:
        return f"{defects}; no stretch of the wall was seen over half of its circumference."
    seen = float(np.isfinite(run.deviation_mm[:, scanned]).mean())
    return (
        f"{defects} between {z[0]:.0f} and {z[-1]:.0f} mm, in a bore of {2 * run.bore_radius_mm:.2f} mm; "
        f"{100 * seen:.0f} % of that wall was seen. What was not seen is grey, never filled in."
    )


def _controls(run: FoundRun) -> str:
    z = run.wall.z_mm
    return (
        '<div style="position:sticky;top:0;z-index:1;background:#fff;padding:4px 0;border-bottom:1px solid #ddd">'
        '<label>Place <input id="place" type="range" '
        f'min="{z[0]:.0f}" max="{z[-1]:.0f}" value="{z[0]:.0f}" step="1" style="width:min(26rem,60vw)"></label> '
        '<output id="where"></output><br><button id="before">Previous defect</button> '
        '<button id="next">Next defect</button> <button id="nearer">Zoom in</button> '
        '<button id="further">Zoom out</button> <button id="whole">Whole pipe</button></div>'
        '<p id="selected" class="verdict" role="status">Choose a defect, on the wall or in the list.</p>'
    )


def _wall(run: FoundRun) -> str:
    head = "".join(f'<th scope="col">{text}</th>' for text in HEADS)
    rows = "".join(_row(run, k) for k in range(len(run.defects)))
    listed = (
        f'<p class="note" id="of-sizes">Intervals are 95 %. {WALL_LOSS.replace("±", "interval")}</p>'
        '<div class="scroll" tabindex="0"><table class="defects" aria-label="Defects" aria-describedby="of-sizes">'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
        if rows
        else "<p>No defect was found.</p>"
    )
    return (
        f'<section id="wall"><h2>The pipe unrolled</h2><canvas id="map" style="{STYLE};height:340px" role="img" '
        'tabindex="0" aria-label="The wall unrolled: distance across, clock position down, colour by depth">'
        '</canvas><p class="note">Click or tap a defect. Keys on the picture: left and right move along the pipe, n '
        f"and p go to the next and the previous defect, + and − zoom.</p>{listed}</section>"
    )


def _row(run: FoundRun, index: int) -> str:
    one = run.defects[index]
    sizes = "".join(f"<td>{escape(sized(size))}</td>" for *_, size in intervals(one))
    return (
        f'<tr><th scope="row"><button data-defect="{index}">{index + 1}</button></th><td>{one.distance_mm:.1f}</td>'
        f"<td>{clock_position(one.theta_rad)}</td>{sizes}<td>{escape(one.disposition)}</td>"
        f'<td class="remark">{escape("; ".join(remarks(one)))}</td></tr>'
    )


def _shot(shots: Shots) -> str:
    lost = f" {shots.unreadable} pictures could not be read." if shots.unreadable else ""
    inside = (
        '<figure><img id="shot" alt="" style="max-width:520px"><figcaption id="shown"></figcaption></figure>'
        f'<p class="note">The picture whose rings lie on this place of the wall.{lost}</p>'
        if shots.jpeg
        else f"<p>This run's folder holds no camera pictures.{lost}</p>"
    )
    return f"<section><h2>The camera's picture</h2>{inside}</section>"


def _space() -> str:
    return (
        f'<section><h2>The wall in space</h2><canvas id="scene" style="{STYLE};height:460px" role="img" tabindex="0" '
        'aria-label="The wall in perspective, coloured by depth, with the camera\'s path"></canvas>'
        '<p class="note">Drag or arrow keys to turn, wheel or + and − to zoom. The near half is left away, so that you '
        "look into the pipe; the line is the camera's path, the dot where it saw this place.</p></section>"
    )


def _path(with_log: bool) -> str:
    slip = (
        "Slip: how much further each encoder's rim went than the camera, since the start; bands are stretches where "
        "the measurement found a wheel slipping."
        if with_log
        else "This run's folder holds no log, so that slip is shown as the stretches alone where a wheel was found "
        "slipping."
    )
    return (
        '<section><h2>Path, roll and slip over distance</h2><canvas id="series" style="width:100%;height:690px" '
        'role="img" aria-label="Camera off the axis, roll, tilt and slip over distance"></canvas>'
        f'<p class="note">{slip}</p></section>'
    )
