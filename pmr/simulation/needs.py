"""What bodies on their way ask of a simulator (`pmr.scene.simulators` has what each can do)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.scene.simulators import Needs
from pmr.system.body import Body
from pmr.system.friction import Friction
from pmr.system.system import Joined

Array = NDArray[np.float64]


def needs_of(system: Joined[Body], rigid: NDArray[np.bool_], x: Array, rho_inf: float) -> Needs:
    """Needs of bodies that contacts join, of which a mask (m,) has the rigid ones, along x (T, sides) m."""
    pushing, moving = ~np.isnan(system.clearance), np.zeros(len(rigid), bool)
    for side, at in zip(system.sides, x.T, strict=True):
        moving[side.contact] |= np.any(at != at[0])

    rubs = Friction.of(system.contacts)

    def names(which: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(name for name, chosen in zip(system.contact_names, which, strict=True) if chosen)

    return Needs(
        pushing=names(pushing),
        rigid_pushing=names(pushing & rigid),
        giving=names(~rigid),
        rigid_moving=names(rigid & moving),
        rubbing=() if rubs is None else tuple(system.contact_names[k] for k in rubs.pads),
        rho_inf=rho_inf,
    )
