r"""Ropes and chains that move sections with others: their forces, and that of the cylinder that pulls all of them.

A section k with :math:`s_k = r_k s_j + c_k` hangs on a rope that the joint j drives.  By virtual work, with
:math:`F_k` what the section needs along the boom from the next outer one if each had a cylinder of its own,

.. math::
    T_j = F_j + \sum_{k\ \mathrm{follows}\ j} r_k T_k

is what the rope or cylinder of the joint j pushes with, all of its strands together, and :math:`T_j \dot s_j` of a
cylinder the power for all that it moves.  Friction of the joints' pads is in it, that of sheaves is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.pad_forces import PULLED
from pmr.compare.summary import Part
from pmr.results import Response
from pmr.results.extremes import Extremes
from pmr.results.quantities import with_unit
from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.scene.keys import cylinder_of
from pmr.scene.mechanism import drive_rows, longest, rope_shares

Array = NDArray[np.float64]


def forces(scene: Scene, response: Response) -> dict[str, Array]:
    """Force of each section that follows another one or is followed, by its name, (T,) N, positive where it pushes out.

    Empty without ropes, or where forces along the boom are not known.
    """
    shares = rope_shares(scene)
    if any(force_of(cylinder_of(name)) not in response.force_names for name in shares):
        return {}
    cylinders = [name for name in map(cylinder_of, scene.names[1:]) if force_of(name) in response.force_names]
    forces_of_all = np.array([response.force(force_of(name), 0) for name in cylinders])
    return {name: row @ forces_of_all for name, row in drive_rows(scene, cylinders).items() if name in shares}


def part(scene: Scene, response: Response) -> Part:
    """``ropes``: ``name``, what it ``follows`` or None, and of its ``force`` in N the extremes, when and where.

    Of what follows nothing also the ``power`` in W that moves it and all that follow; of a rope whose EA is known its
    ``length`` in m, the largest on the way, and the ``stiffness`` in N/m that it has there, of all strands together.
    """
    if len(scene.sections) < 2:
        return Part()
    along, rows, slack = scene.along(response.t), list[Mapping[str, Any]](), list[str]()
    round_off = response.force_floor
    for name, force in forces(scene, response).items():
        number = scene.names.index(name)
        follows = scene.joint(number).follows
        extremes = Extremes.of(force, response.t, along)
        row: dict[str, Any] = {"name": name, "follows": follows, "force": extremes.summary()}
        if follows is None:
            power = force * scene.paths[name].rate(response.t)
            row["power"] = Extremes.of(power, response.t, along).summary()
        if (rope := scene.joint(number).rope) is not None:
            length = longest(scene, number)
            row |= {"length": length, "stiffness": rope.strands * rope.EA / length}
        rows.append(row)
        if (rope or follows) and -extremes.least > max(PULLED * extremes.most, round_off):
            most = f"{with_unit(-extremes.least, 'N')} {response.when(extremes.t_least)}"
            slack.append(
                f"the rope of {name} would have to push with up to {most}: the model holds both ways, as with a second "
                "rope that pulls the section in"
            )
    return Part({"ropes": rows} if rows else {}, grave=slack)
