"""The compiled core of the cylinder fits: residuals along the light rays, normal equations, one step.

A cylinder is an array of nine: a point on its axis (3, mm), the axis (3, unit, forward), the radius (mm), and its
ovality: the radius grows by o1 cos 2t + o2 sin 2t, where t is the angle in the frame of `across`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.robust import MAD_TO_SIGMA

TINY = 1e-12
TERMS = 20  # sums of one pass: 14 of the normal matrix, 5 of its right side, and the weights
TRUNCATED_SHARE = 0.9535  # standard deviation of a normal distribution cut off at 2.5 of its own


@njit(cache=True)
def pack(xyz, direction, sigma, first, last, step):
    """Every `step`-th point as a column (x, y, z, direction, 1 / sigma, 1 as it counts); whether all is finite."""
    n = (last - first + step - 1) // step
    packed = np.empty((8, n))
    poison = 0.0
    for i in range(n):
        k = first + i * step
        for j in range(3):
            packed[j, i] = xyz[k, j]
            packed[3 + j, i] = direction[k, j]
        packed[6, i] = 1.0 / sigma[k]
        packed[7, i] = 1.0
        poison += (packed[0, i] + packed[1, i] + packed[2, i] + packed[6, i]) * 0.0
    return packed, poison == 0.0


@njit(cache=True)
def across(cylinder):
    """Two unit vectors across the axis: the camera's x and y, swung with z onto the axis."""
    ax, ay, az = cylinder[3], cylinder[4], cylinder[5]
    k = 1.0 / (1.0 + az)
    return 1.0 - ax * ax * k, -ax * ay * k, -ax, -ax * ay * k, 1.0 - ay * ay * k, -ay


@njit(cache=True)
def residuals(packed, cylinder, out):
    """How far each point lies beyond the wall, along its light ray, in its own standard deviations (Eq. 10).

    Along the ray, because there the range error is plain Gaussian: a distance across the wall would be biased by it.
    """
    if cylinder[7] == 0.0 and cylinder[8] == 0.0:
        _residuals_of_round(packed, cylinder, out)
    else:
        _residuals_of_oval(packed, cylinder, out)


@njit(cache=True, fastmath=True, error_model="numpy")
def _residuals_of_round(packed, cylinder, out):
    cx, cy, cz, _, _, _, radius, _, _ = cylinder
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    r2 = radius * radius
    for i in range(packed.shape[1]):
        px, py, pz = packed[0, i] - cx, packed[1, i] - cy, packed[2, i] - cz
        dx, dy, dz = packed[3, i], packed[4, i], packed[5, i]
        x, y = e0 * px + e1 * py + e2 * pz, f0 * px + f1 * py + f2 * pz
        u, v = e0 * dx + e1 * dy + e2 * dz, f0 * dx + f1 * dy + f2 * dz
        b, a, c = x * u + y * v, u * u + v * v, x * x + y * y - r2
        root = np.sqrt(max(b * b - a * c, TINY))
        out[i] = c / max(b + root, TINY) * packed[6, i]


@njit(cache=True, error_model="numpy")
def _residuals_of_oval(packed, cylinder, out):
    cx, cy, cz, _, _, _, radius, o1, o2 = cylinder
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    for i in range(packed.shape[1]):
        px, py, pz = packed[0, i] - cx, packed[1, i] - cy, packed[2, i] - cz
        dx, dy, dz = packed[3, i], packed[4, i], packed[5, i]
        x, y = e0 * px + e1 * py + e2 * pz, f0 * px + f1 * py + f2 * pz
        u, v = e0 * dx + e1 * dy + e2 * dz, f0 * dx + f1 * dy + f2 * dz
        rho2 = x * x + y * y + TINY
        r = radius + (o1 * (x * x - y * y) + 2.0 * o2 * x * y) / rho2
        b, a, c = x * u + y * v, u * u + v * v, rho2 - r * r
        root = np.sqrt(max(b * b - a * c, TINY))
        out[i] = c / max(b + root, TINY) * packed[6, i]


@njit(cache=True, fastmath=True, error_model="numpy")
def normal_equations(packed, cylinder, cut, sums, residual):
    """Sums of the normal equations in (centre x, y; slope x, y; radius) of a round wall, robustly weighed; residuals.

    The weight (1 - (e / cut)^4)^2 is flatter at the top than Tukey's biweight and falls more steeply, so that less is
    lost on the wall and less taken from what lies just beyond it. A ray meets the wall at h, with the normal n = h / r;
    a change (c, s, R) of the cylinder moves the residual by -(n.c + h_z n.s + R) / (n.d sigma).
    """
    cx, cy, cz, ax, ay, az, radius, _, _ = cylinder
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    per_cut2, r2, per_r = 1.0 / (cut * cut), radius * radius, 1.0 / radius
    h00 = h01 = h11 = h02 = h03 = h13 = h22 = h23 = h33 = h04 = h14 = h24 = h34 = h44 = 0.0
    g0 = g1 = g2 = g3 = g4 = weight = 0.0
    for i in range(packed.shape[1]):
        px, py, pz = packed[0, i] - cx, packed[1, i] - cy, packed[2, i] - cz
        dx, dy, dz = packed[3, i], packed[4, i], packed[5, i]
        x, y, z = e0 * px + e1 * py + e2 * pz, f0 * px + f1 * py + f2 * pz, ax * px + ay * py + az * pz
        u, v, w = e0 * dx + e1 * dy + e2 * dz, f0 * dx + f1 * dy + f2 * dz, ax * dx + ay * dy + az * dz
        b, a, c = x * u + y * v, u * u + v * v, x * x + y * y - r2
        facing2 = max(b * b - a * c, TINY)
        root = np.sqrt(facing2)
        far = max(b + root, TINY)
        per_both = 1.0 / (far * facing2)  # one division serves both
        t = -c * facing2 * per_both
        e = -t * packed[6, i]
        residual[i] = e
        part = e * e * per_cut2
        q = max(1.0 - part * part, 0.0)
        q *= q * packed[7, i]
        k = q * packed[6, i] * packed[6, i] * r2 * far * per_both
        beyond = -t * root * per_r
        nx, ny, hz = (x + t * u) * per_r, (y + t * v) * per_r, z + t * w
        kx, ky, z2 = k * nx, k * ny, hz * hz
        xx, xy, yy = kx * nx, kx * ny, ky * ny
        h00, h01, h11 = h00 + xx, h01 + xy, h11 + yy
        h02, h03, h13 = h02 + xx * hz, h03 + xy * hz, h13 + yy * hz
        h22, h23, h33 = h22 + xx * z2, h23 + xy * z2, h33 + yy * z2
        h04, h14, h24, h34, h44 = h04 + kx, h14 + ky, h24 + kx * hz, h34 + ky * hz, h44 + k
        g0, g1 = g0 + kx * beyond, g1 + ky * beyond
        g2, g3, g4 = g2 + kx * hz * beyond, g3 + ky * hz * beyond, g4 + k * beyond
        weight += q
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6] = h00, h01, h11, h02, h03, h13, h22
    sums[7], sums[8], sums[9], sums[10], sums[11], sums[12], sums[13] = h23, h33, h04, h14, h24, h34, h44
    sums[14], sums[15], sums[16], sums[17], sums[18], sums[19] = g0, g1, g2, g3, g4, weight


@njit(cache=True)
def normal_matrix(packed, cylinder, cut, H, g, residual):
    """Fill the normal matrix, its right side, of 5 terms or, with ovality, 7, and the residuals; returns all weight."""
    if g.size == 5:
        sums = np.empty(TERMS)
        normal_equations(packed, cylinder, cut, sums, residual)
        _unfold(sums, H, g)
        return sums[TERMS - 1]
    return _normal_matrix_one_by_one(packed, cylinder, cut, H, g, residual)


@njit(cache=True)
def _unfold(sums, H, g):
    H[0, 0], H[0, 1], H[1, 1], H[0, 2], H[0, 3], H[1, 3], H[1, 2] = (
        sums[0],
        sums[1],
        sums[2],
        sums[3],
        sums[4],
        sums[5],
        sums[4],
    )
    H[2, 2], H[2, 3], H[3, 3] = sums[6], sums[7], sums[8]
    for a in range(5):
        if a < 4:
            H[a, 4] = sums[9 + a]
        g[a] = sums[14 + a]
    H[4, 4] = sums[13]
    for a in range(5):
        for b in range(a):
            H[a, b] = H[b, a]


@njit(cache=True)
def _normal_matrix_one_by_one(packed, cylinder, cut, H, g, residual):
    """The same point by point and term by term, for an oval wall too: slower, and the reference of the fast one."""
    terms = g.size
    H[:], g[:] = 0.0, 0.0
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    J, total = np.empty(terms), 0.0
    for i in range(packed.shape[1]):
        px, py, pz = packed[0, i] - cylinder[0], packed[1, i] - cylinder[1], packed[2, i] - cylinder[2]
        dx, dy, dz = packed[3, i], packed[4, i], packed[5, i]
        x, y = e0 * px + e1 * py + e2 * pz, f0 * px + f1 * py + f2 * pz
        u, v = e0 * dx + e1 * dy + e2 * dz, f0 * dx + f1 * dy + f2 * dz
        rho2 = x * x + y * y + TINY
        o1, o2 = (x * x - y * y) / rho2, 2.0 * x * y / rho2
        r = cylinder[6] + cylinder[7] * o1 + cylinder[8] * o2
        b, a, c = x * u + y * v, u * u + v * v, rho2 - r * r
        root = np.sqrt(max(b * b - a * c, TINY))
        t = -c / max(b + root, TINY)
        hit = pz + t * dz
        z = cylinder[3] * (px + t * dx) + cylinder[4] * (py + t * dy) + cylinder[5] * hit
        residual[i] = -t * packed[6, i]
        q = packed[7, i] * max(1.0 - (residual[i] / cut) ** 4, 0.0) ** 2
        facing = root / r
        J[0], J[1] = (x + t * u) / r, (y + t * v) / r
        J[2], J[3], J[4] = z * J[0], z * J[1], 1.0
        if terms == 7:
            J[5], J[6] = o1, o2
        k = q * (packed[6, i] / facing) ** 2
        for m in range(terms):
            g[m] += k * J[m] * -t * facing
            for n in range(terms):
                H[m, n] += k * J[m] * J[n]
        total += q
    return total


@njit(cache=True)
def solve(H, g, damping, out):
    """Solution of a small symmetric system by a scaled Cholesky; False where it is singular."""
    n = g.size
    scale, L = np.empty(n), np.zeros((n, n))
    for a in range(n):
        if not H[a, a] > 0.0:
            return False
        scale[a] = 1.0 / np.sqrt(H[a, a])
    for j in range(n):
        pivot = 1.0 + damping
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if not pivot > 1e-10:
            return False
        L[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            t = H[i, j] * scale[i] * scale[j]
            for k in range(j):
                t -= L[i, k] * L[j, k]
            L[i, j] = t / L[j, j]
    for i in range(n):
        t = g[i] * scale[i]
        for k in range(i):
            t -= L[i, k] * out[k]
        out[i] = t / L[i, i]
    for i in range(n - 1, -1, -1):
        t = out[i]
        for k in range(i + 1, n):
            t -= L[k, i] * out[k]
        out[i] = t / L[i, i]
    for i in range(n):
        out[i] *= scale[i]
    return True


@njit(cache=True)
def moved(cylinder, step):
    """The cylinder after a step in (centre x, y; slope x, y; radius; and, where the step has them, ovality)."""
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    out = cylinder.copy()
    out[0] += step[0] * e0 + step[1] * f0
    out[1] += step[0] * e1 + step[1] * f1
    out[2] += step[0] * e2 + step[1] * f2
    out[3] += step[2] * e0 + step[3] * f0
    out[4] += step[2] * e1 + step[3] * f1
    out[5] += step[2] * e2 + step[3] * f2
    length = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    for k in range(3, 6):
        out[k] /= length
    for k in range(4, step.size):
        out[k + 2] += step[k]
    return out


@njit(cache=True)
def pull(cylinder, other):
    """The step in (centre x, y; slope x, y; radius) from one cylinder to another."""
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    ax, ay, az = cylinder[3], cylinder[4], cylinder[5]
    bx, by, bz = other[3], other[4], other[5]
    cosine = ax * bx + ay * by + az * bz
    qx, qy, qz = other[0] - cylinder[0], other[1] - cylinder[1], other[2] - cylinder[2]
    back = (ax * qx + ay * qy + az * qz) / cosine
    qx, qy, qz = qx - back * bx, qy - back * by, qz - back * bz
    out = np.empty(5)
    out[0], out[1] = e0 * qx + e1 * qy + e2 * qz, f0 * qx + f1 * qy + f2 * qz
    out[2], out[3] = (e0 * bx + e1 * by + e2 * bz) / cosine, (f0 * bx + f1 * by + f2 * bz) / cosine
    out[4] = other[6] - cylinder[6]
    return out


@njit(cache=True)
def scale_about_zero(values):
    """Standard deviation of the residuals of a fit, by the median and what lies near it."""
    return _trimmed(values, 0.0, MAD_TO_SIGMA * np.median(np.abs(values)))[1]


@njit(cache=True)
def tightest_half(values):
    """Middle of the shortest interval that holds half of the values, and the standard deviation around it.

    A mode and its scale: neither is moved by what lies elsewhere, be it nearly half and all on one side.
    """
    s = np.sort(values)
    half = s.size // 2
    at, width = 0, np.inf
    for i in range(s.size - half):
        if s[i + half] - s[i] < width:
            at, width = i, s[i + half] - s[i]
    return _trimmed(s, 0.5 * (s[at] + s[at + half]), width / 1.349)


@njit(cache=True, fastmath=True)
def _trimmed(values, middle, scale):
    """Mean and standard deviation of what lies within 2.5 standard deviations."""
    for _ in range(4):
        count, total, squares = 0.0, 0.0, 0.0
        for i in range(values.size):
            off = values[i] - middle
            near = 1.0 if abs(off) <= 2.5 * scale else 0.0  # no branch, so that several are done at once
            count += near
            total += near * off
            squares += near * off * off
        if count < 8:
            break
        shift = total / count
        scale = np.sqrt(max(squares / count - shift * shift, 0.0)) / TRUNCATED_SHARE
        middle += shift
    return middle, scale
