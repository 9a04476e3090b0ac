"""Between a cylinder in the camera's frame and the camera's pose in the pipe (Eqs 4 to 6), information and all."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.registration.ray_fit import across, solve

MIDDLE_OF = 512


@njit(cache=True)
def pose_of(cylinder, T_prior):
    """`T_pipe_camera` whose axis is the cylinder's, turned and moved along it as the prior says."""
    u = np.zeros(9)
    for i in range(3):
        for k in range(3):
            u[3 + i] += T_prior[i, k] * cylinder[3 + k]
    swing = np.array([*across(u), u[3], u[4], u[5]])  # the shortest turn that brings u onto z
    T = np.eye(4)
    for i in range(3):
        for j in range(3):
            T[i, j] = swing[3 * i] * T_prior[0, j] + swing[3 * i + 1] * T_prior[1, j] + swing[3 * i + 2] * T_prior[2, j]
        T[i, 3] = -(T[i, 0] * cylinder[0] + T[i, 1] * cylinder[1] + T[i, 2] * cylinder[2])
    T[2, 3] = T_prior[2, 3]
    return T


@njit(cache=True)
def axis_of(T_pipe_camera, ahead_mm, radius_mm):
    """The cylinder that a pose implies, its centre so far ahead of the camera."""
    out = np.zeros(9)
    for k in range(3):
        out[k] = ahead_mm * T_pipe_camera[2, k]
        out[k] -= T_pipe_camera[0, 3] * T_pipe_camera[0, k] + T_pipe_camera[1, 3] * T_pipe_camera[1, k]
    out[3:6] = T_pipe_camera[2, :3]
    out[6] = radius_mm
    return out


@njit(cache=True)
def start_of(xyz, T_prior, nominal):
    """The cylinder that the prior implies, of the nominal radius, its centre in the middle of the points."""
    middle = np.empty(min(xyz.shape[0], MIDDLE_OF))
    for k in range(middle.size):
        i = k * xyz.shape[0] // middle.size
        middle[k] = T_prior[2, 0] * xyz[i, 0] + T_prior[2, 1] * xyz[i, 1] + T_prior[2, 2] * xyz[i, 2]
    return axis_of(T_prior, np.median(middle), nominal)


@njit(cache=True)
def ahead_mm(cylinder, T_pipe_camera):
    """How far along the pipe the cylinder's centre lies before the camera."""
    return T_pipe_camera[2, 0] * cylinder[0] + T_pipe_camera[2, 1] * cylinder[1] + T_pipe_camera[2, 2] * cylinder[2]


@njit(cache=True)
def information_of_pose(H, cylinder, T_pipe_camera):
    """Information (4, 4) of centre and slope across the cylinder's axis as the pose's (6, 6), of rank 4.

    A camera moved by t and turned by w (pipe axes) sees the axis, z ahead of it, move by -t - w x (-tx, -ty, z).
    """
    ahead = ahead_mm(cylinder, T_pipe_camera)
    A = np.zeros((4, 6))
    A[0, 0], A[0, 4], A[0, 5] = -1.0, -ahead, -T_pipe_camera[1, 3]
    A[1, 1], A[1, 3], A[1, 5] = -1.0, ahead, T_pipe_camera[0, 3]
    A[2, 4], A[3, 3] = -1.0, 1.0
    return _carried(H, A, _across_to_pipe(cylinder, T_pipe_camera).T)


@njit(cache=True)
def information_of_axis(information, cylinder, T_pipe_camera):
    """What a pose's information (6, 6) says of centre and slope across the axis (4, 4), its roll and travel held."""
    ahead = ahead_mm(cylinder, T_pipe_camera)
    B = np.zeros((6, 4))
    B[0, 0], B[0, 2], B[1, 1], B[1, 3], B[3, 3], B[4, 2] = -1.0, ahead, -1.0, ahead, 1.0, -1.0
    turn = _across_to_pipe(cylinder, T_pipe_camera)
    return _carried(_carried(information, B, np.eye(6)), turn, np.eye(4))


@njit(cache=True)
def _carried(H, A, turn):
    """A^T turn^T H turn A."""
    B = np.zeros(A.shape)
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            for k in range(A.shape[0]):
                B[i, j] += turn[i, k] * A[k, j]
    out = np.zeros((A.shape[1], A.shape[1]))
    for i in range(A.shape[1]):
        for j in range(A.shape[1]):
            for k in range(A.shape[0]):
                for m in range(A.shape[0]):
                    out[i, j] += B[k, i] * H[k, m] * B[m, j]
    return out


@njit(cache=True)
def _across_to_pipe(cylinder, T_pipe_camera):
    """Turns (centre, slope) from the frame across the axis into pipe axes."""
    e0, e1, e2, f0, f1, f2 = across(cylinder)
    turn = np.zeros((4, 4))
    for k in range(2):
        row = T_pipe_camera[k]
        turn[k, 0] = turn[2 + k, 2] = row[0] * e0 + row[1] * e1 + row[2] * e2
        turn[k, 1] = turn[2 + k, 3] = row[0] * f0 + row[1] * f1 + row[2] * f2
    return turn


@njit(cache=True)
def without(H, first, last):
    """Information that is left when the terms from `first` to before `last` are estimated too (Schur complement)."""
    n = H.shape[0]
    m = last - first
    rest = np.array([k for k in range(n) if not first <= k < last])
    block, side, solution = np.empty((m, m)), np.empty(m), np.empty(m)
    for i in range(m):
        for j in range(m):
            block[i, j] = H[first + i, first + j]
    left = np.empty((rest.size, rest.size))
    for j in range(rest.size):
        for i in range(m):
            side[i] = H[first + i, rest[j]]
        if not solve(block, side, 0.0, solution):
            solution[:] = 0.0  # terms of which nothing is known cost nothing
        for i in range(rest.size):
            left[i, j] = H[rest[i], rest[j]]
            for k in range(m):
                left[i, j] -= H[rest[i], first + k] * solution[k]
    return left


@njit(cache=True)
def looseness(axis, ahead):
    """Largest standard deviation of the camera's centre, mm, and of the axis, rad; infinite where not fixed.

    `axis` is the information (4, 4) on centre and slope, `ahead` how far the centre lies before the camera.
    """
    covariance, unit, column = np.empty((4, 4)), np.empty(4), np.empty(4)
    for k in range(4):
        unit[:] = 0.0
        unit[k] = 1.0
        if not solve(axis, unit, 0.0, column):
            return np.inf, np.inf
        covariance[:, k] = column
    at_camera = np.empty((2, 2))
    for i in range(2):
        for j in range(2):
            mixed = covariance[i, 2 + j] + covariance[2 + i, j]
            at_camera[i, j] = covariance[i, j] - ahead * mixed + ahead * ahead * covariance[2 + i, 2 + j]
    return np.sqrt(_largest(at_camera)), np.sqrt(_largest(covariance[2:, 2:]))


@njit(cache=True)
def _largest(matrix):
    """Larger eigenvalue of a symmetric 2 x 2 matrix."""
    middle, half = 0.5 * (matrix[0, 0] + matrix[1, 1]), 0.5 * (matrix[0, 0] - matrix[1, 1])
    return middle + np.sqrt(half * half + matrix[0, 1] * matrix[1, 0])
