r"""Sections that hang on ropes or chains that other ones drive: the force in these, how long and stiff they are.

A rope from the head of section k - 2 over a sheave at the head of section k - 1 to the tail of section k has

.. math:: l = (s_{k-1} + L_{k-1} - L_{k-2}) + (L_{k-1} - s_k), \qquad k = z\, EA / l

with the extensions s, the sections' lengths L and z strands.  Section k goes as far as section k - 1 does,
:math:`s_k = s_{k-1} + c`, so that l and its stiffness are the same all along the way.  Any other rope, from a winch
say, is as long as its keys say, :math:`l = l_0 + l' s_k`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.scene.names import cylinder_of
from pmr.scene.scene import Scene

Array = NDArray[np.float64]


def rope_shares(scene: Scene) -> dict[str, dict[str, float]]:
    r"""Shares of the sections' forces along the boom that a rope or cylinder carries, by the section it moves.

    :math:`T_j = F_j + \sum_{k\ \mathrm{follows}\ j} r_k T_k`, of each section that follows another one, is followed
    or hangs on a rope.
    """
    names = scene.names[1:]
    follows = {name: scene.joint(k).follows for k, name in enumerate(names, 1)}
    ropes = {name for k, name in enumerate(names, 1) if scene.joint(k).rope is not None}
    joined = [name for name in names if follows[name] is not None or name in {*follows.values(), *ropes}]

    def shares_of(name: str) -> dict[str, float]:
        shares = {name: 1.0}
        for other in joined:
            if follows[other] == name:
                ratio = scene.joint(scene.names.index(other)).ratio
                for carried, share in shares_of(other).items():
                    shares[carried] = shares.get(carried, 0.0) + ratio * share
        return shares

    return {name: shares_of(name) for name in joined}


def drive_rows(scene: Scene, forces: Sequence[str]) -> dict[str, Array]:
    """Forces of what moves each section along the boom: shares (m,) of the forces with these names, by section.

    Of a section on ropes, or that others follow, it is T of `rope_shares`, of any other the force of its cylinder; not
    a number where a cylinder is not among the names.
    """
    shares = {name: {name: 1.0} for name in scene.names[1:]} | rope_shares(scene)
    rows = {name: np.zeros(len(forces)) for name in shares}
    for name, row in rows.items():
        for section, share in shares[name].items():
            if cylinder_of(section) in forces:
                row[forces.index(cylinder_of(section))] += share
            else:
                row[:] = np.nan
    return rows


def rope_length(scene: Scene, number: int) -> float | None:
    """Length of the rope of a section, 1 or more, in m, where the section's extension is 0.

    None without one, or where it goes another way and none is given.
    """
    joint = scene.joint(number)
    if joint.rope is None or joint.rope.length is not None:
        return None if joint.rope is None else joint.rope.length
    if number < 2 or joint.follows != scene.names[number - 1] or joint.ratio != 1.0:
        return None
    length = 2.0 * scene.sections[number - 1].length - scene.sections[number - 2].length - joint.offset
    return length if length > 0.0 else None


def longest(scene: Scene, number: int) -> float:
    """Greatest length of such a rope on the whole way, m; negative where it is used up on the way."""
    rope, length = scene.joint(number).rope, rope_length(scene, number)
    assert rope is not None and length is not None  # as the scene's checks say
    ends = [length + rope.lengthens * s for s in scene.extension(number).bounds(0.0, scene.time.end)]
    return max(ends) if min(ends) > 0.0 else min(ends)


@dataclass(frozen=True)
class Drive:
    """How what holds a section along the boom gives way under the force that it bears."""

    compliance: float  # m/N, where the section's extension is 0
    lengthening: float = 0.0  # 1/N: by how much that grows with the extension

    @classmethod
    def of(cls, scene: Scene, number: int) -> Drive:
        """Drive of a section, 1 or more."""
        joint = scene.joint(number)
        if joint.rope is not None:
            length, EA = rope_length(scene, number), joint.rope.strands * joint.rope.EA
            assert length is not None  # as the scene's checks say
            return cls(length / EA, joint.rope.lengthens / EA)
        return cls(0.0 if joint.cylinder.stiffness == "rigid" else 1.0 / float(joint.cylinder.stiffness))
