"""What the slit pixels of frames tell: their noise, how many are missing, and how jagged the slide's edges are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from algorithms.calibration.slide_in_scan import radius_per_rad
from algorithms.identification.estimate import LEAST_BLOCKS, Quantity, Unknown, of_blocks, of_share
from algorithms.robust import MAD_TO_SIGMA
from algorithms.types import Alignment, RingPoints
from sensor_model.geometry import apply, projector_azimuth_rad
from sensor_model.rig import Rig

SECOND_DIFFERENCE_GAIN = 6.0  # variance of the second difference of white noise over its own
LONGEST_GAP = 6  # places missing in a row that can be chance; more are a shadow, the strut or the picture's edge
LEAST_RUN = 30
LAGS = 7
SMOOTH_PLACES = 121
LEVER_LEAST = 1.0  # mm a radian; what moves less says nothing of the slide
ON_THE_WALL_MM = 3.0
DECODED_SHARE = 0.03  # by so much of it decoding and the smooth line change what is printed, all slits alike


@dataclass(frozen=True)
class SlitFigures:
    """One frame's: noise from place to place (px), missing and present places, and how its edges vary (rad, by lag).

    `jag_rad2` is the covariance of the slits' half angles, slit by slit, at distances of whole places; the first is
    their variance. `own_rad2` is the part of it that the frame before does not have, and `rough_rad` what it is made
    of. Not a number where a slit was not seen.
    """

    noise_px: float
    missing: int
    present: int
    places: int
    jag_rad2: Float[np.ndarray, "slits lags"]
    own_rad2: Float[np.ndarray, "slits"]
    rough_rad: Float[np.ndarray, "slits places"]


def slit_figures(
    points: RingPoints, alignment: Alignment, rig: Rig, from_camera: bool, before: SlitFigures | None = None
) -> SlitFigures:
    """Measure one frame's slit pixels.

    Args:
        points: its points.
        alignment: of the frame.
        rig: whose principal point the pixels are seen from.
        from_camera: whether the places are even around the picture's centre, as the decoder's are, or the projector's.
        before: the figures of the frame before, which tell the places around and what all frames have alike.
    """
    slits = len(rig.projector.slits)
    middle = np.array([rig.camera.cx_px, rig.camera.cy_px])
    off = points.pixel - middle
    radius_px = np.hypot(off[:, 0], off[:, 1])
    around = np.mod(np.arctan2(off[:, 0], -off[:, 1]), 2 * np.pi)
    if not from_camera:
        around = projector_azimuth_rad(points.xyz_mm, rig.projector.T_camera_projector)
    places = before.places if before else places_around(around, points.ring, slits)
    x, y, _ = apply(alignment.T_pipe_camera, points.xyz_mm).T
    outside = np.hypot(x, y) - alignment.radius_mm
    per_rad = radius_per_rad(points, alignment, rig)
    excess = np.where(np.abs(per_rad) > LEVER_LEAST, -outside / per_rad, np.nan)
    excess[np.abs(outside) > ON_THE_WALL_MM] = np.nan
    noise, missing, present = [], 0, 0
    jag, rough = np.full((slits, LAGS + 1), np.nan), np.full((slits, places), np.nan)
    for j in range(slits):
        mine = points.ring == j
        if np.count_nonzero(mine) < LEAST_RUN:
            continue
        place = np.rint(around[mine] / (2 * np.pi) * places).astype(np.int64) % places
        radius, angle = (_spread_out(values[mine], place, places) for values in (radius_px, excess))
        second = radius[2:] - 2 * radius[1:-1] + radius[:-2]
        noise.append(second[np.isfinite(second)])
        gone, there = _gaps(np.isfinite(radius))
        missing, present = missing + gone, present + there
        rough[j] = _roughness(angle)
        jag[j] = _covariances(rough[j])
    all_px = np.concatenate(noise) if noise else np.zeros(0)
    spread = MAD_TO_SIGMA * float(np.median(np.abs(all_px))) if all_px.size > LEAST_RUN else float("nan")
    own = np.full(slits, np.nan)
    if before is not None:
        own = 0.5 * np.array([_mean_square(row) for row in rough - before.rough_rad])
    return SlitFigures(spread / np.sqrt(SECOND_DIFFERENCE_GAIN), missing, present, places, jag, own, rough)


def _mean_square(row: Float[np.ndarray, "n"]) -> float:
    """Of what is known of a row; robust, for a frame's points may hop to another place."""
    known = row[np.isfinite(row)]
    return (MAD_TO_SIGMA * float(np.median(np.abs(known)))) ** 2 if known.size > LEAST_RUN else float("nan")


def places_around(around_rad: Float[np.ndarray, "n"], ring: Int[np.ndarray, "n"], slits: int) -> int:
    """How many even places around there are, by the usual step between neighbours."""
    steps = [np.diff(np.sort(around_rad[ring == j])) for j in range(slits)]
    usual = float(np.median(np.concatenate(steps))) if any(step.size for step in steps) else 0.0
    return max(round(2 * np.pi / usual), 36) if usual > 1e-4 else 720


def _spread_out(
    values: Float[np.ndarray, "n"], place: Int[np.ndarray, "n"], places: int
) -> Float[np.ndarray, "places"]:
    out = np.full(places, np.nan)
    out[place] = values
    return out


def _gaps(seen: np.ndarray) -> tuple[int, int]:
    """Missing places in short gaps, and the places that are there, around a circle."""
    present = np.flatnonzero(seen)
    steps = np.diff(np.append(present, present[0] + seen.size))
    short = (steps > 1) & (steps <= LONGEST_GAP + 1)
    return int(np.sum(steps[short] - 1)), int(present.size)


def _roughness(angle: Float[np.ndarray, "places"]) -> Float[np.ndarray, "places"]:
    """What is left of a smooth line; not a number at defects' edges."""
    half = SMOOTH_PLACES // 2
    around = np.concatenate([angle[-half:], angle, angle[:half]])
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * half + 1)
    known = np.isfinite(windows).sum(axis=1) > half / 2
    rough = np.full(angle.size, np.nan)
    rough[known] = angle[known] - np.nanmedian(windows[known], axis=1)
    if known.any():
        rough[np.abs(rough) > 5 * MAD_TO_SIGMA * np.nanmedian(np.abs(rough))] = np.nan
    return rough


def _covariances(rough: Float[np.ndarray, "places"]) -> Float[np.ndarray, "lags"]:
    """Covariance at 0, 1, ... places."""
    out = np.full(LAGS + 1, np.nan)
    for lag in range(LAGS + 1):
        products = rough * np.roll(rough, -lag)
        products = products[np.isfinite(products)]
        if products.size > LEAST_RUN:
            out[lag] = products.mean()
    return out


def pixel_noise_px(figures: list[SlitFigures]) -> Quantity:
    """Standard deviation of a slit pixel across its slit, apart from its neighbours."""
    values = np.array([one.noise_px for one in figures])
    return of_blocks(values, "second differences along the slits, a value a frame")


def drop_out_share(figures: list[SlitFigures]) -> Quantity:
    """Share of the places on lit wall at which a slit was not found: gaps too short for a shadow."""
    missing, present = (
        np.array([getattr(one, name) for one in figures], dtype=float) for name in ("missing", "present")
    )
    return of_share(missing, missing + present, f"gaps of up to {LONGEST_GAP} places within the slits")


def edge_jitter(figures: list[SlitFigures]) -> tuple[Quantity, Quantity]:
    """The slide's own jaggedness: RMS of the half angles (rad) and the cells that it is printed in, by the slits.

    It is the same in every frame, so the slits, not the frames, are what knows nothing of each other.
    """
    by_slit = _means(np.array([one.jag_rad2 for one in figures]))
    own = _means(np.array([one.own_rad2 for one in figures]))
    seen = np.isfinite(by_slit).all(axis=1)
    if np.count_nonzero(seen) < LEAST_BLOCKS:
        return (Unknown(f"{np.count_nonzero(seen)} slits were seen well enough; {LEAST_BLOCKS} are needed"),) * 2
    of = "slits, a value a slit" if np.isfinite(own[seen]).all() else "slits of single frames, decoding noise and all"
    rows = zip(by_slit[seen], np.nan_to_num(own[seen]), strict=True)
    fits = np.array([_fitted(row, noise, figures[0].places) for row, noise in rows])
    shared = DECODED_SHARE * fits.mean(axis=0)
    rms = of_blocks(fits[:, 0], f"scatter of the half angles along the {of}", float(shared[0]))
    words = f"azimuth over which the half angles stay alike along the {of}"
    return rms, of_blocks(fits[:, 1], words, float(shared[1]))


def _means(tables: Float[np.ndarray, "frames *rest"]) -> Float[np.ndarray, "*rest"]:
    """Mean over the frames that know; not a number where none does."""
    known = np.isfinite(tables)
    return np.where(known, tables, 0.0).sum(axis=0) / np.where(known.any(axis=0), known.sum(axis=0), np.nan)


def _fitted(covariance: Float[np.ndarray, "lags"], noise_rad2: float, places: int) -> tuple[float, float]:
    """RMS and cells of a jagged line that goes straight between its knots, under so much white noise."""
    from scipy.optimize import minimize_scalar

    lag = np.arange(1, covariance.size) * 360.0 / places
    power = max(float(covariance[0]) - noise_rad2, 1e-18)

    def misfit(log_width: float) -> float:
        return float(np.sum((covariance[1:] / power - knot_correlation(lag / np.exp(log_width))) ** 2))

    best = minimize_scalar(misfit, bounds=(np.log(lag[0] / 1.9), np.log(6.0)), method="bounded")
    return float(np.sqrt(power)), 360.0 / float(np.exp(best.x))


def knot_correlation(apart: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """How alike a line through independent knots is to itself, so many knots apart: the cubic B-spline over its top."""
    x = np.abs(apart)
    near, far = 2 / 3 - x**2 + x**3 / 2, np.clip(2 - x, 0, None) ** 3 / 6
    return np.where(x < 1, near, far) / (2 / 3)
