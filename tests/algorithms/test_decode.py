"""The decoder finds slits to a fraction of a pixel, names them right, and keeps shadows and noise out."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.decode import decode
from algorithms.decoding import colors, dips, lines, words
from algorithms.decoding.settings import DecodeSettings
from algorithms.triangulate import triangulate
from scenarios.score import true_slits
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.raycast import draw
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

RIG = preset_rig()
POCKET = {"kind": "pocket", "distance_mm": 120, "clock_deg": 120, "length_mm": 70, "width_mm": 35, "depth_mm": 7.5}
CLEAN = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
CARVED = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=[POCKET])
POSE = np.eye(4)
POSE[:3, 3] = 4, -3, 0


def _picture(pipe, optics):
    return expose(draw(pipe, POSE, RIG, optics), optics, np.random.default_rng(0), RIG.camera)


@pytest.fixture(scope="module")
def noisy():
    return _picture(CARVED, Optics())


def _radial_error(seen, pipe):
    points = triangulate(seen, RIG)
    wall = points.xyz_mm @ POSE[:3, :3].T + POSE[:3, 3]
    theta = np.arctan2(wall[:, 0], -wall[:, 1])
    return points, np.hypot(wall[:, 0], wall[:, 1]) - pipe.radius(theta, wall[:, 2])


def test_a_clean_picture_gives_the_wall_to_hundredths_of_a_millimetre():
    optics = Optics.ideal()
    seen = decode(_picture(CLEAN, optics), RIG, DecodeSettings())
    points, error = _radial_error(seen, CLEAN)
    assert set(points.ring) == set(range(8))
    for ring in range(8):
        assert abs(error[points.ring == ring].mean()) < 0.02
    strut = 37 / 360
    assert points.sigma_mm.size > 0.97 * 720 * 8 * (1 - strut)


def test_fading_light_does_not_move_the_slits():
    optics = Optics(slide_jag_deg=0.0).noiseless()
    seen = decode(_picture(CLEAN, optics), RIG, DecodeSettings())
    points, error = _radial_error(seen, CLEAN)
    for ring in range(8):
        assert abs(error[points.ring == ring].mean()) < 0.06


def test_frames_are_looked_at_along_lines_that_turn_and_see_the_same_wall():
    picture = _picture(CLEAN, Optics.ideal())
    seen = [decode(picture, RIG, DecodeSettings(), index) for index in (0, 5)]
    turns = []
    for one in seen:
        x, y = (one.pixel - [RIG.camera.cx_px, RIG.camera.cy_px]).T
        steps = np.degrees(np.arctan2(x, -y)) / 0.5
        turns.append(np.median(steps % 1))
        assert np.abs((steps - turns[-1] + 0.5) % 1 - 0.5).max() < 1e-6
        assert abs(_radial_error(one, CLEAN)[1].mean()) < 0.02
    assert turns == pytest.approx([0.0, 5 * 8 / 13 % 1], abs=1e-6)
    assert abs(seen[0].slit.size - seen[1].slit.size) < 0.005 * seen[0].slit.size


def test_words_are_right_past_a_deep_pocket(noisy):
    seen = decode(noisy, RIG, DecodeSettings())
    assert np.mean(true_slits(CARVED, RIG, seen.pixel, POSE) != seen.slit) < 0.005
    assert np.array_equal(np.unique(seen.slit), np.arange(8))
    outside = np.abs((np.degrees(np.arctan2(seen.pixel[:, 0] - 817.866, 609.376 - seen.pixel[:, 1])) + 180) % 360 - 180)
    assert (outside > 15).all()  # nothing in the strut's sector


def test_compiled_resampling_agrees_with_a_library(noisy):
    import cv2

    ours = lines.polar_lines(noisy, RIG, lines.directions(90)).rgb
    first, last = lines.radial_range_px(RIG)
    along = lines.directions(90)[:, None, :] * np.arange(first, last)[None, :, None]
    x, y = (RIG.camera.cx_px + along[..., 0]).astype(np.float32), (RIG.camera.cy_px + along[..., 1]).astype(np.float32)
    theirs = cv2.remap(noisy, x, y, cv2.INTER_LINEAR).astype(float)
    inside = np.isfinite(ours[..., 0])
    assert inside.mean() > 0.6
    # the library rounds places to 1/32 px and values to whole numbers
    assert np.abs(ours - theirs)[inside].mean() < 1.0


def test_matching_by_colour_agrees_with_trying_everything():
    from itertools import combinations

    rng = np.random.default_rng(0)
    pairs = np.array([[words.COLORS.index(c) for c in slit.name] for slit in RIG.projector.slits])
    for _ in range(20):
        n = int(rng.integers(1, 5))
        scores = -rng.uniform(0, 6, size=(2, 1, n, 3))
        found = words._name(np.array([n]), scores[0], scores[1], pairs)[0]

        def total(dips, slits, scores=scores, n=n):
            taken = sum(
                scores[0, 0, i, pairs[j, 0]] + scores[1, 0, i, pairs[j, 1]] for i, j in zip(dips, slits, strict=True)
            )
            return taken + words.SPARE_DIP * (n - len(dips)) + words.SKIPPED_SLIT * (8 - len(slits))

        best = max(
            total(dips, slits)
            for k in range(n + 1)
            for dips in combinations(range(n), k)
            for slits in combinations(range(8), k)
        )
        chosen = np.flatnonzero(found >= 0)
        assert total(tuple(chosen), tuple(found[chosen])) == pytest.approx(best)


def test_every_slit_states_how_far_its_points_scatter(noisy):
    seen = decode(noisy, RIG, DecodeSettings())
    points, error = _radial_error(seen, CARVED)
    right = true_slits(CARVED, RIG, seen.pixel, POSE) == seen.slit
    for ring in range(8):
        mine = (points.ring == ring) & right
        half_rad = RIG.projector.slit_half_angles_rad[ring]
        # a point slides along its light ray, of which the radius is the sine
        stated = np.median(points.sigma_mm[mine]) * np.sin(half_rad)
        found = 1.4826 * np.median(np.abs(error[mine] - np.median(error[mine])))
        assert 0.7 < found / stated < 1.4


def test_a_slit_before_a_rim_keeps_its_colour_where_its_band_is_cut_short():
    brightness = np.full(400, 200.0)
    brightness[200:211] = 100.0  # the slit
    brightness[170:195] = 90.0  # the shadow: five pixels of band are left
    rgb = np.stack([brightness, 0.5 * brightness, 0.4 * brightness], axis=-1)
    rgb[170:195] = 30.0  # and what it shows has another colour
    picture = lines.Lines(*(np.tile(part, (16,) + (1,) * part.ndim).astype(np.float32) for part in (rgb, rgb.sum(1))))
    found = dips.find_dips(picture, 0, DecodeSettings())
    slit = np.nanargmin(np.abs(found.radius_px[5] - 205))
    assert abs(found.radius_px[5, slit] - 205) < 0.6
    red, green, blue = found.rgb[5, slit, 0]
    assert [red / (red + green + blue), blue / (red + green + blue)] == pytest.approx([0.526, 0.211], abs=0.02)


def test_a_slit_that_a_rim_splits_is_dropped_and_one_with_a_rough_print_is_not():
    settings, rng = DecodeSettings(), np.random.default_rng(0)
    width = 14.0 + rng.uniform(-4, 4, 720)  # a rough print: no line is like the next
    width[300:350] += 9.0  # the shadow at the rim, where the slit is on both sides of it
    one = np.zeros((720, 1))
    found = dips.Dips(
        np.ones(720, int), one + 250, width[:, None], one + 0.2, np.zeros((720, 1, 3, 3)), np.zeros((720, 4))
    )
    slit = words.whole(np.zeros((720, 1), int), found, 8, settings)[:, 0]
    assert (slit[308:342] == -1).all()
    assert (slit[:292] == 0).all()
    assert (slit[358:] == 0).all()


def test_compiled_flattening_agrees_with_plain_means():
    rng = np.random.default_rng(0)
    smooth = rng.uniform(1, 300, 200).astype(np.float32)
    flat, sums = np.empty(200, np.float32), np.empty(201)
    dips._flatten(smooth, 2, 190, sums, flat)
    for i in range(2, 190):
        reach = min(dips.FLATTEN_PX, i - 2, 189 - i)
        assert flat[i] == pytest.approx(smooth[i] / smooth[i - reach : i + reach + 1].mean(), rel=1e-5)


def test_compiled_search_for_low_places_agrees_with_looking_both_ways_from_each():
    rng = np.random.default_rng(0)
    for _ in range(20):
        profile = np.cumsum(rng.standard_normal(200))
        out = np.empty(200, dtype=np.int64)
        found = out[: dips._lowest_places(profile, 2, 198, 1.5, out)]

        def higher(beside, here):  # before it falls below where it starts
            below = np.flatnonzero(beside < here)
            return beside[: below[0] if below.size else None].max(initial=here) > here + 1.5

        low = [
            i for i in range(2, 198) if all(higher(b, profile[i]) for b in (profile[2:i][::-1], profile[i + 1 : 198]))
        ]
        assert found.tolist() == low


def test_compiled_choice_of_unusual_places_agrees_with_plain_medians():
    rng = np.random.default_rng(0)
    which = rng.choice([0, 1, 3, 4], 400)
    log_width, depth = 0.1 * rng.standard_t(2, 400), 0.4 + 0.05 * rng.standard_t(2, 400)
    found = words._unusual(which, log_width, depth, 0.3, 0.7)
    for j in (0, 1, 3, 4):
        mine = which == j
        wide = np.abs(log_width[mine] - np.median(log_width[mine]))
        shallow = np.median(depth[mine]) - depth[mine]
        wide_out = wide > max(0.3, 3 * 1.4826 * np.median(wide))
        shallow_out = shallow > max(0.7 * np.median(depth[mine]), 3 * 1.4826 * np.median(np.abs(shallow)))
        assert np.array_equal(found[mine], wide_out | shallow_out)
        assert 0 < np.count_nonzero(found[mine]) < 0.3 * np.count_nonzero(mine)


def test_compiled_gathering_along_slits_agrees_with_a_plain_walk(noisy):
    found = dips.find_dips(lines.polar_lines(noisy, RIG, lines.directions(180)), 0, DecodeSettings())
    pooled, share = colors._along_slits(found.found, found.radius_px, found.rgb, 4, colors.CARRY_PX)
    for k in range(0, 180, 17):
        for i in range(found.found[k]):
            gathered = [(k, i)]
            for way in (-1, 1):
                at, missed = found.radius_px[k, i], 0
                for step in range(1, 5):
                    other = (k + way * step) % 180
                    off = np.abs(found.radius_px[other] - at)
                    if not (off <= colors.CARRY_PX).any():
                        missed += 1
                        if missed > colors.MOST_MISSED:
                            break
                        continue
                    missed, nearest = 0, int(np.nanargmin(off))
                    at += colors.CARRY_GAIN * (found.radius_px[other, nearest] - at)
                    gathered.append((other, nearest))
            assert share[k, i] == pytest.approx((len(gathered) - 1) / 8)
            assert pooled[k, i] == pytest.approx(np.mean([found.rgb[a, b] for a, b in gathered], axis=0))


def _chroma_as(bands, levels, center):
    """The compiled step in plain array words."""
    share = np.array([center[0], 1 - center.sum(), center[1]])
    clipped, lit = levels > colors.CLIPPED_LEVEL, np.maximum(bands, 0)
    known = np.where(clipped, 0, lit).sum(axis=1) / np.maximum(np.where(clipped, 0, share).sum(axis=1), 1e-9)
    whole = np.where(clipped, np.maximum(lit, known[:, None] * share), lit)
    whole[clipped.all(axis=1)] = share
    return whole[:, ::2] / whole.sum(axis=1, keepdims=True)


def test_compiled_comparing_of_colours_agrees_with_plain_arrays():
    rng = np.random.default_rng(0)
    bands = rng.uniform(-5, 200, (300, 3))
    levels = bands + rng.uniform(20, 100, (300, 3))
    centers = colors.WHITE_WALL_CHROMA
    chroma, off2 = colors._compared(bands, levels, centers)
    for c in range(3):
        plain = _chroma_as(bands, levels, centers[c])
        assert np.allclose(chroma[:, c].T, plain)
        assert off2[:, c] == pytest.approx(((plain - centers[c]) ** 2).sum(axis=1))


def test_compiled_scores_agree_with_plain_arrays(noisy):
    found = dips.find_dips(lines.polar_lines(noisy, RIG, lines.directions(180)), 0, DecodeSettings())
    pooled, share = colors._along_slits(found.found, found.radius_px, found.rgb, 4, colors.CARRY_PX)
    anchor = share >= colors.LEAST_SHARE
    bands = colors._beyond_floor(found.found, found.radius_px, found.width_px, pooled, anchor, found.start_rgb)
    scores = colors._scores(found.found, bands, pooled, share, colors.WHITE_WALL_CHROMA, 60.0)
    a, b = np.array([[0, 0, 1], [1, 2, 2]])
    centers = colors.WHITE_WALL_CHROMA
    gap2 = ((centers[a] - centers[b]) ** 2).sum(axis=1).min()
    light = bands.sum(axis=-1)
    for side in range(2):
        band = anchor & (light[side] > colors.LEAST_BAND_SHARE * light[1 - side])
        mine, level = bands[side][band], pooled[:, :, 2 * side][band]
        off2 = np.stack([((_chroma_as(mine, level, one) - one) ** 2).sum(axis=1) for one in centers], axis=1)
        score = np.maximum((off2.min(axis=1, keepdims=True) - off2) / (gap2 / 8), colors.FOREIGN_COLOR)
        weak = colors.WEAK_SCORE * np.log(np.clip(light[side][band] / 60.0, colors.WEAKEST, 1))
        assert scores[side][band] == pytest.approx(score + weak[:, None])
        assert (scores[side][~band] == colors.FOREIGN_COLOR).all()


@pytest.mark.parametrize("optics", [{"wall": "yellow-pe"}, {"wall": "yellow-pe", "exposure": 4.2}, {"exposure": 4.2}])
def test_words_are_right_on_a_wall_that_takes_the_blue_and_in_a_picture_exposed_too_long(optics):
    seen = decode(_picture(CARVED, Optics.model_validate(optics)), RIG, DecodeSettings())
    assert np.mean(true_slits(CARVED, RIG, seen.pixel, POSE) != seen.slit) < 0.01
    assert seen.slit.size > 0.85 * 720 * 8


def test_a_wall_of_any_colour_shows_the_three_colours():
    white = np.column_stack([colors.WHITE_WALL_CHROMA, 1 - colors.WHITE_WALL_CHROMA.sum(axis=1)])[:, [0, 2, 1]]
    rng = np.random.default_rng(0)
    letters = np.repeat(np.arange(3), (60, 50, 50))
    for wall in ([1, 1, 1], [0.8, 0.6, 0.12], [0.2, 0.5, 0.9], [0.3, 0.9, 0.3], [0.9, 0.3, 0.2]):
        seen = white[letters] * wall * rng.uniform(60, 200, (160, 1)) + rng.normal(0, 1, (160, 3))
        true = white * wall
        true = true[:, ::2] / true.sum(axis=1, keepdims=True)
        assert colors.frame_colors(seen, seen) == pytest.approx(true, abs=0.01)
    assert colors.frame_colors(np.repeat(white[:1] * 100, 50, axis=0), np.full((50, 3), 100.0)) is None


@pytest.mark.parametrize("kind", ["black", "white", "noise"])
def test_a_picture_without_rings_gives_no_points(kind):
    shape = (RIG.camera.height_px, RIG.camera.width_px, 3)
    picture = {
        "black": np.zeros(shape, np.uint8),
        "white": np.full(shape, 255, np.uint8),
        "noise": np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8),
    }[kind]
    seen = decode(picture, RIG, DecodeSettings())
    assert seen.slit.size < 0.02 * 720 * 8
