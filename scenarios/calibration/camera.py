"""`pipetwin calibrate camera`: pictures of a checkerboard in, the camera of a rig out, with a page."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from algorithms.calibration.board_pose import seen
from algorithms.calibration.boards import Checkerboard, checkerboard_corners
from algorithms.calibration.camera import LEAST_PICTURES, NAMES, NORMAL_95, CameraCalibration, calibrate_camera
from algorithms.calibration.failure import CannotCalibrate
from scenarios.calibration.pictures import gray, listed, read_picture
from scenarios.calibration.rig_file import write_rig
from scenarios.document import BadInput
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import BLUE, VERMILION, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from sensor_model.rig import Camera, Rig

ARROW_SCALE = 100.0  # residuals are drawn so much larger than they are


@dataclass(frozen=True)
class BoardPictures:
    """Corners of the pictures that show the board whole, and why the others are not used."""

    names: tuple[str, ...]
    pixel: Float[np.ndarray, "pictures corners 2"]
    size_px: tuple[int, int]
    rejected: dict[str, str]


def calibrate(images: list[Path], board: Checkerboard, base: Rig, out: Path) -> dict[str, Any]:
    """Calibrate, write rig and page, and give the figures.

    Raises:
        BadInput: where the pictures do not do.
    """
    pictures = find_boards(listed(images), board)
    try:
        found = calibrate_camera(pictures.pixel, board, pictures.size_px)
    except CannotCalibrate as error:
        raise BadInput([f"{images[0].parent if len(images) > 1 else images[0]}: {error}", *_said(pictures)]) from error
    rig = base.model_copy(update={"camera": camera_of(found, pictures.size_px)})
    write_rig(rig, out)
    figures = _figures(found, pictures)
    with whole_file(page_of(out, "camera")) as work:
        work.write_text(_page(found, pictures, board, figures), encoding="utf-8")
    return figures


def page_of(out: Path, kind: str) -> Path:
    """Where the page of a calibration lies: beside the rig."""
    return out.with_name(f"{out.stem}-{kind}.html")


def camera_of(found: CameraCalibration, size_px: tuple[int, int]) -> Camera:
    """The calibrated camera as settings."""
    lens = dict(zip(NAMES, found.fit.intrinsics.tolist(), strict=True))
    return Camera(width_px=size_px[0], height_px=size_px[1], **lens)


def find_boards(files: list[Path], board: Checkerboard) -> BoardPictures:
    """Look for the board in every picture.

    Raises:
        BadInput: when too few pictures show it; each picture has its own line.
    """
    seen: dict[str, tuple[np.ndarray, tuple[int, int]]] = {}
    rejected: dict[str, str] = {}
    for file in files:
        try:
            picture = read_picture(file)
        except BadInput as error:
            rejected[str(file)] = error.lines[0].removeprefix(f"{file}: ")
            continue
        corners = checkerboard_corners(gray(picture), board)
        size = (picture.shape[1], picture.shape[0])
        if corners is None:
            rejected[str(file)] = f"no board of {board.columns}x{board.rows} inner corners is seen whole"
        elif any(np.array_equal(corners, other) for other, _ in seen.values()):
            rejected[str(file)] = "the same corners as in an earlier picture"
        else:
            seen[str(file)] = (corners, size)
    usual = Counter(size for _, size in seen.values()).most_common(1)
    for name in [name for name, (_, size) in seen.items() if size != usual[0][0]]:
        size = seen.pop(name)[1]
        rejected[name] = f"{size[0]} x {size[1]} px, unlike the others' {usual[0][0][0]} x {usual[0][0][1]}"
    if len(seen) < LEAST_PICTURES:
        told = [f"{name}: not used: {why}" for name, why in rejected.items()]
        raise BadInput(
            [
                f"{files[0]}: {len(seen)} of {len(files)} pictures can be used; at least {LEAST_PICTURES} are needed",
                *told,
            ]
        )
    return BoardPictures(tuple(seen), np.array([corners for corners, _ in seen.values()]), usual[0][0], rejected)


def _said(pictures: BoardPictures) -> list[str]:
    return [f"{name}: not used: {why}" for name, why in pictures.rejected.items()]


def _figures(found: CameraCalibration, pictures: BoardPictures) -> dict[str, Any]:
    """What `--json` prints."""
    fit = found.fit
    far = {pictures.names[i]: "its error is four times the usual or more" for i in found.far_off}
    every = dict(zip((pictures.names[i] for i in found.used), fit.picture_rms_px.tolist(), strict=True))
    return {
        "rms_px": fit.rms_px,
        **dict(zip(NAMES, fit.intrinsics.tolist(), strict=True)),
        "interval_95": dict(zip(NAMES, (NORMAL_95 * fit.std).tolist(), strict=True)),
        "held_out_rms_px": found.held_out_rms_px,
        "board": "bent" if found.board_is_bent else "flat",
        "flat_rms_px": found.flat.rms_px,
        "flat_held_out_rms_px": found.flat_held_out_rms_px,
        "flat_fx_px": float(found.flat.intrinsics[0]),
        "flat_fy_px": float(found.flat.intrinsics[1]),
        "board_bend_squares": float(np.abs(fit.shape[:, 2]).max()),
        "pictures_used": len(found.used),
        "pictures_rejected": {**pictures.rejected, **far},
        "picture_rms_px": every,
        "weak": found.weakness,
    }


def _page(found: CameraCalibration, pictures: BoardPictures, board: Checkerboard, figures: dict[str, Any]) -> str:
    fit = found.fit
    shape = "with the board's own shape estimated" if found.board_is_bent else "with a flat board"
    verdict = (
        f"{fit.rms_px:.3f} px RMS over {len(found.used)} pictures, {found.held_out_rms_px:.3f} px on pictures left out"
    )
    verdict += f". Weak: {found.weakness}." if found.weakness else "."
    lens = [
        ("", "value", "± (95 %)", "flat board", "± (95 %)"),
        *(
            (name, f"{fit.intrinsics[k]:.5g}", f"{NORMAL_95 * fit.std[k]:.2g}",
             f"{found.flat.intrinsics[k]:.5g}", f"{NORMAL_95 * found.flat.std[k]:.2g}")
            for k, name in enumerate(NAMES)
        ),
    ]  # fmt: skip
    errors = [
        ("board taken as", "RMS (px)", "RMS on left-out pictures (px)"),
        ("flat", f"{found.flat.rms_px:.3f}", f"{found.flat_held_out_rms_px:.3f}"),
        ("bent", f"{found.bent.rms_px:.3f}", f"{found.bent_held_out_rms_px:.3f}"),
    ]
    rejected = [("picture", "why not used"), *((name, why) for name, why in figures["pictures_rejected"].items())]
    sections = [
        Section("The lens", [f"OpenCV's fisheye model, {shape}; intervals from the scatter of the corners."], lens),
        Section("Is the board flat?", [_flatness(found)], errors, [_bend_figure(found, board)]),
        Section("Reprojection error", [], (), [_error_figure(found, pictures), _residual_figure(found)]),
        Section("Pictures not used", [] if len(rejected) > 1 else ["All pictures were used."],
                rejected if len(rejected) > 1 else ()),
    ]  # fmt: skip
    lead = f"{board.columns} x {board.rows} inner corners, {pictures.size_px[0]} x {pictures.size_px[1]} px"
    return calibration_page("Camera calibration", lead, verdict, not found.weakness, sections)


def _flatness(found: CameraCalibration) -> str:
    most = float(np.abs(found.bent.shape[:, 2]).max())
    if found.board_is_bent:
        return (
            f"No: its corners lie up to {100 * most:.1f} % of a square out of their plane. The shape is the same in "
            "all pictures and predicts pictures that had no part in it, so it is believed."
        )
    return "As far as these pictures tell: an estimated shape does not help on pictures left out."


def _error_figure(found: CameraCalibration, pictures: BoardPictures) -> Picture:
    errors = found.fit.picture_rms_px
    with drawing(3.2) as figure:
        axes = figure.subplots()
        axes.bar(np.arange(errors.size), errors, color=BLUE)
        names = [Path(pictures.names[i]).stem for i in found.used]
        axes.set_xticks(np.arange(errors.size), names, rotation=70, fontsize=7)
        axes.axhline(found.fit.rms_px, color=VERMILION)
        axes.set_ylabel("RMS error (px)")
        return to_picture(
            figure,
            f"Bars of reprojection error per picture, from {errors.min():.2f} to {errors.max():.2f} px.",
            "Reprojection error of every picture used; the line is the RMS of all.",
        )


def _residual_figure(found: CameraCalibration) -> Picture:
    fit = found.fit
    with drawing(5.6) as figure:
        axes = figure.subplots()
        for pose, residual in zip(fit.poses, fit.residual_px, strict=True):
            drawn = seen(fit.intrinsics, pose, fit.shape).pixel
            axes.quiver(*(drawn - residual).T, *residual.T, color=BLUE, angles="xy", scale_units="xy",
                        scale=1 / ARROW_SCALE, width=0.001)  # fmt: skip
        axes.set_aspect("equal")
        axes.invert_yaxis()
        axes.set_xlabel("u (px)")
        axes.set_ylabel("v (px)")
        return to_picture(
            figure,
            "Arrows of reprojection residuals over the picture's area.",
            f"Residuals of all corners, {ARROW_SCALE:g} times as long as they are. A pattern here is a lens or a board "
            "that the model does not hold.",
        )


def _bend_figure(found: CameraCalibration, board: Checkerboard) -> Picture:
    height = 100 * found.bent.shape[:, 2].reshape(board.rows, board.columns)
    most = max(float(np.abs(height).max()), 0.1)
    with drawing(4.2, 6.0) as figure:
        axes = figure.subplots()
        image = axes.imshow(height, cmap="RdBu_r", vmin=-most, vmax=most)
        axes.grid(visible=False)
        figure.colorbar(image, label="out of the plane (% of a square)")
        axes.set_xlabel("column of corners")
        axes.set_ylabel("row")
        return to_picture(
            figure,
            f"Map of the board's height at its corners, up to {most:.1f} % of a square.",
            "How far each corner lies behind (red) or before (blue) the board's plane.",
        )
