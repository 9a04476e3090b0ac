"""The commands `pipetwin calibrate camera|projector|imu` and `pipetwin decode`."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from scenarios.options import AsJson

BOARD = re.compile(r"(\d{1,2})x(\d{1,2})")

calibrate = typer.Typer(help="Calibrate camera, projector or IMU from pictures and logs.", no_args_is_help=True)
OutRig = Annotated[
    Path, typer.Option("-o", "--out", metavar="RIG.YAML", help="The rig to write; a page goes beside it.")
]
BaseRig = Annotated[str, typer.Option("--rig", metavar="RIG", help="The rig whose other parts are kept.")]
TrueRig = Annotated[
    str | None,
    typer.Option("--true-rig", metavar="RIG", help="The rig that drew the pictures, where a twin did: prints errors."),
]


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.add_typer(calibrate, name="calibrate")
    app.command()(decode)


@calibrate.command()
def camera(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGES...", help="Pictures of a checkerboard, or folders.")],
    out: OutRig,
    board: Annotated[str, typer.Option("--board", metavar="CxR", help="Its inner corners.")] = "6x9",
    rig: BaseRig = "endoscope",
    as_json: AsJson = False,
) -> None:
    """Calibrate the camera (OpenCV's fisheye) from pictures of a checkerboard."""
    _one_thread()
    from algorithms.calibration.boards import Checkerboard
    from scenarios.calibration.camera import calibrate as calibrate_camera
    from scenarios.calibration.camera import page_of
    from scenarios.calibration.rig_file import read_rig
    from scenarios.document import BadInput

    size = BOARD.fullmatch(board)
    if not size or not all(3 <= int(side) <= 40 for side in size.groups()):
        raise BadInput([f"--board: got {board!r}; give inner corners as 6x9, each from 3 to 40"])
    counted = Checkerboard(columns=int(size[1]), rows=int(size[2]))
    figures = calibrate_camera(images, counted, read_rig(rig), out)
    _show(figures, as_json)
    _say(f"rig: {out}", f"page: {page_of(out, 'camera')}", as_json=as_json)


@calibrate.command()
def projector(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="CamNN.png (white light) and ProjNN.png (rings).")],
    camera: Annotated[str, typer.Option("--camera", metavar="RIG", help="The rig with the calibrated camera.")],
    out: OutRig,
    as_json: AsJson = False,
    marker_mm: Annotated[float, typer.Option("--marker-mm", min=1, max=1000, help="Side of a marker.")] = 36.2143,
    true_rig: TrueRig = None,
) -> None:
    """Calibrate the projector from pictures of a board with ArUco markers (4 x 6, gaps of a fifth of a marker)."""
    _one_thread()
    from algorithms.calibration.boards import ArucoGrid
    from scenarios.calibration.camera import page_of
    from scenarios.calibration.projector import calibrate as calibrate_projector
    from scenarios.calibration.rig_file import read_rig

    board = ArucoGrid(marker_mm=marker_mm, gap_mm=marker_mm / 5)
    known = read_rig(true_rig) if true_rig else None
    _show(calibrate_projector(folder, read_rig(camera), board, out, known), as_json)
    _say(f"rig: {out}", f"page: {page_of(out, 'projector')}", as_json=as_json)


@calibrate.command()
def imu(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="The device's log, or a recording's orientation0/data.csv.")
    ],
    poses: Annotated[Path, typer.Argument(metavar="POSES", help="Board poses: .mat with rvecs, or CSV of rx, ry, rz.")],
    out: OutRig,
    rig: BaseRig = "endoscope",
    as_json: AsJson = False,
) -> None:
    """Calibrate how the IMU is turned against the camera (section 3.2.1)."""
    _one_thread()
    from scenarios.calibration.camera import page_of
    from scenarios.calibration.imu import calibrate as calibrate_imu
    from scenarios.calibration.rig_file import read_rig

    _show(calibrate_imu(log, poses, read_rig(rig), out), as_json)
    _say(f"rig: {out}", f"page: {page_of(out, 'imu')}", as_json=as_json)


@calibrate.command()
def draw(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where the pictures go.")],
    board: Annotated[
        Literal["checkerboard", "markers"], typer.Option("--board", help="For `camera`, or for `projector`.")
    ],
    rig: Annotated[str, typer.Option("--rig", metavar="RIG", help="The rig that draws them.")] = "endoscope",
    look: Annotated[str, typer.Option("--look", help="Its optics: plain, endoscope.")] = "plain",
    poses: Annotated[int, typer.Option("--poses", min=1, max=99, help="How many.")] = 24,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the poses and the noise.")] = 0,
) -> None:
    """Draw the twin's pictures of a calibration board, and the rig that drew them: a closed loop."""
    _one_thread()
    from scenarios.calibration.draw import draw_boards
    from scenarios.calibration.rig_file import read_rig

    names = draw_boards(folder, board, read_rig(rig), look, poses, seed)
    print(f"{len(names)} pictures and rig.yaml: {folder}")


@calibrate.command("pipe")
def in_pipe(
    scan: Annotated[
        list[Path],
        typer.Argument(metavar="RUN_OR_IMAGES...", help="A run or recording; or pictures of one clean pipe."),
    ],
    rig: Annotated[str, typer.Option("--rig", metavar="RIG", help="The rig to start from, as the boards gave it.")],
    out: OutRig,
    radius_mm: Annotated[
        float | None, typer.Option("--radius-mm", min=10, max=500, help="The pipe's inner radius, where it is known.")
    ] = None,
    true_rig: TrueRig = None,
    as_json: AsJson = False,
) -> None:
    """Learn the projector's cones from a scan of clean pipe; from pictures its seat and slide, once mounted anew."""
    _one_thread()
    from scenarios.calibration.camera import page_of
    from scenarios.calibration.clean_pipe import calibrate_pipe

    _show(calibrate_pipe(scan, rig, out, radius_mm, true_rig), as_json)
    _say(f"rig: {out}", f"page: {page_of(out, 'pipe')}", as_json=as_json)


@calibrate.command()
def slide(
    scan: Annotated[Path, typer.Argument(metavar="RUN_OR_RECORDING", help="A folder that `run` made, or a recording.")],
    out: OutRig,
    as_json: AsJson = False,
) -> None:
    """Learn how jagged the projector's slide is from a scan's own clean wall; of a twin's run, what that does to it."""
    _one_thread()
    from scenarios.calibration.camera import page_of
    from scenarios.calibration.in_scan import calibrate_slide

    _show(calibrate_slide(scan, out), as_json)
    _say(f"rig: {out}", f"page: {page_of(out, 'slide')}", as_json=as_json)


def decode(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="A picture of the rings in a pipe (PNG or JPEG).")],
    rig: Annotated[str, typer.Option("--rig", metavar="RIG", help="A rig by name, or a rig.yaml.")] = "endoscope",
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="Where the overlay goes.  [default: decoded/NAME]")
    ] = None,
    twin: Annotated[
        str | None,
        typer.Option("--twin", metavar="LOOK", help="Draw the twin from the same place and compare: plain, endoscope."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure one picture by itself: slits, points, cylinder, coverage, residual."""
    _one_thread()
    from scenarios.calibration.in_pipe import decode_picture
    from scenarios.calibration.rig_file import read_rig

    out = out or Path("decoded") / image.stem
    _show(decode_picture(image, read_rig(rig), out, twin), as_json)
    _say(f"page: {out / 'decode.html'}", as_json=as_json)


def _one_thread() -> None:
    """Small matrices are twenty times slower on several threads when another process is at work."""
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _show(figures: dict[str, Any], as_json: bool) -> None:
    """Print figures, those of a group indented under its name."""
    if as_json:
        print(json.dumps(figures, indent=2))
        return
    width = max(map(len, figures))
    for key, value in figures.items():
        if isinstance(value, dict):
            print(key if value else f"{key:<{width}}  none")
            for name, inner in value.items():
                print(f"  {name}: {_figure(inner)}")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            print(key)
            for row in value:
                print(f"  {_figure(row)}")
        elif value != "":
            print(f"{key:<{width}}  {_figure(value)}")


def _figure(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(_figure(item) for item in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_figure(item)}" for key, item in value.items())
    return str(value)


def _say(*lines: str, as_json: bool) -> None:
    """Where things are: on stdout, or beside the JSON on stderr."""
    for line in lines:
        typer.echo(line, err=as_json)
