"""The page that plays a drive: the robot in the pipe, its light and its cloud, and slip and roll over time."""

from __future__ import annotations

import json
from base64 import b64encode
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.report.canvas import SERIES
from scenarios.report.shell import page_html
from scenarios.view.drive import Playback
from sensor_model.geometry import wall_direction
from twin.pipe import Pipe

SCENE, PLAYER = (Path(__file__).parent / name for name in ("scene.js", "player.js"))
SHADES = 16
OUTLINE_POINTS = 24


def write_view(drive: Playback, file: Path) -> None:
    """Write the page; the same run gives the same bytes."""
    name = drive.scenario.name
    bent = " The pipe bends, and is drawn straight." if drive.scenario.pipe.bends else ""
    head = (
        f"<h1>{escape(name)}</h1><p>{escape(drive.scenario.why)} What really happened, {drive.time_s[-1]:.1f} s; seed "
        f"{drive.scenario.seed}.{bent}</p>"
    )
    controls = (
        '<p style="max-width:none"><button id="play">Play</button> <label>Time <input id="at" type="range" min="0" '
        f'max="{drive.time_s.size - 1}" value="0" style="width:22rem"></label> <output id="now"></output> '
        '<label>Speed <select id="speed"><option>0.25</option><option selected>1</option><option>4</option>'
        "<option>16</option></select></label></p>"
        "<p>Drag or arrow keys to turn, wheel or + and − to zoom. Wheels are red while they slip by more than 5 mm/s "
        "and hollow in the air.</p>"
    )
    body = (
        f'<section>{controls}<canvas id="scene" width="1200" height="620" style="width:100%" role="img" tabindex="0" '
        f'aria-label="The robot in the pipe"></canvas>{_legend(drive)}</section>'
        '<section><h2>Over time</h2><canvas id="series" width="1200" height="520" style="width:100%" role="img" '
        'aria-label="Roll, slip and contact force over time"></canvas></section>'
    )
    data = json.dumps(page_data(drive), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    body += f'<script type="application/json" id="drive">{data}</script>'
    script = "".join(part.read_text(encoding="utf-8") for part in (SCENE, PLAYER))
    footer = "Made by pipetwin view. Lengths in mm, angles in degrees."
    file.write_text(page_html(f"{name}: the drive", head, body, footer, script=script), encoding="utf-8")


def page_data(drive: Playback) -> dict[str, Any]:
    """Everything the player needs; long arrays as little-endian numbers in base64."""
    robot, pipe = drive.scenario.robot, drive.pipe
    deepest = max(float(np.percentile(drive.cloud_dev_mm, 99.5)), 0.5) if drive.cloud_dev_mm.size else 0.5
    shade = np.clip(drive.cloud_dev_mm / deepest, 0, 1) * (SHADES - 1)
    return {
        "time": np.round(drive.time_s, 4).tolist(),
        "pose": packed(drive.T_pipe_camera[:, :3].reshape(-1, 12), "<f4"),
        "hubs": packed(drive.hubs_mm, "<f4"),
        "spin": packed(drive.spin_rad, "<f4"),
        "slip": packed(drive.slip_mm_s, "<f4"),
        "force": packed(drive.force_n, "<f4"),
        "wheels": drive.hubs_mm.shape[1],
        "roll": np.round(drive.roll_deg, 3).tolist(),
        "apex": drive.apex_camera_mm.tolist(),
        "rays": packed(drive.rays_camera, "<f4"),
        "light": packed(np.nan_to_num(drive.light_mm * 10).clip(0, 65535).round(), "<u2"),
        "slits": list(drive.light_mm.shape[1:]),
        "cloud": packed(drive.cloud_mm.round(2), "<f4"),
        "shade": packed(shade.round(), "<u1"),
        "deepest": round(deepest, 2),
        "shades": shades(),
        "series": list(SERIES),
        "pipe": {
            "radius": pipe.bore_radius_mm,
            "start": pipe.start_mm,
            "end": pipe.end_mm,
            "outlines": _outlines(pipe),
        },
        "robot": {
            "ahead": robot.camera_ahead_mm,
            "radius": robot.chassis_radius_mm,
            "length": robot.chassis_length_mm,
            "sensorRadius": robot.sensor_radius_mm,
            "sensorLength": robot.sensor_length_mm,
            "wheel": robot.wheel_radius_mm,
            "endWheel": robot.end_wheel_radius_mm,
            "legs": robot.leg_count,
        },
    }


def packed(values: np.ndarray, kind: str) -> str:
    """Numbers of a kind ("<f4", say) as text that a page's script unpacks."""
    return b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def shades(count: int = SHADES) -> list[str]:
    """Colours from no deviation to the deepest, as in the report's clouds."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colormaps["cividis"](k / (count - 1))) for k in range(count)]


def _outlines(pipe: Pipe) -> list[list[list[float]]]:
    """Lines around features and debris, and around the pipe at joints."""
    turn = np.linspace(0, 2 * np.pi, OUTLINE_POINTS + 1)
    boxes = []
    for feature in pipe.features:
        size = feature.size(pipe.bore_radius_mm)
        boxes.append((feature.distance_mm, np.radians(feature.clock_deg), size.length_mm / 2, size.width_mm / 2))
    boxes += [(d.distance_mm, np.radians(d.clock_deg), d.diameter_mm / 2, d.diameter_mm / 2) for d in pipe.debris]
    lines = []
    for z_mm, theta, half_z, half_arc in boxes:
        # a rounded rectangle: the corners of the unrolled wall, seen as a superellipse
        along, across = (np.sign(f) * np.abs(f) ** 0.3 for f in (np.sin(turn), np.cos(turn)))
        lines.append((theta + across * half_arc / pipe.bore_radius_mm, z_mm + along * half_z))
    lines += [(turn, np.full(turn.shape, joint.distance_mm)) for joint in pipe.joints]
    return [_on_wall(pipe, theta, z).round(1).tolist() for theta, z in lines]


def _on_wall(pipe: Pipe, theta: np.ndarray, z_mm: np.ndarray) -> np.ndarray:
    places = pipe.bore_radius_mm * wall_direction(theta)
    places[:, 2] = z_mm
    return places


def _legend(drive: Playback) -> str:
    if not drive.cloud_dev_mm.size:
        return '<p class="note">The run left no wall map, so that no cloud is drawn.</p>'
    return (
        '<p class="note">Points: the wall map, from blue (on the nominal wall) to yellow (deeper); rings: where the '
        "light beside each slit truly falls; orange lines: true defects, joints and debris.</p>"
    )
