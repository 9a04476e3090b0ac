"""How decoding holds on the real frames in a pipe, if darkened, brightened, blurred, noisy, stored worse or turned."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from algorithms.calibration.pipe_view import view_pipe
from algorithms.decode import decode
from algorithms.decoding.settings import DecodeSettings
from scenarios.calibration.pictures import read_picture
from sensor_model.processing import Processing, processed
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig, preset_rig

LABELS = Path(__file__).parents[1] / "tests" / "algorithms" / "in_pipe_labels.csv"
LABEL_PX, LINE_DEG, INNER = 12.0, 0.5, 5


def times(factor: float) -> Callable:
    """All levels times a factor, clipped where the picture is full."""
    return lambda picture: np.clip(np.rint(picture * factor), 0, 255).astype(np.uint8)


def blurred(sigma_px: float) -> Callable:
    """A Gaussian blur."""
    return lambda picture: cv2.GaussianBlur(picture, (0, 0), sigma_px)


def noisy(levels: float) -> Callable:
    """Noise of so many levels in every channel."""
    noise = np.random.default_rng(0)
    return lambda picture: np.clip(np.rint(picture + noise.normal(0, levels, picture.shape)), 0, 255).astype(np.uint8)


def jpeg(quality: int) -> Callable:
    """Stored as JPEG and read back."""
    return lambda picture: processed(picture, Processing(jpeg_quality=quality))


def tinted(red: float, green: float, blue: float) -> Callable:
    """Another white balance, or wall."""
    return lambda picture: times(np.array([red, green, blue]))(picture)


class Case(NamedTuple):
    """A row of the table: what is done to the picture, and by how many quarters it is turned after that."""

    name: str
    change: Callable
    quarters: int = 0


CASES = (
    Case("as it is", times(1)),
    Case("brightness x 0.3", times(0.3)),
    Case("brightness x 0.5", times(0.5)),
    Case("brightness x 0.75", times(0.75)),
    Case("brightness x 1.3", times(1.3)),
    Case("brightness x 1.6", times(1.6)),
    Case("blur 1 px", blurred(1)),
    Case("blur 2 px", blurred(2)),
    Case("blur 3 px", blurred(3)),
    Case("noise 3 levels", noisy(3)),
    Case("noise 6 levels", noisy(6)),
    Case("JPEG 60", jpeg(60)),
    Case("JPEG 30", jpeg(30)),
    Case("blue x 0.6", tinted(1, 1, 0.6)),
    Case("red x 0.7", tinted(0.7, 1, 1)),
    Case("x 0.5, blur 1 px, noise 3 levels, JPEG 60", lambda p: jpeg(60)(noisy(3)(blurred(1)(times(0.5)(p))))),
    Case("turned by 90 degrees", times(1), 1),
    Case("turned by 180 degrees", times(1), 2),
    Case("turned by 270 degrees", times(1), 3),
)


def turned(rig: Rig, quarters: int) -> Rig:
    """The rig of a picture turned counterclockwise by quarters: its camera's centre goes along."""
    for _ in range(quarters):
        camera = rig.camera
        moved = {"width_px": camera.height_px, "height_px": camera.width_px}
        moved |= {"cx_px": camera.cy_px, "cy_px": camera.width_px - 1 - camera.cx_px}
        rig = rig.model_copy(update={"camera": camera.model_copy(update=moved)})
    return rig


def against_labels(seen: SlitPixels, rig: Rig, frame: str, turned_deg: float = 0.0) -> tuple[float, float, float]:
    """Shares of the places labelled by eye that are found right, of inner and of outer slits; share found wrong."""
    off = seen.pixel - [rig.camera.cx_px, rig.camera.cy_px]
    azimuth_deg, radius_px = np.degrees(np.arctan2(off[:, 0], -off[:, 1])), np.hypot(off[:, 0], off[:, 1])
    names = [slit.name for slit in rig.projector.slits]
    right, wrong, inner = [], [], []
    with LABELS.open() as file:
        rows = [row for row in csv.DictReader(file) if row["frame"] == frame]
    for row in rows:
        slit, turn = names.index(row["slit"]), azimuth_deg - float(row["azimuth_deg"]) - turned_deg
        line = np.abs((turn + 180) % 360 - 180) < 0.5 * LINE_DEG
        here = radius_px[line & (seen.slit == slit)]
        right.append(here.size > 0 and abs(here[0] - float(row["radius_px"])) < LABEL_PX)
        wrong.append(here.size > 0 and not right[-1])
        inner.append(slit < INNER)
    of_inner = np.array(inner)
    return float(np.mean(np.array(right)[of_inner])), float(np.mean(np.array(right)[~of_inner])), float(np.mean(wrong))


def row_of(case: Case, frames: dict[str, np.ndarray], rig: Rig) -> str:
    """One line of the table; a turned picture's projector is not turned along, so that it has no cylinder here."""
    cells = []
    for frame, picture in frames.items():
        changed = np.ascontiguousarray(np.rot90(case.change(picture), case.quarters))
        there = turned(rig, case.quarters)
        seen = decode(changed, there, DecodeSettings())
        inner, outer, wrong = against_labels(seen, there, frame, -90.0 * case.quarters)
        cells.append(f"{100 * inner:.0f} / {100 * outer:.0f} / {100 * wrong:.1f}")
        view = None if case.quarters else view_pipe(changed, rig, DecodeSettings())
        cells.append(f"{2 * view.alignment.radius_mm:.2f}" if view and view.alignment.converged else "-")
    return f"| {case.name} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("folder", type=Path, help="where im1.png and im2.png of a pipe lie")
    folder = words.parse_args().folder
    frames = {name: read_picture(folder / f"{name}.png") for name in ("im1", "im2")}
    print("| picture | im1: inner / outer / wrong % | diameter mm | im2: inner / outer / wrong % | diameter mm |")
    print("| --- | --- | --- | --- | --- |")
    for case in CASES:
        print(row_of(case, frames, preset_rig()), flush=True)


if __name__ == "__main__":
    main()
