"""Kernels of small systems, and what their modes are in coordinates of the bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from terms import axial

from pmr import System
from pmr.kernel.blocks import round_up
from pmr.kernel.kernel import Kernel
from pmr.simulation.modal import ModalForm, modal_form
from pmr.system.assembly import Assembly
from pmr.system.terms import Term

Array = NDArray[np.float64]


def kernel_of(system: System) -> tuple[Kernel, Mapping[str, ModalForm]]:
    """Kernel of a system, and modal forms of its bodies."""
    forms = {name: modal_form(body) for name, body in system.bodies.items()}
    return Kernel.of(system, forms), forms


def motions_of(system: System, forms: Mapping[str, ModalForm], kernel: Kernel) -> Array:
    """Motions (n, modes) of the assembled bodies' n coordinates for a unit of each mode of the kernel."""
    assembly = Assembly(system)
    motions, first = np.zeros((assembly.size, kernel.modes)), 0
    for name, form in forms.items():
        r = form.body.size
        motions[assembly.coordinate_slices[name], first : first + r] = form.X[assembly.free_coordinates[name]]
        first += round_up(r)
    return motions


def coupled(system: System) -> System:
    """Give each body of a system a damping that couples its modes."""
    bodies = {
        name: replace(body, D=body.D + 20.0 * np.ones((body.size, body.size)), rayleigh=None)
        for name, body in system.bodies.items()
    }
    return replace(system, bodies=bodies)


def varying(system: System) -> System:
    """Give a system terms that vary in time: a stiffness on each of two bodies, and dashpots on all."""
    dashpots = [
        Term(f"dashpot {name}", (name,), damping=np.diag(np.arange(1.0, body.size + 1.0)))
        for name, body in system.bodies.items()
    ]
    return replace(system, terms=(*axial(system)[:2], *dashpots))


def rubbing(system: System, stiffness: float, at_rest: float = 0.0) -> System:
    """Give the contacts of a system friction at pads off the axis, with another coefficient at rest.

    Paths move at about the Stribeck speed.
    """
    how = {"friction": 0.3, "arm": 0.18, "shear_stiffness": stiffness, "static_friction": at_rest}
    rough = [replace(one, **how, stribeck_speed=0.3) for one in system.contacts]
    return replace(system, contacts=tuple(rough))
