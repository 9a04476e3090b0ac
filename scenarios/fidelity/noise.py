"""The noise of `points`, measured: drawn pictures are decoded and held against where the slits truly lie."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.robust import MAD_TO_SIGMA
from scenarios.document import BadInput
from scenarios.provenance import versions
from scenarios.run_folder import whole_file
from scenarios.scenario import Scenario
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig
from sensor_model.streams import stream
from sensor_model.workers import spread

DENSE_AZIMUTHS = 7200
BESIDE_RAD = 0.002  # a decoded place is held against the true slit at its own angle in the picture, this near
STRAY_PX = 4.0  # what lies further off is no noise of a slit: a shadow's rim, or another slit
FEWEST = 200

Report = Callable[[str, int, int], None]


class SlitErrors(NamedTuple):
    """One slit in one picture: how far out of its true place each decoded place is, and what the decoder said, px."""

    error_px: Float[np.ndarray, "n"]
    sigma_px: Float[np.ndarray, "n"]
    lit: int
    """How many lines of the decoder cross the slit where it is lit."""


class Measured(NamedTuple):
    """The noise with what it rests on."""

    noise: PointNoise
    pictures: int
    places: int
    stray_share: float


def measure(scenario: Scenario, pictures: int, workers: int, progress: Report) -> Measured:
    """Draw pictures along a scenario's drive, decode them, and say with which noise `points` would be like them.

    Raises:
        BadInput: when a slit is hardly ever seen.
    """
    from twin.simulate import simulate

    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    times = np.linspace(truth.time_s[0], truth.time_s[-1], pictures + 2)[1:-1]
    jobs = [(scenario, pose, number) for number, pose in enumerate(truth.pose_at(times))]
    found: list[list[SlitErrors]] = []
    for done, errors in enumerate(spread(errors_of_picture, jobs, workers), start=1):
        progress("pictures", done, pictures)
        found.append(errors)
    slits = [_together(one) for one in zip(*found, strict=True)]
    for number, slit in enumerate(slits):
        if slit.error_px.size < FEWEST:
            raise BadInput(
                [f"slit {number}: seen at {slit.error_px.size} places in {pictures} pictures; {FEWEST} needed"]
            )
    near = [slit.error_px[np.abs(slit.error_px) < STRAY_PX] for slit in slits]
    places = sum(slit.error_px.size for slit in slits)
    strays = places - sum(errors.size for errors in near)
    bias = [float(np.median(errors)) for errors in near]
    noise = PointNoise(
        azimuths=scenario.method.decode.azimuths,
        slide_jag_deg=scenario.sensing.optics.slide_jag_deg,
        slide_jag_cells=scenario.sensing.optics.slide_jag_cells,
        slit_bias_px=tuple(round(b, 3) for b in bias),
        slit_noise_px=tuple(
            round(float(MAD_TO_SIGMA * np.median(np.abs(errors - b))), 3) for errors, b in zip(near, bias, strict=True)
        ),
        slit_drop_out_share=tuple(round(max(1 - slit.error_px.size / slit.lit, 0.0), 4) for slit in slits),
        slit_sigma_px=tuple(round(float(np.median(slit.sigma_px)), 3) for slit in slits),
    )
    return Measured(noise, pictures, places, strays / places)


def errors_of_picture(scenario: Scenario, T_pipe_camera: Float[np.ndarray, "4 4"], number: int) -> list[SlitErrors]:
    """Draw, expose and decode one picture, and hold every slit against its true places."""
    from algorithms.decode import decode
    from sensor_model.drawing import draw
    from sensor_model.focus import nearness_per_mm
    from sensor_model.image_formation import expose

    rig, optics = scenario.true_rig or scenario.rig, scenario.sensing.optics
    linear = draw(scenario.pipe, T_pipe_camera, rig, optics)
    nearness = nearness_per_mm(scenario.pipe, T_pipe_camera, rig.camera, optics)
    picture = expose(linear, optics, stream(scenario.seed, "picture", number), rig.camera, nearness)
    seen = decode(picture, rig, scenario.method.decode)
    clean = {
        "pixel_noise_px": 0.0,
        "drop_out_share": 0.0,
        "slide_jag_deg": optics.slide_jag_deg,
        "slide_jag_cells": optics.slide_jag_cells,
    }
    no_draws = np.random.default_rng(0)

    def exact(azimuths: int) -> SlitPixels:
        noise = PointNoise(azimuths=azimuths, **clean)
        return see_slits(scenario.pipe, T_pipe_camera, rig, noise, no_draws, optics.glass, optics.water)

    true, lit = exact(DENSE_AZIMUTHS), exact(scenario.method.decode.azimuths)
    return [_errors(seen, true, lit, slit, rig) for slit in range(len(rig.projector.slits))]


def _errors(seen: SlitPixels, true: SlitPixels, lit: SlitPixels, slit: int, rig: Rig) -> SlitErrors:
    from scipy.spatial import cKDTree

    own = seen.slit == slit
    count = int(np.count_nonzero(lit.slit == slit))
    radius, around = _polar(seen.pixel[own], rig)
    true_radius, true_around = _polar(true.pixel[true.slit == slit], rig)
    if not (radius.size and true_radius.size):
        return SlitErrors(np.zeros(0), np.zeros(0), count)
    apart, nearest = cKDTree(true_around).query(around)
    there = apart < BESIDE_RAD
    return SlitErrors((radius - true_radius[nearest])[there], seen.sigma_px[own][there], count)


def _polar(pixel: Float[np.ndarray, "n 2"], rig: Rig) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
    """Distance from the principal point, and direction as a point of the unit circle."""
    from_center = pixel - [rig.camera.cx_px, rig.camera.cy_px]
    radius = np.linalg.norm(from_center, axis=1)
    return radius, from_center / radius[:, None]


def _together(pictures: tuple[SlitErrors, ...]) -> SlitErrors:
    return SlitErrors(
        np.concatenate([one.error_px for one in pictures]),
        np.concatenate([one.sigma_px for one in pictures]),
        sum(one.lit for one in pictures),
    )


def write_noise(file: Path, found: Measured, scenario: Scenario) -> None:
    """Write the noise as a file that `sensing.points` takes, with where it comes from."""
    from io import StringIO

    from ruamel.yaml import YAML

    values = found.noise.model_dump(mode="json", exclude_defaults=True) | {"azimuths": found.noise.azimuths}
    text = StringIO()
    YAML(typ="safe", pure=True).dump(values, text)
    optics = scenario.sensing.optics.model_dump(mode="json", exclude_defaults=True)
    head = [
        f"The noise of `points` as measured on {date.today()} by pipetwin {versions()['pipetwin']} in {found.pictures}",
        f"drawn and decoded pictures of {scenario.name}, seed {scenario.seed}, at {found.places} places of its slits.",
        f"Optics: {optics or 'the default'}.",
        f"Not in it: {100 * found.stray_share:.2f} % of the places, over {STRAY_PX:g} px off, at rims of shadows.",
    ]
    with whole_file(file) as work:
        work.write_text("".join(f"# {line}\n" for line in head) + text.getvalue(), encoding="utf-8")
