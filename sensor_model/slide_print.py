"""The slide's print: fixed shifts of the slits' edges along the azimuth, the same in every picture.

Either made up edge by edge, as a setting of the optics says how large, or a rig's own, slit by slit, as calibrated.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numba import njit


@njit(cache=True, error_model="numpy")
def hashed(edge, cell):
    """A fixed number in [-1, 1) for one edge and cell: 32-bit integer arithmetic, as the shader has it."""
    mask = np.uint64(0xFFFFFFFF)
    h = (np.uint64(edge) * np.uint64(0x9E3779B1) + np.uint64(cell) * np.uint64(0x85EBCA6B)) & mask
    h ^= h >> np.uint64(16)
    h = (h * np.uint64(0x7FEB352D)) & mask
    h ^= h >> np.uint64(15)
    h = (h * np.uint64(0x846CA68B)) & mask
    h ^= h >> np.uint64(16)
    return np.float64(h >> np.uint64(8)) / 8388608.0 - 1.0


@njit(cache=True, error_model="numpy")
def edge_shift(edge, azimuth, cells):
    """Shift of one edge at an azimuth, -1 to 1: fixed noise, joined linearly between cells of the slide.

    A band's first edge is twice its number, its last one more.
    """
    place = (azimuth / (2 * np.pi) + 0.5) * cells
    cell = int(np.floor(place))
    part = place - cell
    return (1 - part) * hashed(edge, cell % cells) + part * hashed(edge, (cell + 1) % cells)


@njit(cache=True, error_model="numpy")
def slit_jag(table_rad, edge, azimuth):
    """What a rig says that the slit of an edge has beyond its half angle: `geometry.jag_rad` of one place.

    The first edge and the last are no slit's.
    """
    slits, cells = table_rad.shape
    slit = (edge - 1) // 2
    if edge == 0 or slit >= slits:
        return 0.0
    place = np.mod(azimuth / (2 * np.pi) * cells - 0.5, cells)
    cell = int(np.floor(place))
    part = place - cell
    return (1 - part) * table_rad[slit, cell % cells] + part * table_rad[slit, (cell + 1) % cells]


@njit(cache=True, error_model="numpy")
def slit_shifts(slit: Int[np.ndarray, "n"], azimuth_rad: Float[np.ndarray, "n"], cells: int) -> Float[np.ndarray, "n"]:
    """Shift of each slit's centre line, -1 to 1: the mean of the last edge of the band within it and the first beyond.

    The edges are looked up at a shifted place (see `spot`), so that they themselves go the other way.
    """
    shift = np.empty(slit.size)
    for i in range(slit.size):
        azimuth = np.mod(azimuth_rad[i] + np.pi, 2 * np.pi) - np.pi
        within, beyond = 2 * slit[i] + 1, 2 * slit[i] + 2
        shift[i] = -0.5 * (edge_shift(within, azimuth, cells) + edge_shift(beyond, azimuth, cells))
    return shift
