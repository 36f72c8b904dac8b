"""What a body on its way asks of a simulator (`pmr.scene.simulators` has what each can do)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.model import ReducedModel
from pmr.scene.simulators import Needs
from pmr.simulation.excitation import Excitation
from pmr.simulation.start import row_flexibility
from pmr.system.body import Body, WithRows
from pmr.system.system import Joined

Array = NDArray[np.float64]


def needs_of(body: ReducedModel | WithRows, s: float) -> Needs:
    """Of a reduced body, or a full one wherever its matrices are, with its slider at s m, wherever it goes.

    An InputError is raised of a model that is but a section of a boom.
    """
    body.ensure_whole("model")
    rigid, pushing = row_flexibility(body, s)[1], ~np.isnan(body.row_clearance)
    names, both, giving = (
        tuple(body.row_names[k] for k in np.flatnonzero(which)) for which in (pushing, pushing & rigid, ~rigid)
    )
    return Needs(pushing=names, rigid_pushing=both, giving=giving)


def needs_on(body: ReducedModel | WithRows, excitation: Excitation) -> Needs:
    """Of such a body that is excited."""
    s, travels = float(excitation.s[0, 0]), bool(np.any(excitation.s != excitation.s[0]))
    rigid = row_flexibility(body, s)[1]
    return replace(
        needs_of(body, s),
        rigid_moving=tuple(body.row_names[k] for k in body.moving if travels and rigid[k]),
        rho_inf=excitation.stepping.rho_inf,
    )


def needs_of_contacts(system: Joined[Body], rigid: NDArray[np.bool_], x: Array, rho_inf: float) -> Needs:
    """Of bodies that contacts join, some of which (m,) are rigid, with their places along x (T, sides) m."""
    pushing, moving = ~np.isnan(system.clearance), np.zeros(len(rigid), bool)
    for side, at in zip(system.sides, x.T, strict=True):
        moving[side.contact] |= np.any(at != at[0])

    def names(which: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(name for name, chosen in zip(system.contact_names, which, strict=True) if chosen)

    return Needs(
        pushing=names(pushing),
        rigid_pushing=names(pushing & rigid),
        giving=names(~rigid),
        rigid_moving=names(rigid & moving),
        rho_inf=rho_inf,
    )
