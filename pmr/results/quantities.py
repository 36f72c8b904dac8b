"""The table of quantities: what results state, its name, unit and sign, and how it follows from a response.

Summaries, warnings, tables, pages, studies and load charts ask this table (`QUANTITIES`, by the keys of summaries and
studies).  A quantity that can limit a load chart has a `Measure`: one value of all columns at each time of a run's
`Response`, and in each state of a load chart.  So a limit of a chart and the number in a run's results are one
function.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.results.response import Extreme, Extremes, Response
from pmr.scene.built import force_name, reaction_name
from pmr.scene.keys import cylinder_name
from pmr.scene.mechanism import AT_PIVOT, CYLINDER, drive_rows, rope_shares
from pmr.scene.scene import Scene

Array = NDArray[np.float64]
#: Function from the values (T, c) of all columns to one quantity (T,).
Measure = Callable[[Array], Array]

#: Direction in the name of a support's row: ``base pivot x``, ``base support z at 2 m``.
DIRECTION = re.compile(r" r?[xyz](?= (?:at|on) |$)")
#: SI prefixes of values in sentences.
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"))
REACTION, PIVOT, FORCE = reaction_name(""), reaction_name(f"{AT_PIVOT} "), force_name("")
#: Matrices A of the von Mises stress squared, s^T A s, by the stress components s that models have.
MISES: Mapping[tuple[str, ...], Array] = {
    ("axial",): np.eye(1),
    ("axial", "torsion"): np.diag([1.0, 3.0]),
    ("along", "across", "shear"): np.array([[1.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 3.0]]),
    ("xx", "yy", "zz", "yz", "xz", "xy"): np.block(
        [[1.5 * np.eye(3) - 0.5, np.zeros((3, 3))], [np.zeros((3, 3)), 3.0 * np.eye(3)]]
    ),
}


@dataclass(frozen=True)
class Columns:
    """Meaning of c columns of values, which are outputs and forces.

    Attributes
    ----------
    names, kinds, units, bodies : tuples of str, (c,)
        Kinds without directions, such as ``"tip"``; forces by the names of their contacts.
    drives : mapping
        By section, shares (c,) of the columns whose sum is the force that moves the section along the boom
        (`pmr.scene.mechanism.drive_rows`).
    ropes : tuple of str
        Sections that hang on ropes, or that others on ropes follow.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    units: tuple[str, ...]
    bodies: tuple[str, ...]
    drives: Mapping[str, Array] = field(default_factory=dict)
    ropes: tuple[str, ...] = ()

    @classmethod
    def from_scene(cls, scene: Scene, response: Response) -> Columns:
        """Return the meaning of the columns of a scene's response, in the order of `values_of`."""
        outputs = response.outputs
        names = tuple(output.name.removeprefix(FORCE) for output in outputs)
        return cls(
            names,
            tuple(output.kind for output in outputs),
            tuple(output.unit for output in outputs),
            tuple(output.body for output in outputs),
            drive_rows(scene, names),
            tuple(rope_shares(scene)),
        )

    def numbers_of_kind(self, *kinds: str) -> list[int]:
        """Return the numbers of the columns of these kinds."""
        return [k for k, kind in enumerate(self.kinds) if kind in kinds]

    def pivot_columns(self) -> dict[str, int]:
        """Return the columns of forces and moments at the pivot, by direction, and of the luffing cylinder.

        Of several columns with one name the last counts.
        """
        return {name.removeprefix(PIVOT): k for k, name in enumerate(self.names) if name.startswith(PIVOT)}

    def stress_columns(self) -> dict[str, dict[str, int]]:
        """Return the columns of the stress at probes, by probe and component."""
        by_probe = dict[str, dict[str, int]]()
        for k in self.numbers_of_kind("probe"):
            probe, separator, component = self.names[k].rpartition(" stress ")
            if separator:
                by_probe.setdefault(probe, {})[component] = k
        return by_probe


def values_of(response: Response) -> Array:
    """Return all columns of a response side by side, (T, c), in the order of `Columns.from_scene`."""
    parts = [response.displacement, response.slider_force, response.others]
    return np.hstack([part for part in parts if part is not None])


#: Called with columns, and a function that tells of a name whether a limit depends on it; returns the `Measure` of the
#: columns with such names, None if there are none of them.
MeasureOf = Callable[[Columns, Callable[[str], bool]], Measure | None]


@dataclass(frozen=True)
class Quantity:
    """Quantity that results state.

    Attributes
    ----------
    key : str
        In summaries, studies and options, such as ``"pad_force"``.
    label : str
        Name in the plural, as in "off by 3 % in pad forces".
    unit : str
    place : str
        What it belongs to: ``"section"``, ``"tip"``, ``"pad"``, ``"cylinder"``, ``"rope"``, ``"support"``,
        ``"machine"``, ``"ground"``, ``"probe"`` or ``"boom"``.
    kinds : tuple of str
        Kinds of the columns of a response that hold it (`pmr.results.response.KINDS`).
    reported : str
        Name of the one number that is reported of it, such as ``"largest pad force"``; empty without one.
    extreme : ``"size"``, ``"most"`` or ``"least"``
        Which of its values is reported: the largest absolute one (with its sign), the largest, or the smallest.
    sign : str
        What a positive value means; empty if it has no sign, or that of the axes.
    limit : str
        Key of a load chart's limit on it; empty if charts have none.
    measure : MeasureOf, optional
        Returns, for the columns of a chart, the `Measure` that is limited; a larger value is worse.
    """

    key: str
    label: str
    unit: str
    place: str
    kinds: tuple[str, ...] = ()
    reported: str = ""
    extreme: str = "size"
    sign: str = ""
    limit: str = ""
    measure: MeasureOf | None = None

    def histories(self, response: Response) -> dict[str, Array]:
        """Return the columns (T,) of a response that hold the quantity, by name, in the sense of `Response.column`."""
        outputs = enumerate(response.outputs)
        return {output.name: response.column(k) for k, output in outputs if output.kind in self.kinds}

    def value(self, extremes: Extremes) -> Extreme:
        """Return the extreme that is reported."""
        return {"size": extremes.largest, "most": extremes.highest, "least": extremes.lowest}[self.extreme]


def with_unit(value: float, unit: str) -> str:
    """Return a value with three digits and its unit as text, with an SI prefix from a thousand on."""
    size, prefix = next(((size, name) for size, name in _PREFIXES if abs(value) >= size), (1.0, ""))
    return f"{value / size:.3g} {prefix}{unit}"


def _largest_measure(numbers: Sequence[int]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the largest absolute one (T,) of these columns.

    None if `numbers` is empty.
    """
    chosen = list(numbers)
    return (lambda values: np.abs(values[:, chosen]).max(axis=1)) if chosen else None


def _force_measure(kind: str) -> Callable[[Columns, Callable[[str], bool]], Measure | None]:
    """Return a function that makes of columns the `Measure` of the largest absolute force of a kind of contact."""

    def measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
        """Return the measure of the forces with names that a limit looks at; None without any."""
        return _largest_measure([k for k in columns.numbers_of_kind(kind) if looks_at(columns.names[k])])

    return measure


def _support_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the largest resultant force of a support, (T,).

    Supports are rigid or not; `looks_at` tells of a name whether a limit depends on it.  Moments count only if no force
    column is chosen; columns at the pivot of a boom never do.  None if no column is chosen.
    """
    at_pivot = set(columns.pivot_columns().values())
    numbers = [k for k in columns.numbers_of_kind("support", "reaction") if k not in at_pivot]
    chosen = [k for k in numbers if any(looks_at(name) for name in support_names(columns, k))]
    groups = dict[str, list[int]]()
    for k in [k for k in chosen if columns.units[k] == "N"] or chosen:
        groups.setdefault(DIRECTION.sub("", support_names(columns, k)[1]), []).append(k)
    if not groups:
        return None
    return lambda values: np.max([np.linalg.norm(values[:, of], axis=1) for of in groups.values()], axis=0)


def support_names(columns: Columns, number: int) -> tuple[str, ...]:
    """Return both names of a support's column: its own, and that of its contact, such as ``base pivot x``."""
    body, name = columns.bodies[number], columns.names[number]
    row = name.removeprefix(REACTION).removeprefix(f"{body}: ").removeprefix(FORCE)
    return name, f"{body} {row}".strip()


def _cylinder_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the largest force that moves a section, (T,).

    `looks_at` tells of the name of a section's cylinder whether a limit depends on it; None if it depends on none.  The
    force is that of `pmr.scene.mechanism.drive_rows`: of the cylinder or, for a section on ropes or that others follow,
    a sum over several cylinders.
    """
    return _drive_measure([row for name, row in columns.drives.items() if looks_at(cylinder_name(name))])


def _rope_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the largest force of ropes or what moves them, (T,).

    These are the forces that move sections on ropes, or sections that others on ropes follow; `looks_at` tells of a
    section's name whether a limit depends on it.  None if it depends on none.
    """
    return _drive_measure([columns.drives[name] for name in columns.ropes if looks_at(name)])


def _drive_measure(rows: Sequence[Array]) -> Measure | None:
    """Return a function from values (T, c) to the largest absolute force (T,) over rows of shares (c,).

    None if there are no rows.
    """
    if not rows:
        return None
    shares = np.array(rows).T
    return lambda values: np.abs(values @ shares).max(axis=1)


def _deflection_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the displacement (T,) of the last section's tip.

    It is the length of the vector over all directions; None without a tip.
    """
    tips = columns.numbers_of_kind("tip")
    last = [k for k in tips if columns.bodies[k] == columns.bodies[tips[-1]]]
    return (lambda values: np.sqrt(np.sum(values[:, last] ** 2, axis=1))) if last else None


def _stress_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the largest von Mises stress (T,) at probes.

    `looks_at` tells of a probe's name whether a limit depends on it; None if it depends on none.
    """
    groups = dict[tuple[str, ...], list[list[int]]]()
    for probe, components in columns.stress_columns().items():
        if looks_at(probe):
            groups.setdefault(tuple(components), []).append(list(components.values()))
    if not groups:
        return None
    at_probes = [(names, np.array(numbers)) for names, numbers in groups.items()]
    return lambda values: np.max([von_mises_stress(values[:, k], names).max(axis=1) for names, k in at_probes], axis=0)


def _luffing_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from values (T, c) of all columns to the luffing cylinder's absolute force (T,).

    None without a luffing cylinder; its name is not asked for.
    """
    return _largest_measure([k for k in columns.pivot_columns().values() if columns.names[k] == CYLINDER])


#: Which way forces of what moves a section, or raises the boom, are positive.
PUSHES = "pushes"

#: All quantities, by their keys.
QUANTITIES: Mapping[str, Quantity] = {
    quantity.key: quantity
    for quantity in (
        # motion
        Quantity("beam", "displacements", "m", "section", ("beam", "tip")),
        Quantity(
            "tip", "displacements of the tip", "m", "tip", ("tip",), "largest deflection of the tip",
            limit="deflection", measure=_deflection_measure,
        ),
        Quantity("largest", "largest displacement", "m", "section", ("beam", "tip"), "largest displacement"),
        Quantity("velocity", "velocities", "m/s", "section"),
        Quantity("frequency", "natural frequencies", "Hz", "boom", (), "lowest natural frequency", "least"),
        # forces within the boom
        Quantity(
            "pad_force", "pad forces", "N", "pad", ("pad",), "largest pad force",
            sign="pushes the sections apart, or the body inwards", limit="pad", measure=_force_measure("pad"),
        ),
        Quantity(
            "cylinder_force", "cylinder forces", "N", "cylinder", ("cylinder",),
            "largest force of a cylinder that extends", sign=PUSHES, limit="cylinder", measure=_cylinder_measure,
        ),
        Quantity(
            "rope_force", "rope forces", "N", "rope", (), "largest rope force", limit="rope", measure=_rope_measure
        ),
        Quantity(
            "luffing_force", "forces of the luffing cylinder", "N", "cylinder", (),
            "largest force of the luffing cylinder", sign=PUSHES, limit="luffing", measure=_luffing_measure,
        ),
        # forces on what holds it
        Quantity("support_force", "forces of supports that give way", "N", "support", ("support",)),
        Quantity("reaction", "reactions of rigid supports", "N", "support", ("reaction",)),
        Quantity(
            "support", "forces of supports", "N", "support", ("support", "reaction"), "largest force of a support",
            limit="support", measure=_support_measure,
        ),
        Quantity("support_moment", "moments of supports", "N m", "support", (), "largest moment of a support"),
        Quantity(
            "machine_force", "forces on the machine", "N", "machine", (), "largest force of the boom on its machine"
        ),
        Quantity(
            "machine_moment", "moments on the machine", "N m", "machine", (),
            "largest moment of the boom on its machine, about the pivot",
        ),
        Quantity(
            "ground_force", "forces on the ground", "N", "ground", (), "largest force of the machine on the ground"
        ),
        Quantity(
            "ground_moment", "moments on the ground", "N m", "ground", (), "largest moment of the machine on the ground"
        ),
        # strength
        Quantity(
            "stress", "stresses", "Pa", "section", (), "largest von Mises stress", "most",
            limit="stress", measure=_stress_measure,
        ),
        Quantity("field", "stresses of walls", "Pa", "section", limit="field", measure=_stress_measure),
        Quantity("probe", "what probes measure", "", "probe", ("probe",)),
        Quantity(
            "utilisation", "stresses over yield stresses", "1", "section", (), "largest stress over yield stress",
            "most",
        ),
        Quantity("damage", "damage by fatigue", "1", "probe", (), "largest damage by fatigue", "most"),
        Quantity("buckling", "buckling factors", "1", "boom", (), "buckling factor", "least"),
    )
}  # fmt: skip
#: Those that a load chart can limit, by the keys of its limits.
LIMITED = {quantity.limit: quantity for quantity in QUANTITIES.values() if quantity.measure is not None}


def error_label(name: str) -> str:
    """Return the name of an error of summary.json, such as ``pad_force_between_kinks``, in words.

    A key that is no quantity is its own name.
    """
    key, separator, _ = name.partition("_between_kinks")
    label = QUANTITIES[key].label if key in QUANTITIES else key
    return f"{label} between kinks" if separator else label


def von_mises_stress(components: Array, names: Sequence[str]) -> Array:
    """Return the von Mises stress (...) in Pa of components (..., c) with these c names."""
    return np.asarray(np.sqrt(np.maximum(np.sum(components @ MISES[tuple(names)] * components, axis=-1), 0.0)))


def matches_pattern(patterns: Sequence[str], name: str) -> bool:
    """Return whether a name fits one of the patterns, in which ``*`` stands for any text."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


#: Kinds of figures, as summaries call them.
KINDS = ("beam", "tip", "pad_force", "cylinder_force", "support_force", "frequency")


class ReductionErrors(NamedTuple):
    """Errors of a reduction by kind as fractions, and in words how they are known; both empty if nothing is known."""

    source: str = ""
    by_kind: Mapping[str, float] = MappingProxyType({})


def reduction_error(summary: Mapping[str, Any]) -> ReductionErrors:
    """Return the errors of the reduction of a run with this summary.

    They are those against the full model, if it was simulated, else estimates; those of frequencies are always
    estimates.  Forces that jump at kinks of extensions are compared between kinks; pad forces with impacts are left
    out.
    """
    errors, estimate = summary.get("errors", {}).get("reduced_vs_full", {}), summary.get("estimate") or {}
    source, how = (errors, "beside the full model") if "beam" in errors else (estimate, "estimated")
    if source.get("beam") is None:
        return ReductionErrors()
    kinds = [kind for kind in KINDS if kind != "pad_force" or "impacts" not in summary]
    by_kind = {kind: source.get(f"{kind}_between_kinks", source.get(kind)) for kind in kinds}
    by_kind["frequency"] = estimate.get("frequency")
    return ReductionErrors(how, {kind: float(error) for kind, error in by_kind.items() if error is not None})
