"""Frames a second of drawing, ray-casting, exposing and PNG encoding on one core, and their ratios; a frame to show."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from algorithms.decode import DecodeSettings, decode
from sensor_model import drawing, raycast
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.rig import Rig, preset_rig
from sensor_model.sense import png
from twin.features.pocket import Pocket
from twin.pipe import Pipe

FRAMES = 8
SHOWN_PX = (1000, 740)
COLORS = ("#ffffff", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#b3ff66")


def seconds(step: Callable[[], object]) -> float:
    """Median processor time of one call, compiled and warm: what a core of its own would take."""
    step()
    times = []
    for _ in range(FRAMES):
        start = time.process_time()
        step()
        times.append(time.process_time() - start)
    return float(np.median(times))


def shown(stored: np.ndarray, rig: Rig) -> np.ndarray:
    """The picture, smaller, with the slits that are found in it, each in a colour of its own; BGR."""
    out = cv2.resize(stored, SHOWN_PX, interpolation=cv2.INTER_AREA)[..., ::-1].copy()
    found = decode(stored, rig, DecodeSettings())
    scale = np.array(SHOWN_PX) / stored.shape[1::-1]
    for pixel, slit in zip((found.pixel + 0.5) * scale - 0.5, found.slit, strict=True):
        color = tuple(bytes.fromhex(COLORS[slit][1:])[::-1])
        cv2.circle(out, [round(float(x)) for x in pixel], 1, color, -1, cv2.LINE_AA)
    return out


def main() -> None:
    """Measure and print, or write the frame."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--frame", type=Path, help="write a drawn frame with its decoded slits (JPEG) here instead")
    asked = words.parse_args()
    cv2.setNumThreads(1)
    pocket = Pocket(distance_mm=285, clock_deg=120, depth_mm=7.5, length_mm=70, width_mm=35)
    plain = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
    carved = plain.model_copy(update={"features": (pocket,)})
    T_pipe_camera = np.eye(4)
    T_pipe_camera[:3, 3] = 4, -3, 160
    rig, optics, rng = preset_rig(), Optics(), np.random.default_rng(0)
    drawn = drawing.draw(carved, T_pipe_camera, rig, optics)
    stored = expose(drawn, optics, rng, rig.camera)
    if asked.frame is not None:
        cv2.imwrite(str(asked.frame), shown(stored, rig), [cv2.IMWRITE_JPEG_QUALITY, 85])
        return
    took = {
        "drawing, plain pipe": seconds(lambda: drawing.draw(plain, T_pipe_camera, rig, optics)),
        "drawing, pocket and its shadow": seconds(lambda: drawing.draw(carved, T_pipe_camera, rig, optics)),
        "ray-casting, pocket and its shadow": seconds(lambda: raycast.draw(carved, T_pipe_camera, rig, optics)),
        "exposing": seconds(lambda: expose(drawn, optics, rng, rig.camera)),
        "PNG": seconds(lambda: png(stored)),
    }
    for name, spent in took.items():
        print(f"{name:36s} {1000 * spent:7.0f} ms {1 / spent:7.1f} frames/s")
    whole = took["drawing, pocket and its shadow"] + took["exposing"] + took["PNG"]
    print(f"{'whole picture (draw, expose, PNG)':36s} {1000 * whole:7.0f} ms {1 / whole:7.1f} frames/s")
    ratio = took["ray-casting, pocket and its shadow"] / took["drawing, pocket and its shadow"]
    print(f"ray-casting takes {ratio:.2f} x the time of drawing")


if __name__ == "__main__":
    main()
