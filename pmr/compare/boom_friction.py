"""Friction of the pads along a boom, which what drives the sections has to overcome."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response
from pmr.scene import Boom
from pmr.scene.built import force_of
from pmr.simulate.booms import cylinder
from pmr.system.contacts import Contact

Array = NDArray[np.float64]


def friction(boom: Boom, contacts: Sequence[Contact], response: Response) -> dict[str, Array]:
    r"""What a section's pads resist sliding with, (T,) N by section, positive while it slides out.

    .. math:: \tanh(\dot s / v) \sum_k \mu_k |N_k|

    Coulomb's law with the forces N of the pads themselves; v is the joint's `friction_speed`.  The pads' friction also
    has a moment about the axis, half the section's height times that sum's parts on its two faces: neglected.
    """
    found = {}
    for part in boom.sections[1:]:
        assert part.joint is not None  # as the checks say
        own = [one for one in contacts if one.inner.body == part.name and one.friction]
        if own:
            columns = [response.force_names.index(force_of(one.name)) for one in own]
            resisting = np.abs(response.slider_force[:, columns]) @ [one.friction for one in own]
            found[part.name] = np.tanh(boom.paths[part.name].rate(response.t) / part.joint.friction_speed) * resisting
    return found


def with_friction(boom: Boom, contacts: Sequence[Contact], response: Response) -> Response:
    """With the forces of cylinders that overcome the friction of the pads, too.

    Sections hardly give way along the boom, and a joint's friction acts between the two sections that its cylinder
    joins: it adds to that cylinder's force, and to no other one's.
    """
    forces, peaks = response.slider_force.copy(), response.force_peaks
    peaks = None if peaks is None else peaks.copy()
    for name, resisting in friction(boom, contacts, response).items():
        column = response.force_names.index(force_of(cylinder(name)))
        forces[:, column] += resisting
        if peaks is not None:
            peaks[:, column] += resisting
    return replace(response, slider_force=forces, force_peaks=peaks)
