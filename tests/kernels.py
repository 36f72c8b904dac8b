"""Kernels of small systems, and what their modes are in coordinates of the bodies."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from terms import axial

from pmr import System
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.blocks import _ARRAY, _HEAD, _KINDS, LINE, round_up
from pmr.kernel.filter import ChosenOutputs, LinearSteps
from pmr.kernel.kernel import Kernel, pointer
from pmr.kernel.state import State
from pmr.simulation.modal import ModalForm, modal_form
from pmr.system.assembly import Assembly
from pmr.system.terms import Term


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


class Jacobian(NamedTuple):
    """Derivatives by the prediction (A, C, L) and by all drivers (B, D, K): of the next prediction, outputs, forces."""

    A: Array
    B: Array
    C: Array
    D: Array
    L: Array
    K: Array


def linearize(state: State, u: Array) -> Jacobian:
    """Derivatives of the next step, to drivers u, by a linear model of all outputs and forces."""
    kernel, here, o = state.kernel, state.save(), state.kernel.outputs
    shown = np.arange(o + kernel.forces)
    numbers = shown, np.zeros_like(shown), np.arange(kernel.drivers), np.arange(kernel.modes)
    steps = LinearSteps(ChosenOutputs(*(array.astype(np.int32) for array in numbers)), 1)
    steps.take(state, 0, u)
    state.restore(here)
    (A,), (B,) = steps.matrices.transitions()
    (C, L), (D, K) = (
        np.split(of[0], [o]) for of in (np.pad(steps.matrices.C, [(0, 0), (0, 0), (0, kernel.modes)]), steps.matrices.D)
    )
    return Jacobian(A, B, C, D, L, K)


def evaluate(state: State, motions: Array, seed: Sequence[Array] = ()) -> dict[str, Array]:
    """What pmr_evaluate finds under motions of a frame, or its derivatives along changes of motions, z and v."""
    kernel, arrays = state.kernel, [np.ascontiguousarray(array) for array in (motions, *seed)]
    sizes = {"accelerations": kernel.modes, "outputs": kernel.outputs, "further": kernel.further}
    found = {name: np.zeros(size) for name, size in (sizes | {"forces": kernel.forces}).items()}
    out = ffi.new("pmr_values *", {name: pointer(array) for name, array in found.items()})
    law = lib.pmr_evaluate_along if seed else lib.pmr_evaluate
    state.raise_unless_done(law(state.pointer, *map(pointer, arrays), 0, out), "an evaluation")
    return found


def unpack(block: bytes) -> dict[str, NDArray[Any] | str]:
    """Arrays and texts of a block by name, as `pmr.kernel.blocks.pack` took them, but without shapes."""
    _, _, count, _, _ = _HEAD.unpack_from(block)
    arrays = dict[str, NDArray[Any] | str]()
    for k in range(count):
        name, kind, _, size, at = _ARRAY.unpack_from(block, LINE * (1 + k))
        key = name.rstrip(b"\0").decode()
        text = kind == _KINDS["u"]
        arrays[key] = (
            bytes(block[at : at + size]).decode()
            if text
            else np.frombuffer(block, (np.int32, np.float64)[kind], size, at)
        )
    return arrays
