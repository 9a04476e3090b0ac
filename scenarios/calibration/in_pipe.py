"""`pipetwin decode`: one picture of a pipe, measured by itself."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import UInt8

from algorithms.calibration.pipe_view import INNER_SLITS, PipeView, axis_of, robust_residual_mm, view_pipe
from algorithms.calibration.slide import corrected_residual_mm, with_jag
from algorithms.decode import DecodeSettings
from scenarios.calibration.look import look_of, twin_of
from scenarios.calibration.pictures import read_picture
from scenarios.document import BadInput
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import SERIES, Picture, drawing, photograph, to_picture
from scenarios.report.photographs import DOTS
from scenarios.run_folder import whole_file
from sensor_model.geometry import projector_azimuth_rad
from sensor_model.optics import Optics, look
from sensor_model.rig import Rig

LEAST_POINTS = 200
OVERLAY_SCALE = 0.6


def decode_picture(image: Path, rig: Rig, out: Path, twin_look: str | None = None) -> dict[str, Any]:
    """Decode one picture, write overlay, cloud and page into a folder, and give the figures.

    With a look, the twin is drawn from the same place by those optics ("plain": the default ones) and compared.

    Raises:
        BadInput: for a picture that cannot be read, is of another size, or shows no pipe.
    """
    optics = None if twin_look is None else optics_called(twin_look, "--twin")
    started = perf_counter()
    picture = read_for(image, rig)
    read_ms = 1e3 * (perf_counter() - started)
    plain_rig = with_jag(rig, np.zeros((len(rig.projector.slits), 0)))
    view_pipe(picture, plain_rig, DecodeSettings())  # the first call compiles
    view = seen_in(image, picture, plain_rig)
    jagged = bool(rig.projector.jag_table_rad.size)
    figures = _figures(view, rig, corrected_residual_mm(view, rig) if jagged else None, read_ms)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput([f"{out}: cannot be made: {error.strerror}; choose another folder with -o"]) from error
    more = [_beside_twin(picture, view, plain_rig, optics, figures)] if optics else []
    overlay = _overlay(picture, view)
    write_png(overlay, out / "overlay.png")
    with whole_file(out / "cloud.ply") as work:
        _write_cloud(view, work)
    with whole_file(out / "decode.html") as work:
        work.write_text(_decode_page(image, overlay, view, rig, figures, more), encoding="utf-8")
    return figures


def optics_called(name: str, flag: str) -> Optics:
    """A look by its name; "plain" is the default optics.

    Raises:
        BadInput: naming the flag and the looks there are.
    """
    try:
        return Optics() if name == "plain" else look(name)
    except ValueError as error:
        raise BadInput([f"{flag}: {error}, and plain"]) from error


def read_for(image: Path, rig: Rig) -> UInt8[np.ndarray, "height width 3"]:
    """A picture of the rig's size.

    Raises:
        BadInput: for one that is not.
    """
    picture = read_picture(image)
    expected = (rig.camera.height_px, rig.camera.width_px)
    if picture.shape[:2] != expected:
        size = f"{picture.shape[1]} x {picture.shape[0]} px"
        raise BadInput([f"{image}: got {size}; the rig's camera has {expected[1]} x {expected[0]} px"])
    return picture


def seen_in(image: Path, picture: UInt8[np.ndarray, "height width 3"], rig: Rig) -> PipeView:
    """What is seen of a pipe in a picture.

    Raises:
        BadInput: when that is none.
    """
    view = view_pipe(picture, rig, DecodeSettings())
    if view.points.ring.size < LEAST_POINTS:
        count = f"{view.points.ring.size} slit points"
        raise BadInput([f"{image}: got {count}; a picture of the rings in a pipe has {LEAST_POINTS} or more"])
    if not view.alignment.converged:
        raise BadInput([f"{image}: its points lie on no cylinder: {view.alignment.reason}"])
    return view


def _figures(view: PipeView, rig: Rig, corrected_mm: float | None, read_ms: float) -> dict[str, Any]:
    place = axis_of(view.alignment)
    slits = rig.projector.slits
    return {
        "coverage_inner": view.coverage(slice(0, INNER_SLITS)),
        "coverage_outer": view.coverage(slice(INNER_SLITS, None)),
        "inner_diameter_mm": 2 * view.alignment.radius_mm,
        "center_mm": [float(place[0]), float(place[1])],
        "tilt_deg": float(np.degrees(np.arctan(np.hypot(place[2], place[3])))),
        "residual_mm": robust_residual_mm(view),
        "residual_corrected_mm": corrected_mm,
        "points": int(view.points.ring.size),
        "off_the_wall_share": float(1 - view.right.mean()),
        "slits": {
            f"{j + 1} {slit.name}": {
                "points": int((view.points.ring == j).sum()),
                "in_view": int(view.expected[j].sum()),
                "coverage": view.coverage(slice(j, j + 1)) if view.expected[j].any() else None,
            }
            for j, slit in enumerate(slits)
        },
        "ms": {"read": read_ms, **view.ms},
        "verdict": view.alignment.verdict,
        "weak": view.alignment.reason,
    }


def _overlay(picture: UInt8[np.ndarray, "height width 3"], view: PipeView) -> UInt8[np.ndarray, "height width 3"]:
    """The picture with its decoded slits; points off the cylinder as crosses."""
    import cv2

    out = picture.copy()
    for (u, v), slit, right in zip(view.points.pixel, view.points.ring, view.right, strict=True):
        place = (round(float(u)), round(float(v)))
        if right:
            cv2.circle(out, place, 2, DOTS[slit % len(DOTS)], -1, cv2.LINE_AA)
        else:
            cv2.drawMarker(out, place, (255, 0, 0), cv2.MARKER_TILTED_CROSS, 9, 2)
    return out


def write_png(picture: UInt8[np.ndarray, "height width 3"], file: Path) -> None:
    """Write a picture whole or not at all."""
    from PIL import Image

    with whole_file(file) as work:
        Image.fromarray(picture).save(work, format="PNG")


def _write_cloud(view: PipeView, file: Path) -> None:
    """Points in the camera frame with slit and distance outside the cylinder, binary PLY."""
    kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("slit", "u1"), ("wall_dev_mm", "<f4")])
    rows = np.empty(view.points.ring.size, dtype=kind)
    rows["x"], rows["y"], rows["z"] = view.points.xyz_mm.T
    rows["slit"], rows["wall_dev_mm"] = view.points.ring + 1, view.residual_mm
    header = ["ply", "format binary_little_endian 1.0", "comment lengths in mm, camera frame",
              f"element vertex {rows.size}", "property float x", "property float y", "property float z",
              "property uchar slit", "property float wall_dev_mm", "end_header"]  # fmt: skip
    file.write_bytes("\n".join(header).encode() + b"\n" + rows.tobytes())


def _beside_twin(
    picture: UInt8[np.ndarray, "height width 3"], view: PipeView, rig: Rig, optics: Optics, figures: dict[str, Any]
) -> Section:
    """Draw the twin at the same place, measure both looks, put them into the figures and side by side."""
    import cv2

    drawn = twin_of(view, rig, optics, np.random.default_rng(0))
    looks = look_of(picture, view, rig), look_of(drawn, view_pipe(drawn, rig, DecodeSettings()), rig)
    figures["look"], figures["look_twin"] = (one.figures() for one in looks)
    rows = [("measure", "picture", "twin", "ratio")]
    for (name, real), twin in zip(figures["look"].items(), figures["look_twin"].values(), strict=True):
        rows.append((name, f"{real:.3g}", f"{twin:.3g}", f"{twin / real:.2f}" if real else "-"))
    both = np.concatenate([picture, drawn], axis=1)
    small = cv2.resize(both, None, fx=OVERLAY_SCALE / 2, fy=OVERLAY_SCALE / 2, interpolation=cv2.INTER_AREA)
    shown = photograph(
        small, "The picture beside the twin's.", "Left the picture, right the twin's from the same place."
    )
    return Section("Beside the twin", [], rows, [shown])


def _decode_page(
    image: Path,
    overlay: UInt8[np.ndarray, "height width 3"],
    view: PipeView,
    rig: Rig,
    figures: dict[str, Any],
    more: list[Section],
) -> str:
    import cv2

    small = cv2.resize(overlay, None, fx=OVERLAY_SCALE, fy=OVERLAY_SCALE, interpolation=cv2.INTER_AREA)
    count = figures["points"]
    shown = photograph(small, f"The picture with {count} decoded slit points.", "Crosses lie off the wall.")
    verdict = f"Inner diameter {figures['inner_diameter_mm']:.2f} mm; {100 * figures['coverage_inner']:.1f} % of the "
    verdict += f"inner {INNER_SLITS} slits seen, residual {figures['residual_mm']:.2f} mm"
    corrected = figures["residual_corrected_mm"]
    verdict += f", {corrected:.2f} mm with the slide's jaggedness corrected." if corrected is not None else "."
    table = [("slit", "points", "lines in view", "seen")] + [
        (name, str(row["points"]), str(row["in_view"]), _share(row["coverage"]))
        for name, row in figures["slits"].items()
    ]
    sections = [
        Section("The picture", [], (), [shown]),
        Section("Slits", [], table),
        Section("Residuals", [figures["weak"]] if figures["weak"] else [], (), [_residual_figure(view, rig)]),
        *more,
    ]
    return calibration_page(f"Decoded picture: {image.name}", "", verdict, view.alignment.converged, sections)


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _residual_figure(view: PipeView, rig: Rig) -> Picture:
    azimuth = np.degrees(projector_azimuth_rad(view.points.xyz_mm, rig.projector.T_camera_projector))
    with drawing(4.0) as figure:
        axes = figure.subplots()
        for j, slit in enumerate(rig.projector.slits):
            mine = (view.points.ring == j) & view.right
            axes.plot(
                azimuth[mine], view.residual_mm[mine], ".", ms=1.5, color=SERIES[j % 6], label=f"{j + 1} {slit.name}"
            )
        axes.set_xlabel("azimuth about the projector's axis (degrees)")
        axes.set_ylabel("outside the cylinder (mm)")
        axes.legend(ncols=8, markerscale=6)
        return to_picture(figure, "Residuals over azimuth, a colour a slit.", "Radial residuals over azimuth.")


def jag_figure(table_rad: np.ndarray, rig: Rig) -> Picture:
    """What each half angle has beyond its mean, over azimuth."""
    with drawing(5.0) as figure:
        axes = figure.subplots()
        azimuth = (np.arange(table_rad.shape[1]) + 0.5) * 360 / table_rad.shape[1]
        for j, slit in enumerate(rig.projector.slits):
            axes.plot(azimuth, np.degrees(table_rad[j]) + 0.5 * j, color=SERIES[j % 6], linewidth=0.8)
            axes.annotate(slit.name, (2, 0.5 * j + 0.15))
        axes.set_xlabel("azimuth about the projector's axis (degrees)")
        axes.set_ylabel("excess of the half angle (degrees, 0.5 apart)")
        return to_picture(figure, "Curves of the half angle's excess over azimuth.", "Zero is a smooth cone.")
