"""What of a moving frame and of second order the full models of a scene are built with."""

from __future__ import annotations

from pmr.scene import Scene
from pmr.scene.frame_terms import frame_terms, stress_terms


def wanted_matrices(scene: Scene) -> tuple[str, ...]:
    """Names among `ROTATING`, `CARRIED` and `STATES` of `pmr.reduced.matrices`; none costs anything unless named.

    Without second order those of stresses are built all the same: they say how much is left out.
    """
    return tuple(dict.fromkeys(term.matrix for term in (*frame_terms(scene), *stress_terms(scene))))
