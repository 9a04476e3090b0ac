"""Decoding: from a picture to the slits seen in it, each to a fraction of a pixel and by its colour code."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from numba import njit
from pydantic import Field

from algorithms.robust import MAD_TO_SIGMA
from sensor_model.geometry import fisheye_project
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig
from sensor_model.settings import Settings

MAX_SLITS_A_LINE = 24
REACH_WIDTHS = 1.6  # the bands beside a slit are looked at so many of its widths away
FLATTEN_PX = 32  # the slow rise of the light is the mean over so much either way
DOWNHILL_PX = 4
PLAIN_CONTRAST = 0.3  # a dip this deep is measured in the picture as it is
ROUGH_SIGMAS, ROUGH_LINES = 3.0, 3
COLOR_GAP_PX, COLOR_SPAN_PX = 3, 8  # a band's colour is read this far from a slit's edge, over this length
COLORS = "RYB"
# where the three colours lie to begin with, as shares of red and blue in the light (the real sensor's, roughly)
FIRST_CHROMA = np.array([[0.50, 0.23], [0.34, 0.31], [0.20, 0.47]])
CHROMA_ROUNDS, CHROMA_STRIDE = 4, 4  # of every fourth band
FAR_CHROMA = 0.5  # no colour of ours
LEAST_SHARE = 0.5  # of the neighbouring lines must carry a slit on
MOST_MISSED = 2  # lines on end
LEAST_BAND_SHARE = 0.15  # of the other band's light, beyond the slit's own
CARRY_PX, CARRY_GAIN = 6.0, 0.4
LEAST_COLOR_SHARE = 0.03  # of the bands must show each colour, or there is no code to read
SKIPPED_SLIT, SPARE_DIP, FOREIGN_COLOR = -2.0, -3.0, -8.0  # log scores
EDGE_FROM_MIDDLE_SHARE = 0.25  # a slit's edge lies about this share of the reach from its middle
SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16


class DecodeSettings(Settings):
    """Settings of the decoder: lines around the picture's centre, what counts as a dark slit, what supports it."""

    azimuths: Annotated[int, Field(ge=36, le=7200)] = 720
    reach_px: Annotated[int, Field(ge=4, le=60)] = 16
    widest_reach_px: Annotated[int, Field(ge=4, le=60)] = 30
    min_contrast: Annotated[float, Field(gt=0, lt=1)] = 0.05
    noise_sigmas: Annotated[float, Field(ge=0)] = 5.0
    min_width_px: Annotated[float, Field(ge=0)] = 2.5
    max_width_px: Annotated[float, Field(gt=0)] = 36.0
    width_ratio: Annotated[float, Field(gt=1)] = 1.4
    depth_share: Annotated[float, Field(ge=0, lt=1)] = 0.3
    pooled_lines: Annotated[int, Field(ge=0, le=60)] = 8
    support_lines: Annotated[int, Field(ge=0, le=20)] = 2
    support_px: Annotated[float, Field(gt=0)] = 3.0
    edge_std_px: Annotated[float, Field(ge=0)] = 0.15


class Dips(NamedTuple):
    """Dark places, so many on every line: radius, width, standard deviation, colours inside, outside and of the place.

    `start_rgb` is the colour in which each line begins, and the radius of that.
    """

    found: Int[np.ndarray, "lines"]
    radius_px: Float[np.ndarray, "lines most"]
    width_px: Float[np.ndarray, "lines most"]
    sigma_px: Float[np.ndarray, "lines most"]
    inside_rgb: Float[np.ndarray, "lines most 3"]
    outside_rgb: Float[np.ndarray, "lines most 3"]
    floor_rgb: Float[np.ndarray, "lines most 3"]
    start_rgb: Float[np.ndarray, "lines 4"]


class Limits(NamedTuple):
    """What the search for dips is held to: reach (px), contrast, depth and noise (levels), width (px)."""

    least_reach: int
    widest_reach: int
    min_contrast: float
    min_depth: float
    noise: float
    min_width: float
    max_width: float


def decode(picture: UInt8[np.ndarray, "height width 3"], rig: Rig, settings: DecodeSettings) -> SlitPixels:
    """Find the slits of one picture along lines that leave the principal point.

    Each line is resampled; its dark slits are located halfway between their two edges; the colours beside them, sorted
    into the frame's own three, spell the code; slits on a line are numbered by the best ordered match of colour pairs;
    what no neighbouring line supports is dropped.
    """
    lines = polar_lines(picture, rig, settings.azimuths)
    first = radial_range_px(rig)[0]
    dips = find_dips(lines, first, settings)
    colors = color_scores(dips, settings)
    slit = name_slits(dips, colors, rig)
    slit = usual(slit, dips, settings)
    radius_px = _by_line(slit, dips.radius_px, len(rig.projector.slits))
    jump_px = _jump_px(radius_px, settings.support_px)
    slit = _supported(slit, dips.radius_px, dips.found, settings.support_lines, jump_px)
    return _slit_pixels(dips, slit, _roughness_px(radius_px), rig, settings)


def radial_range_px(rig: Rig) -> tuple[int, int]:
    """First and last radius at which a slit can appear: no wall is so far that its ray is flatter than the cone."""
    flattest = rig.projector.slit_half_angles_rad[0] - np.radians(3.0)
    camera = rig.camera
    ray = np.array([0.0, np.sin(flattest), np.cos(flattest)])
    first = fisheye_project(ray, camera.intrinsics)[1] - camera.cy_px
    last = np.hypot(max(camera.cx_px, camera.width_px - camera.cx_px), 0.5 * camera.height_px)
    return int(first), int(last)


def directions(azimuths: int) -> Float[np.ndarray, "azimuths 2"]:
    """Direction of each line in the picture: from 12 o'clock, clockwise (u right, v down)."""
    angle = np.arange(azimuths) * 2 * np.pi / azimuths
    return np.stack([np.sin(angle), -np.cos(angle)], axis=1)


def polar_lines(
    picture: UInt8[np.ndarray, "height width 3"], rig: Rig, azimuths: int
) -> Float[np.ndarray, "azimuths radii 3"]:
    """The picture resampled along lines from the principal point, one pixel a step; NaN outside the picture."""
    first, last = radial_range_px(rig)
    return _polar(picture, rig.camera.cx_px, rig.camera.cy_px, directions(azimuths), first, last)


@njit(cache=True)
def _polar(picture, cx, cy, directions, first, last):
    """Bilinear samples with exact fractions (a library's fixed-point map errs by 1/64 px)."""
    height, width = picture.shape[0], picture.shape[1]
    out = np.full((directions.shape[0], last - first, 3), np.nan, dtype=np.float32)
    for k in range(directions.shape[0]):
        for i in range(last - first):
            u = cx + (first + i) * directions[k, 0]
            v = cy + (first + i) * directions[k, 1]
            left, top = int(np.floor(u)), int(np.floor(v))
            if left < 0 or top < 0 or left + 1 >= width or top + 1 >= height:
                break
            a, b = np.float32(u - left), np.float32(v - top)
            for c in range(3):
                upper = picture[top, left, c] + a * (np.float32(picture[top, left + 1, c]) - picture[top, left, c])
                lower = picture[top + 1, left, c] + a * (
                    np.float32(picture[top + 1, left + 1, c]) - picture[top + 1, left, c]
                )
                out[k, i, c] = upper + b * (lower - upper)
    return out


def find_dips(lines: Float[np.ndarray, "azimuths radii 3"], first_px: int, settings: DecodeSettings) -> Dips:
    """Dark slits on every line: local minima of brightness with a bright band on either side."""
    light = lines[..., 0] + lines[..., 1] + lines[..., 2]  # a sum over the short axis is ten times slower
    noise = pixel_noise(light)
    limits = Limits(
        settings.reach_px,
        max(settings.widest_reach_px, settings.reach_px),
        settings.min_contrast,
        settings.noise_sigmas * noise * float(np.sqrt(np.sum(SMOOTHING**2))),
        max(noise, 1.0),
        settings.min_width_px,
        settings.max_width_px,
    )
    return Dips(*_find_dips(lines, light, SMOOTHING.astype(np.float32), first_px, limits))


def pixel_noise(light: Float[np.ndarray, "azimuths radii"]) -> float:
    """Standard deviation of the noise of one sample, from second differences, which the slow picture hardly enters."""
    thin = light[::8]
    second = (thin[:, 2:] - 2 * thin[:, 1:-1] + thin[:, :-2])[:, ::2]
    second = second[np.isfinite(second)]
    return MAD_TO_SIGMA * float(np.median(np.abs(second))) / np.sqrt(6) if second.size else 0.0


@njit(cache=True)
def _find_dips(lines, light, smoothing, first_px, limits):
    least_reach, widest_reach, min_contrast, min_depth, noise, min_width, max_width = limits
    n_lines, n = light.shape
    count = np.zeros(n_lines, dtype=np.int64)
    radius = np.full((n_lines, MAX_SLITS_A_LINE), np.nan)
    widths = np.full((n_lines, MAX_SLITS_A_LINE), np.nan)
    sigma = np.full((n_lines, MAX_SLITS_A_LINE), np.nan)
    inside = np.zeros((n_lines, MAX_SLITS_A_LINE, 3))
    outside = np.zeros((n_lines, MAX_SLITS_A_LINE, 3))
    floor = np.zeros((n_lines, MAX_SLITS_A_LINE, 3))
    start = np.zeros((n_lines, 4))
    smooth = np.empty(n, dtype=np.float32)
    flat = np.empty(n, dtype=np.float32)
    sums = np.empty(n + 1)
    for k in range(n_lines):
        end = n
        while end > 0 and np.isnan(light[k, end - 1]):
            end -= 1
        for i in range(2, end - 2):
            smooth[i] = 0.0
            for j in range(5):
                smooth[i] += smoothing[j] * light[k, i + j - 2]
        _flatten(smooth, 2, end - 2, sums, flat)
        _mean_color(lines, k, 0, COLOR_SPAN_PX, start[k, :3])
        start[k, 3] = first_px + 0.5 * COLOR_SPAN_PX
        for i in range(2 + least_reach, end - 2 - least_reach):
            if count[k] == MAX_SLITS_A_LINE:
                break
            if flat[i] > flat[i - 1] or flat[i] >= flat[i + 1]:
                continue
            level = max((sums[min(i + 9, end - 2)] - sums[max(i - 8, 2)]) / 17, 1.0)
            least = max(min_depth / level, min_contrast)
            x_left, slope_left, x_right, slope_right = _edges(flat, i, least, 0.0, least_reach, widest_reach, end)
            if x_right <= x_left:
                continue
            # where the picture itself has a deep dip, that is measured as it is
            low = _downhill(smooth, i, end)
            plain = _edges(smooth, low, 0.0, PLAIN_CONTRAST, least_reach, widest_reach, end)
            deep = plain[2] > plain[0]
            if deep:
                x_left, slope_left, x_right, slope_right = plain
                slope_left, slope_right = slope_left / level, slope_right / level
            elif _below_chord(smooth, i, x_left, x_right, end) < 0.5 * least * level:
                continue
            width = x_right - x_left
            if not min_width <= width <= max_width:
                continue
            m = count[k]
            radius[k, m] = first_px + 0.5 * (x_left + x_right)
            widths[k, m] = width
            sigma[k, m] = 0.25 * noise / level * np.sqrt(1.0 / slope_left**2 + 1.0 / slope_right**2)
            _band_color(lines, smooth, k, i, int(np.ceil(x_left)), -1, end, deep, inside[k, m])
            _band_color(lines, smooth, k, i, int(np.floor(x_right)), 1, end, deep, outside[k, m])
            _mean_color(lines, k, i - 1, 3, floor[k, m])
            count[k] += 1
    return count, radius, widths, sigma, inside, outside, floor, start


@njit(cache=True)
def _flatten(smooth, first, last, sums, flat):
    """A profile over its mean around each place; `sums` are its running sums.

    Far from the projector the light of haze and wall climbs so steeply that a weak slit is a bend, not a dip.
    """
    sums[first] = 0.0
    for i in range(first, last):
        sums[i + 1] = sums[i] + smooth[i]
    for i in range(first, last):
        reach = min(FLATTEN_PX, i - first, last - 1 - i)
        around = (sums[i + reach + 1] - sums[i - reach]) / (2 * reach + 1)
        flat[i] = smooth[i] / max(around, 1.0)


@njit(cache=True)
def _below_chord(profile, i, x_left, x_right, end):
    """How far a place lies below the straight line between the bands beside it."""
    left, right = max(int(x_left) - COLOR_GAP_PX, 2), min(int(x_right) + 1 + COLOR_GAP_PX, end - 3)
    part = (i - left) / (right - left)
    return profile[left] + part * (profile[right] - profile[left]) - profile[i]


@njit(cache=True)
def _downhill(profile, i, end):
    """The nearest lowest place, at most a few steps away."""
    for _ in range(DOWNHILL_PX):
        if i > 3 and profile[i - 1] < profile[i]:
            i -= 1
        elif i < end - 4 and profile[i + 1] < profile[i]:
            i += 1
        else:
            break
    return i


@njit(cache=True)
def _edges(profile, i, least_depth, least_contrast, least_reach, widest_reach, end):
    """Left and right edge of a dip, each with its slope, judged by the bands beside it; both at 0 where it is none."""
    widest, here = min(widest_reach, i - 2, end - 3 - i), profile[i]
    left, right = _shoulder(profile, i, -1, widest), _shoulder(profile, i, 1, widest)
    if min(left, right) - here <= max(least_depth, least_contrast * min(left, right)):
        return 0.0, 1.0, 0.0, 1.0
    # the bands reach out as far as the dip is wide
    x_left, _ = _half_level(profile, i, -1, here, left, widest)
    x_right, _ = _half_level(profile, i, 1, here, right, widest)
    reach = min(max(int(REACH_WIDTHS * (x_right - x_left)), least_reach), widest)
    left, right = _shoulder(profile, i, -1, reach), _shoulder(profile, i, 1, reach)
    if min(left, right) - here <= max(least_depth, least_contrast * min(left, right)):
        return 0.0, 1.0, 0.0, 1.0
    left, right = _band_levels(profile, i, reach, left, right)
    x_left, slope_left = _half_level(profile, i, -1, here, left, reach)
    x_right, slope_right = _half_level(profile, i, 1, here, right, reach)
    return x_left, slope_left, x_right, slope_right


@njit(cache=True)
def _shoulder(smooth, i, way, reach):
    """The brightest place within reach, before the profile falls below where it starts."""
    highest = smooth[i]
    for j in range(1, reach + 1):
        if smooth[i + way * j] < smooth[i]:
            break
        highest = max(highest, smooth[i + way * j])
    return highest


@njit(cache=True)
def _band_levels(smooth, i, reach, highest_left, highest_right):
    """Brightness of the bands at the slit's own edges, on a straight line from what they are further out.

    Light fades along the pipe: the brightest place within reach lies further out on one side than on the other, and
    half of it would move the slit. Both bands fade alike, so that one slope serves both.
    """
    near, far = (5 * reach) // 8, reach
    half = (near + far) // 2
    levels = np.zeros(4)
    for j in range(near, far):
        k = 0 if j < half else 1
        levels[k] += smooth[i - j] / (half - near if k == 0 else far - half)
        levels[2 + k] += smooth[i + j] / (half - near if k == 0 else far - half)
    left, right = 0.5 * (levels[0] + levels[1]), 0.5 * (levels[2] + levels[3])
    here = smooth[i]
    if left - here < 0.7 * (highest_left - here) or right - here < 0.7 * (highest_right - here):
        return highest_left, highest_right  # another edge is near: there is no band to follow
    gap = 0.5 * (far - near)
    fade = 0.5 * ((levels[0] - levels[1]) / left + (levels[3] - levels[2]) / right) / gap
    move = 0.5 * (near + far - 1) - EDGE_FROM_MIDDLE_SHARE * reach
    edge_left, edge_right = left * (1.0 + fade * move), right * (1.0 - fade * move)
    if min((edge_left - here) / (left - here), (edge_right - here) / (right - here)) < 0.7:
        return highest_left, highest_right  # nor is a step in brightness a fading band
    return edge_left, edge_right


@njit(cache=True)
def _half_level(smooth, i, way, low, high, reach):
    """Where the profile has risen halfway from a minimum, and how steeply it rises there, in one direction."""
    level = 0.5 * (low + high)
    for j in range(1, reach + 1):
        a, b = smooth[i + way * (j - 1)], smooth[i + way * j]
        if b >= level:
            return i + way * (j - 1 + (level - a) / (b - a)), b - a
    return float(i + way * reach), 1e-3


@njit(cache=True)
def _band_color(lines, smooth, k, i, edge, way, end, deep, out):
    """Colour of the band beside a dip; of one that a shadow cuts short (it shows beside a deep dip), its middle."""
    first, last = COLOR_GAP_PX + 1, COLOR_GAP_PX + COLOR_SPAN_PX
    far = min(last, end - 3 - edge if way > 0 else edge - 2)
    if deep and far > 0:
        brightest, wide = smooth[i], 0
        for j in range(1, far + 1):
            brightest = max(brightest, smooth[edge + way * j])
        for j in range(1, far + 1):
            if 2.0 * smooth[edge + way * j] > smooth[i] + brightest:
                wide = j
            elif wide > 0:
                break
        if 0 < wide < far:
            first, last = max(wide // 2, 1), wide // 2 + 1
    _mean_color(lines, k, edge + first if way > 0 else edge - last, last - first + 1, out)


@njit(cache=True)
def _mean_color(lines, k, first, span, out):
    found = 0
    for i in range(max(first, 0), min(first + span, lines.shape[1])):
        if not np.isnan(lines[k, i, 0]):
            found += 1
            for c in range(3):
                out[c] += lines[k, i, c]
    for c in range(3):
        out[c] /= max(found, 1)


def _chroma(rgb: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
    """Shares of red and blue in a colour; a channel below nothing counts as none."""
    rgb = np.maximum(rgb, 0.0)
    total = np.maximum(rgb[..., 0] + rgb[..., 1] + rgb[..., 2], 1e-9)
    return np.stack([rgb[..., 0] / total, rgb[..., 2] / total], axis=-1)


def color_scores(dips: Dips, settings: DecodeSettings) -> Float[np.ndarray, "2 lines most 3"]:
    """Log score of each of the three colours, inside and outside of every dip.

    A band's colour is what it has beyond haze and light from the wall, whose level shows in the slits themselves; it
    is gathered along the slit, over so many lines either way. The three centres start where the sensor's colours are
    known to lie and move to the frame's own (k-means).
    """
    valid = np.isfinite(dips.radius_px)
    scores = np.zeros((2, *valid.shape, 3))
    rgb = np.stack([dips.inside_rgb, dips.floor_rgb, dips.outside_rgb])
    pooled, share = _along_slits(dips.found, dips.radius_px, rgb, settings.pooled_lines, CARRY_PX)
    bands = _beyond_floor(dips.found, dips.radius_px, dips.width_px, pooled, share >= LEAST_SHARE, dips.start_rgb)
    samples = np.concatenate([_chroma(bands[0][valid]), _chroma(bands[1][valid])])
    if samples.shape[0] == 0:
        return scores
    carried = np.tile(share[valid] >= LEAST_SHARE, 2)
    few = samples[carried][::CHROMA_STRIDE]
    centers, nearest = FIRST_CHROMA, np.zeros(0)
    for _ in range(CHROMA_ROUNDS):
        distances = _distances2(few, centers)
        nearest = np.where(distances.min(axis=1) < FAR_CHROMA**2, np.argmin(distances, axis=1), -1)
        centers = np.array(
            [np.median(few[nearest == c], axis=0) if (nearest == c).any() else centers[c] for c in range(3)]
        )
    if min(np.count_nonzero(nearest == c) for c in range(3)) < max(LEAST_COLOR_SHARE * nearest.size, 1):
        return np.full_like(scores, FOREIGN_COLOR)
    gap = min(float(np.sum((centers[a] - centers[b]) ** 2)) for a, b in ((0, 1), (0, 2), (1, 2)))
    score = -_distances2(samples, centers) / max(gap / 8, 1e-9)
    best = np.maximum(np.maximum(score[:, 0], score[:, 1]), score[:, 2])
    score = np.maximum(score - best[:, None], FOREIGN_COLOR)
    score[~carried | ~_lit(bands)[:, valid].ravel()] = FOREIGN_COLOR
    scores[:, valid] = score.reshape(2, -1, 3)
    return scores


def _lit(bands: Float[np.ndarray, "2 lines most 3"]) -> np.ndarray:
    """Whether each side of a dip is a band: the foot of the light's inner edge is dark on one side."""
    light = bands[..., 0] + bands[..., 1] + bands[..., 2]
    return light > LEAST_BAND_SHARE * light[::-1]


@njit(cache=True)
def _along_slits(count, radius, rgb, lines, tolerance):
    """Colours of each dip averaged over the dips that carry it on along the neighbouring lines; share of such lines."""
    n_lines, most = radius.shape
    pooled = np.zeros((3, n_lines, most, 3))
    share = np.ones((n_lines, most))
    for k in range(n_lines):
        for i in range(count[k]):
            for part in range(3):
                for c in range(3):
                    pooled[part, k, i, c] = rgb[part, k, i, c]
            found = 0
            for way in (-1, 1):
                at, missed = radius[k, i], 0
                for step in range(1, lines + 1):
                    other = (k + way * step) % n_lines
                    nearest, off = -1, tolerance
                    for j in range(count[other]):
                        if abs(radius[other, j] - at) <= off:
                            nearest, off = j, abs(radius[other, j] - at)
                    if nearest < 0:
                        missed += 1
                        if missed > MOST_MISSED:
                            break
                        continue
                    missed, found = 0, found + 1
                    at += CARRY_GAIN * (radius[other, nearest] - at)  # a jagged print jumps from line to line
                    for part in range(3):
                        for c in range(3):
                            pooled[part, k, i, c] += rgb[part, other, nearest, c]
            for part in range(3):
                for c in range(3):
                    pooled[part, k, i, c] /= found + 1
            if lines > 0:
                share[k, i] = found / (2.0 * lines)
    return pooled, share


@njit(cache=True)
def _beyond_floor(count, radius, width, pooled, anchor, start):
    """Colours inside and outside of each dip less the level between the floors of the dips that are slits."""
    n_lines, most = radius.shape
    bands = np.zeros((2, n_lines, most, 3))
    for k in range(n_lines):
        for i in range(count[k]):
            off = 0.5 * width[k, i] + COLOR_GAP_PX + 0.5 * COLOR_SPAN_PX
            before, after = i - 1, i + 1
            while before >= 0 and not anchor[k, before]:
                before -= 1
            while after < count[k] and not anchor[k, after]:
                after += 1
            for c in range(3):
                here = pooled[1, k, i, c]
                inner = pooled[1, k, before, c] if before >= 0 else start[k, c]
                gap = radius[k, i] - (radius[k, before] if before >= 0 else start[k, 3])
                bands[0, k, i, c] = pooled[0, k, i, c] - (here + (inner - here) * min(off / max(gap, 1.0), 1.0))
                level = here
                if after < count[k]:
                    step = (pooled[1, k, after, c] - here) / max(radius[k, after] - radius[k, i], 1.0)
                    level = here + step * min(off, radius[k, after] - radius[k, i])
                bands[1, k, i, c] = pooled[2, k, i, c] - level
    return bands


def _distances2(chroma: Float[np.ndarray, "n 2"], centers: Float[np.ndarray, "3 2"]) -> Float[np.ndarray, "n 3"]:
    """Squared distances written out: a sum over an axis of two is several times slower."""
    return (chroma[:, :1] - centers[:, 0]) ** 2 + (chroma[:, 1:] - centers[:, 1]) ** 2


def name_slits(dips: Dips, colors: Float[np.ndarray, "2 lines most 3"], rig: Rig) -> Int[np.ndarray, "lines most"]:
    """Which slit each dip is, -1 for none: the best match in order of the colour pairs on each line."""
    pairs = np.array([[COLORS.index(letter) for letter in slit.name] for slit in rig.projector.slits])
    return _name(dips.found, colors[0], colors[1], pairs)


@njit(cache=True)
def _name(count, inside, outside, pairs):
    """Ordered matching by dynamic programming, a line at a time; a slit may be hidden, a dip may be no slit."""
    n_lines, most = inside.shape[0], inside.shape[1]
    n_slits = pairs.shape[0]
    out = np.full((n_lines, most), -1, dtype=np.int64)
    best = np.empty((most + 1, n_slits + 1))
    came = np.empty((most + 1, n_slits + 1), dtype=np.int64)
    for k in range(n_lines):
        m = count[k]
        for i in range(m + 1):
            best[i, 0], came[i, 0] = i * SPARE_DIP, 1
        for j in range(n_slits + 1):
            best[0, j], came[0, j] = j * SKIPPED_SLIT, 2
        for i in range(1, m + 1):
            for j in range(1, n_slits + 1):
                best[i, j], came[i, j] = best[i - 1, j] + SPARE_DIP, 1
                if best[i, j - 1] + SKIPPED_SLIT > best[i, j]:
                    best[i, j], came[i, j] = best[i, j - 1] + SKIPPED_SLIT, 2
                taken = inside[k, i - 1, pairs[j - 1, 0]] + outside[k, i - 1, pairs[j - 1, 1]]
                if best[i - 1, j - 1] + taken > best[i, j]:
                    best[i, j], came[i, j] = best[i - 1, j - 1] + taken, 0
        i, j = m, n_slits
        while i > 0 and j > 0:
            if came[i, j] == 0:
                out[k, i - 1] = j - 1
                i, j = i - 1, j - 1
            elif came[i, j] == 1:
                i -= 1
            else:
                j -= 1
    return out


def usual(slit: Int[np.ndarray, "lines most"], dips: Dips, settings: DecodeSettings) -> Int[np.ndarray, "lines most"]:
    """Drop what is no slit by its look: the shadow that a defect's rim throws.

    It is much wider, narrower or shallower than the same slit elsewhere; how much is seen from the slit itself, where
    its print is rough or the light weak.
    """
    line, place = np.nonzero(slit >= 0)
    which = slit[line, place]
    off_width = np.log(dips.width_px[line, place])
    depth = _depth(dips, line, place)
    out = slit.copy()
    for j in range(int(slit.max(initial=-1)) + 1):
        mine = which == j
        if not mine.any():
            continue
        wide = np.abs(off_width[mine] - np.median(off_width[mine]))
        shallow = np.median(depth[mine]) - depth[mine]
        most_wide = max(np.log(settings.width_ratio), ROUGH_SIGMAS * MAD_TO_SIGMA * np.median(wide))
        most_shallow = max(
            (1 - settings.depth_share) * np.median(depth[mine]),
            ROUGH_SIGMAS * MAD_TO_SIGMA * np.median(np.abs(shallow)),
        )
        out[line[mine], place[mine]] = np.where((wide > most_wide) | (shallow > most_shallow), -1, j)
    return out


def _depth(dips: Dips, line: Int[np.ndarray, "n"], place: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """How much darker each dip is than the darker of the bands beside it, as a share of that."""
    floor, inside, outside = (
        rgb[line, place, 0] + rgb[line, place, 1] + rgb[line, place, 2]
        for rgb in (dips.floor_rgb, dips.inside_rgb, dips.outside_rgb)
    )
    return 1.0 - floor / np.maximum(np.minimum(inside, outside), 1.0)


def _by_line(
    slit: Int[np.ndarray, "lines most"], radius_px: np.ndarray, slits: int
) -> Float[np.ndarray, "slits lines"]:
    """Where each slit was seen on each line, px from the picture's centre; NaN where it was not."""
    line, place = np.nonzero(slit >= 0)
    out = np.full((slits, len(slit)), np.nan)
    out[slit[line, place], line] = radius_px[line, place]
    return out


def _spread_of(change: Float[np.ndarray, "slits n"]) -> Float[np.ndarray, "slits"]:
    """Robust standard deviation of each row's known values; 0 of a row without."""
    known = [row[np.isfinite(row)] for row in change]
    return np.array([MAD_TO_SIGMA * float(np.median(np.abs(row))) if row.size else 0.0 for row in known])


def _jump_px(radius_px: Float[np.ndarray, "slits lines"], least_px: float) -> Float[np.ndarray, "slits"]:
    """How far each slit may move from line to line: as far as its own roughness makes it."""
    return np.maximum(ROUGH_SIGMAS * _spread_of(np.diff(radius_px)), least_px)


def _roughness_px(radius_px: Float[np.ndarray, "slits lines"]) -> Float[np.ndarray, "slits"]:
    """How far each slit's places scatter about those some lines to either side: noise and the slide's print alike."""
    beside = 0.5 * (np.roll(radius_px, ROUGH_LINES, axis=1) + np.roll(radius_px, -ROUGH_LINES, axis=1))
    return _spread_of(radius_px - beside) / np.sqrt(1.5)


@njit(cache=True)
def _supported(slit, radius, count, lines, tolerance):
    """Keep what at least two of the nearest lines on either side show too, at nearly the same radius."""
    n_lines, most = slit.shape
    out = np.full((n_lines, most), -1, dtype=np.int64)
    needed = min(2, lines)
    for k in range(n_lines):
        for i in range(count[k]):
            if slit[k, i] < 0:
                continue
            support = 0
            for step in range(-lines, lines + 1):
                other = (k + step) % n_lines
                if step == 0:
                    continue
                reach = tolerance[slit[k, i]] * abs(step)
                for j in range(count[other]):
                    if slit[other, j] == slit[k, i] and abs(radius[other, j] - radius[k, i]) <= reach:
                        support += 1
                        break
            if support >= needed:
                out[k, i] = slit[k, i]
    return out


def _slit_pixels(
    dips: Dips,
    slit: Int[np.ndarray, "lines most"],
    roughness_px: Float[np.ndarray, "slits"],
    rig: Rig,
    settings: DecodeSettings,
) -> SlitPixels:
    line, place = np.nonzero(slit >= 0)
    order = np.lexsort((line, slit[line, place]))
    line, place = line[order], place[order]
    which, own = slit[line, place], dips.sigma_px[line, place]
    along = directions(settings.azimuths)[line]
    pixel = np.array([rig.camera.cx_px, rig.camera.cy_px]) + dips.radius_px[line, place, None] * along
    # the slide's print is as rough as the slit looks beyond the picture's noise, and never quite clean
    usual_own = np.array([np.median(own[which == j]) if (which == j).any() else 0.0 for j in range(roughness_px.size)])
    print2 = np.maximum(roughness_px**2 - usual_own**2, settings.edge_std_px**2)
    return SlitPixels(pixel, which, np.sqrt(own**2 + print2[which]))
