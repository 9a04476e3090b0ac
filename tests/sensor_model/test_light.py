"""Walls, dirt, daylight and the camera's processing: each does what it says, and its zero nothing."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from scenarios.load import load_scenario
from sensor_model import drawing, raycast
from sensor_model.daylight import Daylight, daylight
from sensor_model.dirt import Dirt, seen_through
from sensor_model.image_formation import expose
from sensor_model.optics import Optics, WallFinish
from sensor_model.processing import Processing, processed
from sensor_model.rig import preset_rig
from twin.features.pocket import Pocket
from twin.pipe import Pipe

SMALL_CAMERA = {"width_px": 416, "height_px": 308, "fx_px": 147.2, "fy_px": 147.1, "skew_px": 0.17}
CAMERA = preset_rig().camera.model_copy(update={**SMALL_CAMERA, "cx_px": 204.1, "cy_px": 152.0})
SMALL = preset_rig().model_copy(update={"camera": CAMERA})
POCKET = Pocket(distance_mm=125, clock_deg=120, depth_mm=7.5, length_mm=70, width_mm=35)
CARVED = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=(POCKET,))
WAYS = {"picture": drawing.draw, "raycast": raycast.draw}


def rings() -> np.ndarray:
    return raycast.draw(CARVED, np.eye(4), SMALL, Optics())


@pytest.mark.parametrize("wall", ["white-pvc", "yellow-pe", "black-pe", "tan-pe"])
def test_a_wall_by_its_name_is_drawn_alike_both_ways(wall: str) -> None:
    optics = load_scenario("paper-gantry", [f"sensing.optics.wall={wall}"]).sensing.optics
    drawn, cast = (draw(CARVED, np.eye(4), SMALL, optics) for draw in WAYS.values())
    assert np.sqrt(np.mean((drawn - cast) ** 2)) < 0.012
    plain = raycast.draw(CARVED, np.eye(4), SMALL, Optics(wall_reflectance=optics.wall_reflectance))
    assert optics.wall_reflectance != Optics().wall_reflectance
    assert np.sqrt(np.mean((plain - cast) ** 2)) > 1e-4


def test_an_unknown_wall_is_named() -> None:
    with pytest.raises(ValidationError, match="no wall is called 'brick'; there are black-pe"):
        Optics(wall="brick")  # type: ignore[arg-type]


@pytest.mark.parametrize("way", WAYS)
def test_gloss_shines_where_a_slope_faces_back_and_not_on_the_bare_wall(way: str) -> None:
    matt, glossy = (WAYS[way](CARVED, np.eye(4), SMALL, Optics(wall=WallFinish(gloss=g))) for g in (0.0, 0.04))
    more = (glossy - matt).sum(axis=2)
    v, u = np.mgrid[:308, :416]
    beside = np.abs(np.degrees(np.arctan2(u - 204.1, 152.0 - v)) - 120) > 40
    assert more.max() > 0.05
    assert more[beside].max() < 0.02
    assert more.min() > -1e-6


@pytest.mark.parametrize("way", WAYS)
def test_translucency_softens_the_slits_and_keeps_the_light(way: str) -> None:
    hard, soft = (
        WAYS[way](Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5), np.eye(4), preset_rig(), Optics(wall=finish))
        for finish in (WallFinish(), WallFinish(translucency=0.5, translucency_mm=1.0))
    )
    assert soft.sum() == pytest.approx(hard.sum(), rel=0.01)
    assert np.abs(np.diff(soft, axis=1)).max() < 0.8 * np.abs(np.diff(hard, axis=1)).max()


def test_drops_cover_their_share_and_a_smudge_its_sector() -> None:
    sharp = np.random.default_rng(0).random((308, 416, 3), dtype=np.float32)
    changed = np.abs(seen_through(sharp, Dirt(drops=0.3), CAMERA) - sharp).max(axis=2) > 0.05
    assert changed.mean() == pytest.approx(0.3, abs=0.12)
    smudged = np.abs(seen_through(sharp, Dirt(smudge=0.9, smudge_clock_deg=90), CAMERA) - sharp).max(axis=2) > 0.05
    assert smudged[152, 300:].mean() > 0.9
    assert not smudged[:, :200].any()
    assert seen_through(sharp, Dirt(), CAMERA) is not None
    np.testing.assert_array_equal(seen_through(sharp, Dirt(), CAMERA), sharp)


def test_a_dust_film_takes_contrast() -> None:
    def contrast(film: float) -> float:
        optics = Optics(dirt=Dirt(film=film)).noiseless().model_copy(update={"gamma": 1.0})
        stored = expose(rings(), optics, np.random.default_rng(0), CAMERA).astype(float)
        return float(stored[152, 204:].std())

    assert contrast(0.5) < 0.75 * contrast(0.0)


def test_daylight_fades_into_the_pipe_as_the_form_factor_of_its_end() -> None:
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, end_mm=300)
    picture = daylight(pipe, np.eye(4), CAMERA, (0.5, 0.5, 0.5), Daylight(level=0.8), 0.0)
    assert picture[152, 204] == pytest.approx(0.8)  # straight out
    # by many rays from a place on the wall: the share, weighed by its cosine, that leaves by the end
    rng, inward = np.random.default_rng(0), 150.0
    sine2, turn = rng.random(200_000), rng.uniform(0, 2 * np.pi, 200_000)
    out, across, along = np.sqrt(1 - sine2), np.sqrt(sine2) * np.cos(turn), np.sqrt(sine2) * np.sin(turn)
    reach = 2 * 76.2 * out / (out**2 + across**2)
    share = np.mean((reach * along > inward) & (along > 0))
    column = 204 + np.flatnonzero(picture[152, 204:, 0] < 0.5)
    rays = raycast.camera_rays(CAMERA)[152, column].astype(float)
    there = np.argmin(np.abs(300 - 76.2 * rays[:, 2] / np.hypot(rays[:, 0], rays[:, 1]) - inward))
    assert picture[152, column[there], 0] == pytest.approx(0.8 * 0.5 * share, rel=0.1)


def test_a_flickering_lamp_draws_bands_across_the_rows() -> None:
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, end_mm=150)
    how = Daylight(level=0.8, flicker=0.5, flicker_hz=100, row_us=65)
    steady, banded = (
        daylight(pipe, np.eye(4), CAMERA, (0.5, 0.5, 0.5), one, 0.0)[:, 204, 0]
        for one in (how.model_copy(update={"flicker": 0.0}), how)
    )
    np.testing.assert_allclose(banded / steady, 1 + 0.5 * np.sin(2 * np.pi * 100 * np.arange(308) * 65e-6), rtol=1e-5)


def test_processing_leaves_grey_alone_and_sharpens_edges() -> None:
    grey = np.full((308, 416, 3), 90, dtype=np.uint8)
    every = Processing(color_filter=True, denoise_levels=20, sharpen=1.0, jpeg_quality=90)
    assert np.abs(processed(grey, every).astype(int) - 90).max() <= 1
    stored = expose(rings(), Optics(), np.random.default_rng(0), CAMERA)
    assert processed(stored, Processing()) is stored
    assert processed(stored, Processing(sharpen=1.0)).astype(float).std() > stored.astype(float).std()
    noisy = np.clip(90 + 5 * np.random.default_rng(0).standard_normal(grey.shape), 0, 255).astype(np.uint8)
    assert processed(noisy, Processing(denoise_levels=30)).std() < 0.6 * noisy.std()
    worse, better = (
        np.abs(processed(stored, Processing(jpeg_quality=q)).astype(int) - stored).mean() for q in (20, 90)
    )
    assert worse > better > 0


def test_a_brighter_lamp_is_brighter_and_no_more() -> None:
    np.testing.assert_allclose(raycast.draw(CARVED, np.eye(4), SMALL, Optics(lamp_level=2.0)), 2 * rings(), rtol=1e-5)
