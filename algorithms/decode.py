"""Decoding: from a picture to the slits seen in it, each to a fraction of a pixel and by its colour code."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from algorithms.decoding.colors import color_scores
from algorithms.decoding.dips import Dips, find_dips
from algorithms.decoding.lines import directions, polar_lines, radial_range_px
from algorithms.decoding.settings import DecodeSettings
from algorithms.decoding.words import by_line, jump_px, name_slits, roughness_px, supported, usual, whole
from sensor_model.geometry import turn_of_frame
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig


def decode(
    picture: UInt8[np.ndarray, "height width 3"], rig: Rig, settings: DecodeSettings, frame_index: int = 0
) -> SlitPixels:
    """Find the slits of one picture along lines that leave the principal point.

    The lines turn from frame to frame (`turn_of_frame`), so that a scan sees the wall between them, too. Each is
    resampled; its dark slits are located halfway between their two edges; the colours beside them, sorted into the
    frame's own three, spell the code; slits on a line are numbered by the best ordered match of colour pairs; what no
    neighbouring line supports is dropped.
    """
    along = directions(settings.azimuths, turn_of_frame(frame_index))
    lines = polar_lines(picture, rig, along)
    first = radial_range_px(rig)[0]
    dips = find_dips(lines, first, settings)
    colors = color_scores(dips, settings)
    slit = name_slits(dips, colors, rig)
    slit = whole(usual(slit, dips, settings), dips, len(rig.projector.slits), settings)
    radius_px = by_line(slit, dips.radius_px, len(rig.projector.slits))
    slit = supported(slit, dips.radius_px, dips.found, settings.support_lines, jump_px(radius_px, settings.support_px))
    return _slit_pixels(dips, slit, roughness_px(radius_px), along, rig, settings)


def _slit_pixels(
    dips: Dips,
    slit: Int[np.ndarray, "lines most"],
    rough_px: Float[np.ndarray, "slits"],
    along: Float[np.ndarray, "lines 2"],
    rig: Rig,
    settings: DecodeSettings,
) -> SlitPixels:
    line, place = np.nonzero(slit >= 0)
    order = np.lexsort((line, slit[line, place]))
    line, place = line[order], place[order]
    which, own = slit[line, place], dips.sigma_px[line, place]
    pixel = np.array([rig.camera.cx_px, rig.camera.cy_px]) + dips.radius_px[line, place, None] * along[line]
    # the slide's print is as rough as the slit looks beyond the picture's noise, and never quite clean
    usual_own = np.array([np.median(own[which == j]) if (which == j).any() else 0.0 for j in range(rough_px.size)])
    print2 = np.maximum(rough_px**2 - usual_own**2, settings.edge_std_px**2)
    return SlitPixels(pixel, which, np.sqrt(own**2 + print2[which]))
