"""Beams and booms of them on the compiled simulator, for studies that take hundreds of simulations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.compare.runs import run_from_start
from pmr.scene import Compare, Reduction, Scene, Simulation
from pmr.simulation import Excitation
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.studies import shared
from pmr.system.body import Trajectory, length_outputs
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Transverse displacement (T, o) in m at the outputs; `surplus` as `Trajectory` has it."""

    displacement: Array
    strained: Callable[[], Array]  # finds `strain`, which most runs of a study aren't asked for
    surplus: float = 0.0

    @cached_property
    def strain(self) -> Array:
        """Strain energy (T,) in J."""
        return self.strained()


def motion(system: System, excitation: Excitation) -> Motion:
    """Displacement and, from each body's modal coordinates z, the strain energy sum_i omega_i^2 z_i^2 / 2.

    Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
    """
    form = SystemForm.of(system)
    run = run_from_start(form, excitation)
    lengths, each = _lengths(system), list(systems.displacements(system, run).values())
    displacements = each[0] if len(each) == 1 else np.hstack(each)
    displacements = displacements if lengths.all() else displacements[:, lengths]  # copies take as long as the steps

    def strained() -> Array:
        return np.asarray(
            np.sum([_strain(form_of_body, run.bodies[name]) for name, form_of_body in form.forms.items()], 0)
        )

    return Motion(displacements, strained, run.surplus)


def _strain(form: ModalForm, run: Trajectory) -> Array:
    return np.asarray((run.q @ form.inverse.T) ** 2 @ form.omega2 / 2.0)


def _lengths(system: System) -> NDArray[np.bool_]:
    return np.concatenate([length_outputs(body) for body in system.bodies.values()])


def driven(scene: Scene) -> Scene:
    """The scene without what the full model's motion does not depend on: reduction, comparison, choice of simulator."""
    update = {"compare": Compare(against=()), "simulation": Simulation()}
    return shared.with_reduction(scene.model_copy(update=update), Reduction())
