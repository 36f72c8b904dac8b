"""The ANCF cable as a reference: the scene's beam, its motion, and what that says beside other responses."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pmr.errors.environment import needed
from pmr.results import Response
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn.ancf import Cable

if TYPE_CHECKING:
    from pmr.simulation.exudyn import ancf

Done = Callable[[float], None]


def cable_of(scene: Scene) -> Cable:
    """The scene's beam as an ANCF cable."""
    profile = scene.body.profile
    assert profile is not None and profile.axial_stiffness is not None  # the scene's check
    return Cable(
        length=profile.length,
        axial_stiffness=profile.axial_stiffness,
        bending_stiffness=profile.bending_stiffness,
        mass_per_length=profile.mass_per_length,
        elements=scene.compare.ancf_elements,
    )


def simulate_cable(scene: Scene, x: ArrayLike, excitation: Excitation, done: Done | None = None) -> ancf.CableMotion:
    """Motion of that cable at the material points x (o,) in m.

    Raises InputError if Exudyn is not installed, and as for `pmr.simulation.exudyn.ancf.simulate`; SimulationError if a
    step fails or a result is not finite.
    """
    needed("exudyn")
    from pmr.simulation.exudyn import ancf

    return ancf.simulate(cable_of(scene), scene.alone.load_places, excitation, np.asarray(x, dtype=float), done)


def response(scene: Scene, x: ArrayLike, done: Done | None = None) -> Response:
    """Response of the ANCF reference; its joint holds a point in space, so the rows' residuals do not apply: NaN."""
    motion = simulate_cable(scene, x, Excitation.of(scene), done)
    from pmr.simulation.exudyn import ancf

    unknown = np.full(len(motion.t), np.nan)
    return Response(
        t=motion.t,
        x=motion.x,
        displacement=motion.displacement,
        energy=ancf.energy(cable_of(scene), motion),
        slider_force=motion.slider_force[:, None],
        residual_position=unknown,
        residual_velocity=unknown,
        seconds=motion.seconds,
    )
