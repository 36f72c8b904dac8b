"""Arrays of a moving frame and of further outputs: forces on rigid supports, the tip, the luffing cylinder.

The last part of the module is a machine on outriggers: its data, and names and units of its outputs (src/ground.c).
`pmr.system.supports` has the equations of forces on rigid supports, `pmr_frame_outputs` of src/frame.c those of the tip
and the cylinder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.blocks import lines
from pmr.scene.built import force_name, reaction_name
from pmr.scene.ground import MachineMass, edge_rows
from pmr.scene.keys import LUFFING
from pmr.scene.mechanism import (
    AT_GROUND,
    CYLINDER,
    TIPPING_MARGIN,
    cylinder_force_names,
    ground_contact_wrenches,
    pin_and_cylinder,
)
from pmr.scene.scene import Scene
from pmr.system.body import kinds_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.supports import SupportForces
from pmr.system.system import System

Arrays = dict[str, NDArray[Any] | str]
#: Entries of a term's matrix below this share of its largest entry are round-off.
NEGLIGIBLE = 1e-13


class Modal(Protocol):
    """A body in coordinates of its own r modes (`pmr.simulation.modal.ModalForm`)."""

    @property
    def body(self) -> ReducedModel:
        """Reduced model in modes, with M = 1 and K diagonal."""

    @property
    def X(self) -> Array:
        """Modes X (n, r); the original coordinates of the body are q = X z with the coordinates z of the modes."""

    @property
    def rows(self) -> tuple[int, ...]:
        """Numbers, among the rows of the original body, of the rows that `body` has."""


def support_arrays(
    system: System, supports: Sequence[SupportForces], forms: Sequence[Modal], modes: Sequence[slice], width: int
) -> Arrays:
    """Arrays from which the kernel computes those parts of support reactions that rates of modes and terms cause.

    ``reaction_rates`` (r, width) holds the reaction per rate of each of r modes.  For each term of the system,
    ``support_first`` holds the number of its first entry.  ``support_entries`` (e, 2) holds, for each entry, the number
    of its reaction and the number of its mode.  If the entry is multiplied by the mode's rate, r is added to the number
    of the mode.  ``support_values`` (e,) holds the entries; negligible ones are left out.

    `supports`, the modal `forms` and `modes` have an item for each body; `modes` are the slices of the bodies' modes,
    padding included.  `width` is the number of reactions, padding included.
    """
    r = modes[-1].stop
    rates, first = np.zeros((r, width)), np.cumsum([0, *(len(of.names) for of in supports)])
    for of, form, place, at in zip(supports, forms, modes, first, strict=False):
        rates[place.start : place.start + form.X.shape[1], at : at + len(of.names)] = (of.rates @ form.X).T
    names, entries, values, counts = list(system.bodies), [np.zeros((0, 2), np.int64)], [np.zeros(0)], [0]
    for term in system.terms:
        bodies, count = [names.index(name) for name in term.bodies], 0
        X = scipy.linalg.block_diag(*(forms[k].X for k in bodies))
        numbers = np.concatenate([modes[k].start + np.arange(forms[k].X.shape[1]) for k in bodies])
        for k in bodies:
            for key, by_coordinates in supports[k].by_term(system, term, names[k]).items():
                table = by_coordinates @ X
                at = np.argwhere(np.abs(table) > NEGLIGIBLE * np.abs(table).max(initial=0.0))
                entries.append(np.column_stack([first[k] + at[:, 0], numbers[at[:, 1]] + r * (key == "damping")]))
                values.append(table[tuple(at.T)])
                count += len(at)
        counts.append(count)
    return {
        "reaction_rates": rates,
        "support_first": np.cumsum(counts),
        "support_entries": np.concatenate(entries),
        "support_values": np.concatenate(values),
    }


class PressingForces(NamedTuple):
    """Forces between boom and ground, by their numbers among outputs, reactions of supports and contact forces."""

    numbers: list[int]  # (K,): of those whose wrenches depend on P paths alone
    # K arrays (6, 1 + P): wrench about the pivot by 1 N with all paths at 0, then its change by 1 m of each path
    wrenches: list[Array]
    cylinder: int  # number of the force of a cylinder that holds the base; -1 without one


def pressing_forces(scene: Scene, paths: Sequence[str], numbers: Mapping[str, int]) -> PressingForces | None:
    """Forces with which the boom of a scene presses on the ground; None if `numbers` lacks one of them.

    `paths` are the names of the system's P paths.  `numbers` maps the names of outputs, reactions and contact forces to
    their numbers.
    """
    unit, still = np.eye(len(paths) + 1), np.zeros(len(paths) + 1)
    along = {name: unit[1 + paths.index(name)] if name in paths else still for name in scene.paths} | {LUFFING: still}
    pressing = PressingForces([], [], -1)
    for pressed in ground_contact_wrenches(scene, along):
        name = next((name for name in pressed.names if name in numbers), None)
        if name is None:
            return None
        if scene.holding_cylinder is not None and name in cylinder_force_names(scene):
            pressing = pressing._replace(cylinder=numbers[name])
            continue
        pressing.numbers.append(numbers[name])
        pressing.wrenches.append(np.vstack([pressed.wrench[:1], pressed.wrench[1:] - pressed.wrench[0]]).T)
    return pressing


def frame_output_arrays(frame: Frame | None, system: System, paths: Sequence[str], reactions: Sequence[str]) -> Arrays:
    """Arrays of tip, luffing cylinder and outriggers by their names in the kernel's block, and the counts ``further``.

    The arrays are:

    - ``further`` (3,): the number of `reactions` of rigid supports, then 1 if there is a tip, else 0, then 1 if the
      force of the luffing cylinder is computed, else 0;
    - ``tip_numbers`` (4,): the numbers of the tip's displacements along x, y and z, -1 for a displacement that is no
      output, then the number of paths that lead to the tip;
    - ``tip_place`` (3,): the tip's place in m from the pivot with all paths at 0;
    - ``pressing_numbers`` (K,) and ``pressing_wrenches`` (K, 6, 1 + P), flattened: those of `PressingForces`;
    - ``cylinder_hinges`` (4,): coordinates x, z in m of the cylinder's foot, then of its lug; zeros without a cylinder;
    - ``cylinder_pin`` (3,): the numbers of the pin's reactions along x and z, -1 if there are none, then the number of
      the force at the lug.  The array is missing if the force of the cylinder is not computed from moments;
    - the arrays of outriggers (`ground_arrays`).

    `paths` are the names of the P paths of the `system`, and `reactions` those of the reactions.  Without a `frame`,
    ``further`` is the only array.  If a force between boom and ground has no number, the arrays of the pressing forces,
    of the pin and of the outriggers are missing.
    """
    if frame is None or frame.scene.frame is None:
        return {"further": np.array([len(reactions), 0, 0])}
    scene, outputs, last = frame.scene, len(system.output_names), [*system.bodies.values()][-1]
    kinds, first, cylinder = list(kinds_of(last)), outputs - last.outputs.shape[0], frame.scene.frame.cylinder
    tip = [first + kinds.index(f"tip {axis}") if f"tip {axis}" in kinds else -1 for axis in "xyz"]
    arrays: Arrays = {
        "tip_numbers": np.array([*tip, len(scene.sections) - 1]),
        "tip_place": np.array(frame.scene.frame.tail_position) + [scene.sections[-1].length, 0.0, 0.0],
        "cylinder_hinges": np.array([0.0] * 4 if cylinder is None else [*cylinder.foot, *cylinder.lug]),
    }
    named = [*system.output_names, *reactions, *map(force_name, system.contact_names)]
    numbers = {name: k for k, name in reversed([*enumerate(named)])}
    pressing, turns = pressing_forces(scene, paths, numbers), False
    if pressing is not None:
        wrenches = np.array(pressing.wrenches).reshape(-1, 6, 1 + len(paths))
        arrays |= {"pressing_numbers": np.array(pressing.numbers, np.int64), "pressing_wrenches": wrenches.ravel()}
        turns = cylinder is not None and scene.holding_cylinder is None and bool(wrenches[:, 4].any())
        arrays |= ground_arrays(frame, pressing.cylinder)
    if turns:
        pin, held = (-1, -1, 0), pin_and_cylinder(scene)
        if held is not None and set(held.pin) <= set(numbers):
            across = next(numbers[name] for name in held.across if name in numbers)
            pin = (numbers[held.pin[0]] - outputs, numbers[held.pin[1]] - outputs, across)
        arrays["cylinder_pin"] = np.array(pin)
    return arrays | {"further": np.array([len(reactions), 1, int(turns)])}


def further_names(reactions: Sequence[str], arrays: Arrays) -> list[str]:
    """Names of further outputs: the `reactions`, then the tip in space and the luffing cylinder.

    The tip and the cylinder are left out if they have no arrays in `arrays`.
    """
    tip = [f"tip in space {axis}" for axis in "XYZ"] if "tip_numbers" in arrays else []
    return [*reactions, *tip, *([CYLINDER] if "cylinder_pin" in arrays else [])]


#: A quantity as a tuple, in which the axes x, y, z have the numbers 0, 1, 2:
#:
#: - ``("turned", i, j)``: R_ij of the rotation from axes of the boom into those of the ground,
#: - ``("velocity", k)`` in rad/s, ``("turning", k)`` in rad/s^2: angular velocity, acceleration in the frame's axes,
#: - ``("gradient", j, k)`` in 1/s^2: A_jk of the acceleration field,
#: - ``("shaken", i)`` in m/s^2: acceleration of the pivot along an axis of the ground,
#: - ``("gravity",)`` in m/s^2,
#: - ``("reach", n, d)``: position of the tail of section n on the axis in m, or its derivative of order d,
#: - ``("over", n)`` in 1/m: one over the extension of section n,
#: - ``("raised", k)``: component in the frame's axes of the direction that is up for the machine,
#: - ``("load", name)``: a load, by the name of its input.
Quantity = tuple[str | int, ...]


@dataclass(frozen=True)
class Product:
    """Product of a number, `factor`, and the values of the quantities `of`.

    A quantity is a tuple of its kind and numbers, as listed at `Quantity`, such as ``("reach", 1, 0)``.
    """

    factor: float
    of: tuple[Quantity, ...]

    def times(self, factor: float, *more: Quantity) -> Product:
        """Return this product multiplied by the number `factor` and by the quantities `more`."""
        return replace(self, factor=factor * self.factor, of=(*self.of, *more))


Products = tuple[Product, ...]
#: The quantity with the value 1, and the number of quantities of each product; missing ones are this quantity.
ONE, FACTORS = ("one",), 3
#: Kinds of quantities, in the order of their numbers in src/internal.h.
KINDS = ("one", "turned", "velocity", "turning", "gradient", "motion", "reach", "over", "raised")
ANGLES = ("luffing", "slewing", "base.rx", "base.ry", "base.rz")
AXES = ("base.x", "base.y", "base.z")


@dataclass(frozen=True)
class ComputedData:
    """Data of a luffing angle or extension that is free, so that its motion is computed."""

    arrays: Mapping[str, Array]  # of the kernel's block, by name
    outputs: Mapping[str, str]  # units of its outputs, by name
    #: by name, of each path that moves with a free extension, its own path first: the ratio to the extension, and the
    #: offset in m; empty for a luffing angle
    moved: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class Frame(Protocol):
    """Motions of a moving frame, and loads and amplitudes of terms that follow from them as sums of products."""

    @property
    def computed(self) -> ComputedData | None:
        """Data of a free luffing angle or extension; None if all motions are prescribed."""

    @property
    def scene(self) -> Scene:
        """Scene that the frame belongs to."""

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the n motions that drive the frame; paths come first."""

    @property
    def products(self) -> tuple[Products, ...]:
        """Products whose sums are, in this order, loads on i inputs, amplitudes of K terms, and drivers of a hoist."""


def frame_arrays(frame: Frame | None, paths: Sequence[str]) -> Arrays:
    """Arrays of a frame for a system with the paths named `paths`, by the arrays' names in the kernel's block.

    The result is empty if `frame` is None.  Raises InputError if the frame has no motion for one of the paths.
    """
    if frame is None:
        return {}
    numbers = {name: k for k, name in enumerate(frame.drivers)}
    if missing := [path for path in paths if path not in numbers]:
        raise InputError("system", "paths", missing[0], f"{', '.join(frame.drivers)} are allowed")
    products = [product for of_one in frame.products for product in of_one]
    quantities = dict.fromkeys([ONE, *(quantity for product in products for quantity in product.of)])
    at = {quantity: k for k, quantity in enumerate(quantities)}
    factors = [
        [at[quantity] for quantity in (*product.of, *[ONE] * (FACTORS - len(product.of)))] for product in products
    ]
    return {
        "frame_angles": np.array([numbers.get(name, -1) for name in ANGLES]),
        "frame_paths": np.array([numbers[path] for path in paths], np.int64),
        "quantity_list": np.array([_quantity(quantity, numbers) for quantity in quantities]),
        "products": np.array(factors, np.int64),
        "first_product": np.cumsum([0, *map(len, frame.products)]),
        "factors": np.array([product.factor for product in products], float),
        "names_motions": lines(frame.drivers),
    }


def _quantity(quantity: Quantity, numbers: dict[str, int]) -> list[int]:
    """Return three numbers by which the kernel reads a quantity: that of its kind in `KINDS`, and two arguments.

    An argument that the kind does not need is 0.  `numbers` has the numbers of the motions that drive the frame, by
    name.  Gravity, a load and a motion of the base have the kind ``motion``, with the driver's number as the first
    argument.  Gravity or a motion of the base that the scene lacks is 0; it is written as the kind ``reach`` of section
    0, which is always 0.
    """
    kind, *of = quantity
    if kind in ("gravity", "load", "shaken"):
        name = "gravity" if kind == "gravity" else AXES[int(of[0])] if kind == "shaken" else str(of[0])
        if name not in numbers and kind != "load":  # the scene has no weight, or no base that moves
            return [KINDS.index("reach"), 0, 0]  # sum over no paths: zero
        return [KINDS.index("motion"), numbers[name], 0]
    return [KINDS.index(str(kind)), *map(int, of), *[0] * (2 - len(of))]


#: Directions of force and moment on the ground, with their units.
DIRECTIONS = dict.fromkeys(("x", "y", "z"), "N") | dict.fromkeys(("rx", "ry", "rz"), "N m")


def ground_outputs(scene: Scene) -> dict[str, str]:
    """Units of those outputs that are quantities on a scene's ground, by the quantity's name.

    The outputs are, in their order, force and moment on the ground, forces of outriggers, margins against
    tipping, and the use of the support polygon.  The result is empty if the scene has no ground.
    """
    ground = None if scene.frame is None else scene.frame.ground
    if ground is None:
        return {}
    corners = [corner.name for corner in ground.corners]
    edges = zip(corners, (*corners[1:], corners[0]), strict=True)
    return {
        **{reaction_name(f"{AT_GROUND} {direction}"): unit for direction, unit in DIRECTIONS.items()},
        **{force_name(f"outrigger {outrigger.name}"): "N" for outrigger in ground.outriggers},
        **{f"{TIPPING_MARGIN}{first} to {second}": "N m" for first, second in edges},
        "use of the support polygon": "1",
    }


def mass_numbers(masses: Sequence[MachineMass]) -> Array:
    """Data (m, 8) of the m masses of a machine for the kernel, in SI units.

    Each row has the mass, the place (3) from the pivot, the moments of inertia (3), and 1 if the mass slews, else 0.
    """
    rows = [[mass.mass, *mass.at, *mass.inertia, mass.slews] for mass in masses]
    return np.array(rows, float).reshape(-1, 8)


def ground_arrays(frame: Frame, cylinder: int) -> Arrays:
    """Arrays of the outriggers, by name, of a scene in a `frame`; empty if the scene has no ground.

    ``ground_numbers`` (5,) has the numbers of three motions of the base and of gravity, -1 for one that does not drive
    the frame, and `cylinder`, the number of the force of a cylinder that holds the base.  The other arrays have the
    machine's masses, and corners, places, stiffness and tipping edges of the outriggers.
    """
    ground = None if frame.scene.frame is None else frame.scene.frame.ground
    if ground is None:
        return {}
    motions = [frame.drivers.index(name) if name in frame.drivers else -1 for name in (*AXES, "gravity")]
    places = [place for outrigger in ground.outriggers for place in outrigger.at]
    stiffness = [outrigger.stiffness for outrigger in ground.outriggers]
    edges = edge_rows(ground.polygon, ground.height).ravel()
    return {
        "ground_numbers": np.array([*motions, cylinder]),
        "ground_masses": mass_numbers(ground.masses).ravel(),
        "ground_corners": np.array(ground.corner_numbers),
        "ground_stand": np.array([ground.height, *places, *stiffness, *edges], float),
    }
