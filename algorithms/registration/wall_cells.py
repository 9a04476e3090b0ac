"""A frame's points gathered into cells of wall: a defect is a patch, and shows in cells where no single point tells."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.registration.ray_fit import across, moved, solve, tightest_half

AROUND, ALONG = 24, 6
FEWEST_IN_CELL = 3
FEWEST_CELLS = 12
SAMPLE = 6
SAMPLES, FEW_SAMPLES = 200, 30
ROUNDS, CLOSE = 5, 2.0
CELL_CUT = 6.0
EVEN_SPREAD = 1.732  # half the length over the standard deviation of an even distribution
CELL_SIGMAS = 3.5
NEAR_SIGMAS, FAR_SIGMAS, MOST_BESIDE = 3.0, 8.0, 0.1


@njit(cache=True, fastmath=True, error_model="numpy")
def find_cells(packed, cylinder, low, high, around, along, cell):
    """The cell of every point: equal steps along the axis from `low` to `high`, the end ones open, and around it.

    Around it they are equal steps of y / (|x| + |y|): an angle without an arc tangent.
    """
    cx, cy, cz, ax, ay, az = cylinder[:6]
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    per_row = along / (high - low)
    for i in range(packed.shape[1]):
        px, py, pz = packed[0, i] - cx, packed[1, i] - cy, packed[2, i] - cz
        x, y = e0 * px + e1 * py + e2 * pz, f0 * px + f1 * py + f2 * pz
        row = (ax * px + ay * py + az * pz - low) * per_row
        turn = y / (abs(x) + abs(y) + 1e-12)
        turn = 0.25 * around * (1.0 - turn if x < 0.0 else 3.0 + turn)
        cell[i] = np.int32(min(turn, around - 1.0)) * along + np.int32(min(max(row, 0.0), along - 1.0))


@njit(cache=True, error_model="numpy")
def _places(packed, cylinder, cell, cells, rho):
    """Counts of the cells, their rows of the normal equations, and every point's distance from the axis.

    A row is (n, z n, 1) for centre, slope and radius, and cos 2t, sin 2t for ovality, at the middle of the points.
    """
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    count, place = np.zeros(cells), np.zeros((cells, 7))
    for i in range(packed.shape[1]):
        px, py, pz = packed[0, i] - cylinder[0], packed[1, i] - cylinder[1], packed[2, i] - cylinder[2]
        x, y = e0 * px + e1 * py + e2 * pz, f0 * px + f1 * py + f2 * pz
        c = cell[i]
        rho[i] = np.sqrt(x * x + y * y)
        count[c] += 1.0
        place[c, 0] += x
        place[c, 1] += y
        place[c, 2] += cylinder[3] * px + cylinder[4] * py + cylinder[5] * pz
    for c in range(cells):
        length = np.hypot(place[c, 0], place[c, 1]) + 1e-12
        nx, ny, z = place[c, 0] / length, place[c, 1] / length, place[c, 2] / max(count[c], 1.0)
        place[c] = nx, ny, z * nx, z * ny, 1.0, nx * nx - ny * ny, 2.0 * nx * ny
    return count, place


@njit(cache=True, fastmath=True)
def reach(packed, cylinder):
    """From where to where along the axis most points lie, if they are evenly spread."""
    total, squares = 0.0, 0.0
    for i in range(packed.shape[1]):
        z = (
            cylinder[3] * (packed[0, i] - cylinder[0])
            + cylinder[4] * (packed[1, i] - cylinder[1])
            + cylinder[5] * (packed[2, i] - cylinder[2])
        )
        total += z
        squares += z * z
    middle = total / packed.shape[1]
    half = EVEN_SPREAD * np.sqrt(max(squares / packed.shape[1] - middle * middle, 0.0)) + 1e-6
    return middle - half, middle + half


@njit(cache=True)
def _cell_medians(cell, rho, radius, count):
    """Median height of every cell's points over the cylinder, mm."""
    first = np.zeros(count.size + 1, dtype=np.int64)
    for c in range(count.size):
        first[c + 1] = first[c] + int(count[c])
    fill, values = first[:-1].copy(), np.empty(cell.size)
    for i in range(cell.size):
        values[fill[cell[i]]] = rho[i] - radius
        fill[cell[i]] += 1
    height = np.zeros(count.size)
    for c in range(count.size):
        if count[c] >= FEWEST_IN_CELL:
            height[c] = np.median(values[first[c] : first[c + 1]])
    return height


@njit(cache=True)
def _linear(place, height, weight, rows, radius_weight, H, g, step):
    """Least-squares change of the cylinder over some cells."""
    n = step.size
    H[:], g[:] = 0.0, 0.0
    for c in rows:
        w, h = weight[c], height[c]
        for a in range(n):
            wa = w * place[c, a]
            g[a] += wa * h
            for b in range(a + 1):
                H[a, b] += wa * place[c, b]
    for a in range(n):
        for b in range(a):
            H[b, a] = H[a, b]
    H[4, 4] += radius_weight
    return solve(H, g, 1e-7, step)


@njit(cache=True)
def _height_left(place, height, step, c):
    left = height[c]
    for a in range(step.size):
        left -= place[c, a] * step[a]
    return left


@njit(cache=True)
def _cost(place, height, weight, rows, step, cut, best):
    """Truncated squares over the cells, given up as soon as they exceed the best."""
    total = 0.0
    for c in rows:
        u = _height_left(place, height, step, c) / cut
        total += weight[c] * min(u * u, 1.0)
        if total >= best:
            break
    return total


@njit(cache=True)
def _best_step(place, height, weight, rows, cut, radius, nominal, radius_std, terms, samples):
    """RANSAC over cells, where a hypothesis is linear and so costs next to nothing; then polished on those it keeps."""
    ones = np.ones(weight.size)
    best, step, H, g = np.zeros(terms), np.empty(terms), np.empty((terms, terms)), np.empty(terms)
    best_cost = _cost(place, height, weight, rows, best, cut, np.inf)
    sample = np.empty(SAMPLE + terms - 5, dtype=np.int64)
    state = np.uint64(20230139)  # the sampling is part of the method: the same points give the same pose
    for _ in range(samples):
        for k in range(sample.size):
            state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
            sample[k] = rows[int((state >> np.uint64(33)) % np.uint64(rows.size))]
        if not _linear(place, height, ones, sample, (cut / CELL_CUT / radius_std) ** 2, H, g, step):
            continue
        if abs(radius + step[4] - nominal) > 4.0 * radius_std:
            continue
        cost = _cost(place, height, weight, rows, step, cut, best_cost)
        if cost < best_cost:
            best_cost = cost
            best[:] = step
    wide = 2.0 * cut
    kept = np.zeros(weight.size)
    for _ in range(5):
        for c in rows:
            u = _height_left(place, height, best, c) / wide
            kept[c] = weight[c] * max(1.0 - u * u, 0.0) ** 2
        if not _linear(place, height, kept, rows, 1e-9, H, g, step):
            break
        best[:] = step
        wide = max(cut, 0.7 * wide)
    return best


@njit(cache=True)
def search(packed, cylinder, nominal, radius_std, noise_mm, terms, effort):
    """The cylinder on which most of the wall lies, not most of the points; False where there are too few cells.

    `terms` is 5, or 7 with ovality. Linearised about the cylinder given, so repeated from where it leads.
    """
    n = packed.shape[1]
    cell, rho = np.empty(n, dtype=np.int32), np.empty(n)
    for k in range(ROUNDS):
        low, high = reach(packed, cylinder)
        find_cells(packed, cylinder, low, high, AROUND, ALONG, cell)
        count, place = _places(packed, cylinder, cell, AROUND * ALONG, rho)
        height = _cell_medians(cell, rho, cylinder[6], count)
        rows = np.flatnonzero(count >= FEWEST_IN_CELL)
        if rows.size < FEWEST_CELLS:
            return cylinder, False
        cut = CELL_CUT * 1.4 * noise_mm / np.sqrt(n / rows.size)
        cylinder[7:] = 0.0  # heights are over the round cylinder: ovality is found anew each time
        samples = effort * (SAMPLES if k == 0 else FEW_SAMPLES)
        step = _best_step(place, height, count, rows, cut, cylinder[6], nominal, radius_std, terms, samples)
        cylinder = moved(cylinder, step)
        if not np.isfinite(cylinder).all() or not cylinder[5] > 0.2:
            return cylinder, False
        far = max(abs(step[0]), abs(step[1]), 60.0 * abs(step[2]), 60.0 * abs(step[3]), abs(step[4]))
        if far < CLOSE * noise_mm:
            break
    return cylinder, True


@njit(cache=True)
def is_wall(cell, residual, scale, cells):
    """Which cells are wall: few of their points lie just beyond the wall's own noise, and the rest as in most cells.

    Far outliers condemn no cell: beside them a point of the wall is sure to be one. A cell of few points is never
    condemned for their mean.
    """
    count, near, total, beside = np.zeros(cells), np.zeros(cells), np.zeros(cells), np.zeros(cells)
    for i in range(cell.size):
        c, far = cell[i], abs(residual[i]) / scale
        on = 1.0 if far < NEAR_SIGMAS else 0.0  # no branches: which way they go is chance
        count[c] += 1.0
        near[c] += on
        total[c] += on * residual[i]
        beside[c] += 1.0 - on if far < FAR_SIGMAS else 0.0
    wall = beside <= 1.0 + MOST_BESIDE * count
    enough = wall & (near > FEWEST_IN_CELL)
    if enough.sum() < FEWEST_CELLS:
        return wall
    mean = total / np.sqrt(np.maximum(near, 1.0))  # of one standard deviation whatever the count
    middle, spread = tightest_half(mean[enough])
    spread = max(spread, 0.5 * scale)
    for c in range(cells):
        wall[c] &= near[c] <= FEWEST_IN_CELL or abs(mean[c] - middle) <= CELL_SIGMAS * spread
    return wall


@njit(cache=True)
def keep_wall(packed, cell, wall):
    """Let only the points count that lie in cells of wall."""
    for i in range(cell.size):
        packed[7, i] = 1.0 if wall[cell[i]] else 0.0
