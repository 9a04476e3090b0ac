"""Dark places on every line: local minima of brightness with a bright band on either side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from algorithms.decoding.lines import Lines, pixel_noise
from algorithms.decoding.settings import DecodeSettings

MAX_SLITS_A_LINE = 24
REACH_WIDTHS = 1.6  # the bands beside a slit are looked at so many of its widths away
FLATTEN_PX = 32  # the slow rise of the light is the mean over so much either way
DOWNHILL_PX = 4
PLAIN_CONTRAST = 0.3  # a dip this deep is measured in the picture as it is
COLOR_GAP_PX, COLOR_SPAN_PX = 3, 8  # a band's colour is read this far from a slit's edge, over this length
EDGE_FROM_MIDDLE_SHARE = 0.25  # a slit's edge lies about this share of the reach from its middle
SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16


class Dips(NamedTuple):
    """Dark places, so many on every line, by radius: width, standard deviation, colours inside, of the place, outside.

    `start_rgb` is the colour in which each line begins, and the radius of that.
    """

    found: Int[np.ndarray, "lines"]
    radius_px: Float[np.ndarray, "lines most"]
    width_px: Float[np.ndarray, "lines most"]
    sigma_px: Float[np.ndarray, "lines most"]
    rgb: Float[np.ndarray, "lines most 3 3"]
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


def find_dips(lines: Lines, first_px: int, settings: DecodeSettings) -> Dips:
    """Dark slits on every line; `first_px` is the radius at which the lines begin."""
    noise = pixel_noise(lines.light)
    limits = Limits(
        settings.reach_px,
        max(settings.widest_reach_px, settings.reach_px),
        settings.min_contrast,
        settings.noise_sigmas * noise * float(np.sqrt(np.sum(SMOOTHING**2))),
        max(noise, 1.0),
        settings.min_width_px,
        settings.max_width_px,
    )
    return Dips(*_find_dips(lines.rgb, lines.light, SMOOTHING.astype(np.float32), first_px, limits))


@njit(cache=True, error_model="numpy")
def _find_dips(lines, light, smoothing, first_px, limits):
    least_reach, widest_reach, min_contrast, min_depth, noise, min_width, max_width = limits
    n_lines, n = light.shape
    count = np.zeros(n_lines, dtype=np.int64)
    radius = np.full((n_lines, MAX_SLITS_A_LINE), np.nan)
    widths = np.full((n_lines, MAX_SLITS_A_LINE), np.nan)
    sigma = np.full((n_lines, MAX_SLITS_A_LINE), np.nan)
    rgb = np.zeros((n_lines, MAX_SLITS_A_LINE, 3, 3))
    start = np.zeros((n_lines, 4))
    smooth = np.empty(n, dtype=np.float32)
    flat = np.empty(n, dtype=np.float32)
    sums = np.empty(n + 1)
    places = np.empty(n, dtype=np.int64)
    for k in range(n_lines):
        end = n
        while end > 0 and np.isnan(light[k, end - 1]):
            end -= 1
        line = light[k]
        for i in range(2, end - 2):
            near, far = line[i - 1] + line[i + 1], line[i - 2] + line[i + 2]
            smooth[i] = smoothing[2] * line[i] + smoothing[1] * near + smoothing[0] * far
        _flatten(smooth, 2, end - 2, sums, flat)
        _mean_color(lines, k, 0, COLOR_SPAN_PX, start[k, :3])
        start[k, 3] = first_px + 0.5 * COLOR_SPAN_PX
        lowest = _lowest_places(flat, 2, end - 2, min_contrast, places)
        for n_place in range(lowest):
            i = places[n_place]
            if i < 2 + least_reach or i >= end - 2 - least_reach:
                continue
            if count[k] == MAX_SLITS_A_LINE:
                break
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
            _band_color(lines, smooth, k, i, int(np.ceil(x_left)), -1, end, deep, rgb[k, m, 0])
            _band_color(lines, smooth, k, i, int(np.floor(x_right)), 1, end, deep, rgb[k, m, 2])
            _mean_color(lines, k, i - 1, 3, rgb[k, m, 1])
            count[k] += 1
    return count, radius, widths, sigma, rgb, start


@njit(cache=True)
def _flatten(smooth, first, last, sums, flat):
    """A profile over its mean around each place; `sums` are its running sums.

    Far from the projector the light of haze and wall climbs so steeply that a weak slit is a bend, not a dip.
    """
    total = 0.0
    sums[first] = total
    for i in range(first, last):
        total += smooth[i]
        sums[i + 1] = total
    near, far = min(first + FLATTEN_PX, last), max(last - FLATTEN_PX, first + FLATTEN_PX)
    one, width = np.float32(1), np.float32(2 * FLATTEN_PX + 1)
    for i in range(np.uint64(near), np.uint64(max(far, near))):  # unsigned, so that several are done at a time
        around = np.float32(sums[i + np.uint64(FLATTEN_PX + 1)] - sums[i - np.uint64(FLATTEN_PX)]) / width
        flat[i] = smooth[i] / (around if around > one else one)
    for begin, end in ((first, near), (far, last)):
        for i in range(begin, end):
            reach = min(FLATTEN_PX, i - first, last - 1 - i)
            around = np.float32(sums[i + reach + 1] - sums[i - reach]) / np.float32(2 * reach + 1)
            flat[i] = smooth[i] / max(around, np.float32(1))


@njit(cache=True, error_model="numpy")
def _lowest_places(profile, first, last, rise, out):
    """Where a profile is lowest between two places that are higher by so much; how many there are."""
    n, falling, high, low, at = 0, False, profile[first], profile[first], first
    for i in range(first, last):
        here = profile[i]
        if falling:
            if here <= low:
                low, at = here, i
            elif here - low > rise:
                out[n] = at
                n, falling, high = n + 1, False, here
        elif here > high:
            high = here
        elif high - here > rise:
            falling, low, at = True, here, i
    return n


@njit(cache=True, error_model="numpy", forceinline=True)
def _below_chord(profile, i, x_left, x_right, end):
    """How far a place lies below the straight line between the bands beside it."""
    left, right = max(int(x_left) - COLOR_GAP_PX, 2), min(int(x_right) + 1 + COLOR_GAP_PX, end - 3)
    part = (i - left) / (right - left)
    return profile[left] + part * (profile[right] - profile[left]) - profile[i]


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _edges(profile, i, least_depth, least_contrast, least_reach, widest_reach, end):
    """Left and right edge of a dip, each with its slope, judged by the bands beside it; both at 0 where it is none."""
    widest, here = min(widest_reach, i - 2, end - 3 - i), profile[i]
    left = _shoulder(profile, i, -1, widest)
    if left - here <= max(least_depth, least_contrast * left):
        return 0.0, 1.0, 0.0, 1.0
    right = _shoulder(profile, i, 1, widest)
    if right - here <= max(least_depth, least_contrast * right):
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _shoulder(smooth, i, way, reach):
    """The brightest place within reach, before the profile falls below where it starts."""
    highest = smooth[i]
    for j in range(1, reach + 1):
        if smooth[i + way * j] < smooth[i]:
            break
        highest = max(highest, smooth[i + way * j])
    return highest


@njit(cache=True, error_model="numpy", forceinline=True)
def _band_levels(smooth, i, reach, highest_left, highest_right):
    """Brightness of the bands at the slit's own edges, on a straight line from what they are further out.

    Light fades along the pipe: the brightest place within reach lies further out on one side than on the other, and
    half of it would move the slit. Both bands fade alike, so that one slope serves both.
    """
    near, far = (5 * reach) // 8, reach
    half = (near + far) // 2
    left_near, left_far, right_near, right_far = 0.0, 0.0, 0.0, 0.0
    for j in range(near, half):
        left_near += smooth[i - j] / (half - near)
        right_near += smooth[i + j] / (half - near)
    for j in range(half, far):
        left_far += smooth[i - j] / (far - half)
        right_far += smooth[i + j] / (far - half)
    left, right = 0.5 * (left_near + left_far), 0.5 * (right_near + right_far)
    here = smooth[i]
    if left - here < 0.7 * (highest_left - here) or right - here < 0.7 * (highest_right - here):
        return highest_left, highest_right  # another edge is near: there is no band to follow
    gap = 0.5 * (far - near)
    fade = 0.5 * ((left_near - left_far) / left + (right_far - right_near) / right) / gap
    move = 0.5 * (near + far - 1) - EDGE_FROM_MIDDLE_SHARE * reach
    edge_left, edge_right = left * (1.0 + fade * move), right * (1.0 - fade * move)
    if min((edge_left - here) / (left - here), (edge_right - here) / (right - here)) < 0.7:
        return highest_left, highest_right  # nor is a step in brightness a fading band
    return edge_left, edge_right


@njit(cache=True, error_model="numpy", forceinline=True)
def _half_level(smooth, i, way, low, high, reach):
    """Where the profile has risen halfway from a minimum, and how steeply it rises there, in one direction."""
    level = 0.5 * (low + high)
    for j in range(1, reach + 1):
        a, b = smooth[i + way * (j - 1)], smooth[i + way * j]
        if b >= level:
            return i + way * (j - 1 + (level - a) / (b - a)), b - a
    return float(i + way * reach), 1e-3


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _mean_color(lines, k, first, span, out):
    found = 0
    for i in range(max(first, 0), min(first + span, lines.shape[1])):
        if not np.isnan(lines[k, i, 0]):
            found += 1
            for c in range(3):
                out[c] += lines[k, i, c]
    for c in range(3):
        out[c] /= max(found, 1)
