"""Impulses that generalized-alpha gives forces which are known at every part of every step.

Momentum changes by h ((1 - gamma) a_n + gamma a_{n+1}) with (1 - alpha_m) a_{n+1} + alpha_m a_n = (1 - alpha_f) F_{n+1}
+ alpha_f F_n, and a = F where a step begins in other parts than the one before (Arnold, Bruels: Convergence of the
generalized-alpha scheme for constrained mechanical systems, Multibody System Dynamics 18, 2007, equations 5 to 7).
"""

import numpy as np
from generalized_alpha import GeneralizedAlpha
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.simulation import TimeStepping


def impulses(stepping: TimeStepping, parts: NDArray[np.int64], fine: Array) -> Array:
    """Impulses (T, k) in N s of k forces within each step; those of the first row are zero.

    `fine` are the forces (P, k) in N at the P finest parts of steps, `parts` (T,) the number of parts of each step.
    """
    finest, a, last = int(parts.max()), fine[0], int(parts[min(1, len(parts) - 1)])
    found = np.zeros((len(parts), fine.shape[1]))
    for step, count in enumerate(parts.tolist()[1:], 1):
        method, stride = GeneralizedAlpha(stepping.step / count, stepping.rho_inf), finest // count
        if count != last:
            a, last = fine[(step - 1) * finest], count
        for at in range((step - 1) * finest + stride, step * finest + 1, stride):
            weighed = (1.0 - method.alpha_f) * fine[at] + method.alpha_f * fine[at - stride]
            ahead = (weighed - method.alpha_m * a) / (1.0 - method.alpha_m)
            found[step] += method.step * ((1.0 - method.gamma) * a + method.gamma * ahead)
            a = ahead
    return found
