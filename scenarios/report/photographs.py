"""Sample pictures of the sensor with what was decoded in them laid over: whole, and close to a defect."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from scenarios.report.canvas import Picture, photograph
from scenarios.report.comparison import LOOK_AHEAD_RADII
from scenarios.run import Run, Sample, Scan
from sensor_model.geometry import fisheye_project, inverse, wall_direction

WIDTH_PX = 1000
CLOSE_PX = 340, 255  # of the camera's picture
CLOSE_SCALE = 2.4
# bright over dark slits, neighbours unlike in hue and in lightness
DOTS = ((255, 255, 255), (0, 229, 255), (255, 92, 244), (125, 255, 79))


def sample_pictures(run: Scan, sample: Sample) -> list[Picture]:
    """A frame at most 1000 px wide and a close view, decoded slit centres as dots; none without a picture."""
    picture = run.recording[sample.index].picture
    if picture is None:
        return []
    where = f"frame {sample.index}, camera at {sample.z_mm:.0f} mm"
    count, scale = len(sample.seen.slit), min(WIDTH_PX / picture.shape[1], 1.0)
    whole = _dotted(picture, sample, (0.0, 0.0), picture.shape[1::-1], scale, 1.2)
    center, shown = _of_interest(run, sample)
    size = min(CLOSE_PX[0], picture.shape[1]), min(CLOSE_PX[1], picture.shape[0])
    corner = tuple(float(np.clip(round(center[k] - size[k] / 2), 0, picture.shape[1 - k] - size[k])) for k in (0, 1))
    close = _dotted(picture, sample, corner, size, CLOSE_SCALE, 1.3)
    return [
        photograph(
            whole,
            f"Camera picture, {where}: coloured rings on the pipe's wall, the dark slits between them marked by "
            f"{count} decoded points.",
            f"{where.capitalize()}: {count} slit points decoded.",
        ),
        photograph(
            close,
            f"Close view of {shown} in {where}: decoded points follow the dark slits.",
            f"Close view of {shown}: each dot is one decoded slit centre.",
        ),
    ]


def _of_interest(run: Scan, sample: Sample) -> tuple[Float[np.ndarray, "2"], str]:
    """The pixel to look at closely: the defect that the rings are on, or else the wall at 3 o'clock."""
    T_pipe_camera = run.found.trajectory.T_pipe_camera[sample.index]
    if isinstance(run, Run):
        radius_mm = run.truth.pipe.bore_radius_mm
        places = [(feature.distance_mm, float(np.radians(feature.clock_deg))) for feature in run.truth.pipe.features]
    else:
        radius_mm = run.recording.pipe.inner_radius_mm
        places = [(defect.distance_mm, defect.theta_rad) for defect in run.found.defects]
    middle_mm = sample.z_mm + LOOK_AHEAD_RADII * radius_mm
    near = [place for place in places if abs(place[0] - middle_mm) < radius_mm]
    theta, z, shown = np.pi / 2, middle_mm, "the wall at 3 o'clock"
    if near:
        z, theta = min(near, key=lambda place: abs(place[0] - middle_mm))
        shown = f"the defect at {z:.0f} mm"
    place = radius_mm * wall_direction(theta) + np.array([0.0, 0.0, z])
    T_camera_pipe = inverse(T_pipe_camera)
    in_camera = T_camera_pipe[:3, :3] @ place + T_camera_pipe[:3, 3]
    return fisheye_project(in_camera, run.recording.rig.camera.intrinsics), shown


def _dotted(
    picture: UInt8[np.ndarray, "height width 3"],
    sample: Sample,
    corner_px: tuple[float, ...],
    size_px: tuple[int, ...],
    scale: float,
    dot_px: float,
) -> UInt8[np.ndarray, "out_height out_width 3"]:
    """A part of the picture, scaled, with its decoded points as dots."""
    import cv2

    left, top = (int(part) for part in corner_px)
    part = picture[top : top + size_px[1], left : left + size_px[0]]
    method = cv2.INTER_AREA if scale <= 1 else cv2.INTER_CUBIC
    out = cv2.resize(part, (round(size_px[0] * scale), round(size_px[1] * scale)), interpolation=method)
    # pixel centres lie at integers in both pictures
    places = (sample.seen.pixel - [left, top] + 0.5) * scale - 0.5
    inside = np.all((places >= 0) & (places < out.shape[1::-1]), axis=1)
    for (x, y), slit in zip(np.round(places[inside] * 16).astype(int), sample.seen.slit[inside], strict=True):
        cv2.circle(out, (int(x), int(y)), round(dot_px * 16), DOTS[slit % len(DOTS)], -1, cv2.LINE_AA, 4)
    return out
