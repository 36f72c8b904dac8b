r"""What drives a boom of several sections: its extensions, its loads, and what moves along with it.

Along the boom the frame of a section moves with its tail, :math:`X_i = s_1 + \dots + s_i`, so that a load
:math:`-M_i e_x X_i''` acts on it.  What its cylinder pushes with follows from the equations of motion like the force of
a pad.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike

from pmr.scene import Boom
from pmr.scene.boom_parts import DRIVEN
from pmr.scene.built import WEIGHT
from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Array, Floats
from pmr.simulation.excitation import Excitation
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import Body, Joined


def excitation_of(boom: Boom, system: Joined[Body]) -> Excitation:
    """Extensions by the sections' names, and a load for each ``section.input``."""
    stepping = TimeStepping(boom.time.end, boom.time.step, boom.time.rho_inf)
    loads: dict[str, SignalBase] = {}
    tails = list(accumulate(((path,) for path in boom.paths.values()), initial=()))
    for part, paths in zip(boom.sections, tails, strict=True):
        known: dict[str, SignalBase] = {load.name: load.signal for load in part.loads}
        known |= {WEIGHT: boom.gravity.signal, DRIVEN: Acceleration(paths=paths, step=stepping.step)}
        loads |= {f"{part.name}.{name}": known[name] for name in system.bodies[part.name].input_names}
    return Excitation(boom.paths, loads, stepping, boom.simulation)


class Acceleration(SignalBase):
    r"""The sum of some paths twice differentiated, m/s^2, as a step of h sees it: a kink is spread over one.

    .. math:: a(t) = \big(\dot s(t + h/2) - \dot s(t - h/2)\big) / h

    What moves at t = 0 has moved so before: no kink is there.
    """

    paths: tuple[SignalBase, ...]
    step: float

    def value(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        changes = [path.rate(t + half) - path.rate(before) for path in self.paths]
        return np.asarray(np.sum(changes, axis=0) / (t + half - before))

    def rate(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        return (self.value(t + half) - self.value(t - half)) / self.step

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for path in self.paths for b in path.breaks}))
