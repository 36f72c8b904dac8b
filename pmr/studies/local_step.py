r"""The compiled loop of local bases: generalized-alpha with matrices that follow the path, O(r^3) a step.

A table's rows at a place are M, D, K, V^T M V', V^T M V'', V^T D V' (each r x r) and (V^T B)^T, flattened.
"""

from __future__ import annotations

from pmr.simulate.native.arrays import Array
from pmr.simulate.native.compilation import compiled


@compiled
def run(
    tables: Array, grid: Array, course: Array, f: Array, scheme: Array, work: Array, q: Array, v: Array, count: int
) -> None:
    """Steps 1 to `count` - 1 from rest: q and v (T, r) under loads f (T, i), along s, s' and s'' in `course` (3, T).

    `tables` (g, 4, w) hold from `grid[0]` on in pieces of length `grid[1]`; `scheme` is h, alpha_m, alpha_f, gamma,
    beta; `work` has 6 r + i + 8 rows of length r.
    """
    r, h, a_m, a_f, gamma, beta = q.shape[1], scheme[0], scheme[1], scheme[2], scheme[3], scheme[4]
    gain = (1.0 - a_f) / (1.0 - a_m)
    dv, dq, loads = h * gamma * gain, h * h * beta * gain, f.shape[1]
    at, a, acceleration, side = work[: 6 * r + loads], work[-1], work[-2], work[-3]
    for i in range(r):
        a[i] = 0.0
        acceleration[i] = 0.0
    for k in range(0, count):
        x = (course[0, k] - grid[0]) / grid[1]
        piece = min(max(int(x), 0), tables.shape[0] - 1)
        z, rate, second = (x - piece) * grid[1], course[1, k], course[2, k]
        for row in range(at.shape[0]):
            for j in range(r):
                n = row * r + j
                c0, c1, c2, c3 = tables[piece, 0, n], tables[piece, 1, n], tables[piece, 2, n], tables[piece, 3, n]
                at[row, j] = ((c0 * z + c1) * z + c2) * z + c3
        first = k == 0
        for i in range(r):
            following = 0.0 if first else (a_f * acceleration[i] - a_m * a[i]) / (1.0 - a_m)
            if not first:
                q[k, i] = q[k - 1, i] + h * v[k - 1, i] + h * h * ((0.5 - beta) * a[i] + beta * following)
                v[k, i] = v[k - 1, i] + h * ((1.0 - gamma) * a[i] + gamma * following)
            a[i] = following
        for i in range(r):
            side[i] = 0.0
            for j in range(loads):
                side[i] += at[6 * r + j, i] * f[k, j]
            for j in range(r):
                damping = at[r + i, j] + 2.0 * rate * at[3 * r + i, j]
                stiffness = (
                    at[2 * r + i, j]
                    + second * at[3 * r + i, j]
                    + rate * rate * at[4 * r + i, j]
                    + rate * at[5 * r + i, j]
                )
                side[i] -= damping * v[k, j] + stiffness * q[k, j]
                if not first:
                    at[i, j] += dv * damping + dq * stiffness
        for i in range(r):  # elimination without pivots: nearly symmetric, and M dominates
            for row in range(i + 1, r):
                share = at[row, i] / at[i, i]
                for j in range(i + 1, r):
                    at[row, j] -= share * at[i, j]
                side[row] -= share * side[i]
        for i in range(r - 1, -1, -1):
            for j in range(i + 1, r):
                side[i] -= at[i, j] * side[j]
            side[i] /= at[i, i]
        for i in range(r):
            acceleration[i] = side[i]
            if first:
                a[i] = side[i]
            else:
                a[i] += gain * side[i]
                v[k, i] += dv * side[i]
                q[k, i] += dq * side[i]
