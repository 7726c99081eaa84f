"""Dynamic time warping, in compiled code."""

import numpy as np

from poseloom.arrays import Array, Floats, Ints, compiled


@compiled
def warp_path(
    first: Floats[Array, "rows columns"], second: Floats[Array, "others columns"], path: Ints[Array, "steps 2"]
) -> tuple[float, int]:
    """The cheapest monotonous path from the first pair of rows to the last.

    A step goes on in the first series, in the second, or in both; the cost of a path is the sum of the squared
    distances of its pairs. `path` must hold as many rows as both series together; it is filled from its end backwards.

    Returns:
        The cost, and the row of `path` at which the path begins.
    """
    n, m = first.shape[0], second.shape[0]
    cost = np.empty((n, m))
    came = np.empty((n, m), dtype=np.int64)
    for i in range(n):
        for j in range(m):
            apart = 0.0
            for k in range(first.shape[1]):
                difference = first[i, k] - second[j, k]
                apart += difference * difference
            # Straight on is preferred where ways are equal: it warps least.
            best, step = 0.0, 0
            if i > 0 and j > 0:
                best, step = cost[i - 1, j - 1], 1
            if i > 0 and (step == 0 or cost[i - 1, j] < best):
                best, step = cost[i - 1, j], 2
            if j > 0 and (step == 0 or cost[i, j - 1] < best):
                best, step = cost[i, j - 1], 3
            cost[i, j] = best + apart
            came[i, j] = step
    i, j, at = n - 1, m - 1, path.shape[0] - 1
    while True:
        path[at, 0] = i
        path[at, 1] = j
        if i == 0 and j == 0:
            break
        step = came[i, j]
        if step == 1:
            i -= 1
            j -= 1
        elif step == 2:
            i -= 1
        else:
            j -= 1
        at -= 1
    return float(cost[n - 1, m - 1]), at
