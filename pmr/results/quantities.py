r"""Quantities by which a boom is judged, each computed from the columns that simulators and states at rest have.

A column has a name, a kind (`pmr.results.outputs`) and a unit.  A `Quantity` chooses columns by kind and name, and
makes one value of their values at each time or state: of a run's `Response` as of a load chart's states.  So a limit
of a chart and the figure of a run are one function.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from pmr.results.response import Response
from pmr.scene.built import force_of, reaction_of
from pmr.scene.names import cylinder_of
from pmr.scene.pivot import AT_PIVOT, CYLINDER
from pmr.scene.ropes import drive_rows, rope_shares
from pmr.scene.scene import Scene

Array = NDArray[np.float64]
#: Values (T,) of a quantity from those of all columns (T, c).
Measure = Callable[[Array], Array]

#: Direction in the name of a support's row: ``base pivot x``, ``base support z at 2 m``.
DIRECTION = re.compile(r" r?[xyz](?= (?:at|on) |$)")
REACTION, PIVOT, FORCE = reaction_of(""), reaction_of(f"{AT_PIVOT} "), force_of("")
#: Von Mises' stress squared by the components that models have.
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
    """Meaning of the columns of values.

    Attributes
    ----------
    names, kinds, units, bodies : tuples of str, (c,)
        Kinds without directions, as ``"tip"``; forces by the names of their contacts.
    drives : mapping
        Shares (c,) of the columns in the force of what moves each section along the boom, by section
        (`pmr.scene.ropes.drive_rows`).
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
    def of(cls, scene: Scene, response: Response) -> Columns:
        """Columns of a scene's response, in the order of `values_of`."""
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

    def of_kind(self, *kinds: str) -> list[int]:
        """Numbers of the columns of these kinds."""
        return [k for k, kind in enumerate(self.kinds) if kind in kinds]

    def at_pivot(self) -> dict[str, int]:
        """Columns of force and moment at the pivot and of the luffing cylinder: the last of each name, by direction."""
        return {name.removeprefix(PIVOT): k for k, name in enumerate(self.names) if name.startswith(PIVOT)}

    def stresses(self) -> dict[str, dict[str, int]]:
        """Columns of each component of the stress at a probe, by probe and component."""
        by_probe = dict[str, dict[str, int]]()
        for k in self.of_kind("probe"):
            probe, separator, component = self.names[k].rpartition(" stress ")
            if separator:
                by_probe.setdefault(probe, {})[component] = k
        return by_probe


def values_of(response: Response) -> Array:
    """All columns of a response (T, c), in the order of `Columns.of`."""
    parts = [response.displacement, response.slider_force, response.others]
    return np.hstack([part for part in parts if part is not None])


@dataclass(frozen=True)
class Quantity:
    """A figure by which a boom is judged; a larger value is worse.

    `measure` returns how it follows from the columns, None where none of them belongs to it; it gets a function that
    says which names it looks at.
    """

    key: str
    label: str
    unit: str
    measure: Callable[[Columns, Callable[[str], bool]], Measure | None]


def _largest(numbers: Sequence[int]) -> Measure | None:
    """Largest absolute value of some columns."""
    chosen = list(numbers)
    return (lambda values: np.abs(values[:, chosen]).max(axis=1)) if chosen else None


def _forces(kind: str) -> Callable[[Columns, Callable[[str], bool]], Measure | None]:
    def measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
        return _largest([k for k in columns.of_kind(kind) if looks_at(columns.names[k])])

    return measure


def _supports(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Resultant force of each support, those that give way and rigid ones; moments only where no force is chosen."""
    at_pivot = set(columns.at_pivot().values())
    numbers = [k for k in columns.of_kind("support", "reaction") if k not in at_pivot]
    chosen = [k for k in numbers if any(looks_at(name) for name in support_names(columns, k))]
    groups = dict[str, list[int]]()
    for k in [k for k in chosen if columns.units[k] == "N"] or chosen:
        groups.setdefault(DIRECTION.sub("", support_names(columns, k)[1]), []).append(k)
    if not groups:
        return None
    return lambda values: np.max([np.linalg.norm(values[:, of], axis=1) for of in groups.values()], axis=0)


def support_names(columns: Columns, number: int) -> tuple[str, ...]:
    """Names of a support's column: its own, and that of its contact, ``base pivot x``."""
    body, name = columns.bodies[number], columns.names[number]
    row = name.removeprefix(REACTION).removeprefix(f"{body}: ").removeprefix(FORCE)
    return name, f"{body} {row}".strip()


def _cylinders(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Forces of what moves sections along the boom; of a section on ropes, or that others follow, with these."""
    return _drive_measure([row for name, row in columns.drives.items() if looks_at(cylinder_of(name))])


def _ropes(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Forces of ropes, and of cylinders that move sections on ropes, by the names of the sections."""
    return _drive_measure([columns.drives[name] for name in columns.ropes if looks_at(name)])


def _drive_measure(rows: Sequence[Array]) -> Measure | None:
    if not rows:
        return None
    shares = np.array(rows).T
    return lambda values: np.abs(values @ shares).max(axis=1)


def _deflection(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Displacement of the tip of the last section."""
    tips = columns.of_kind("tip")
    last = [k for k in tips if columns.bodies[k] == columns.bodies[tips[-1]]]
    return (lambda values: np.sqrt(np.sum(values[:, last] ** 2, axis=1))) if last else None


def _stress(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Von Mises' stress at probes."""
    groups = dict[tuple[str, ...], list[list[int]]]()
    for probe, components in columns.stresses().items():
        if looks_at(probe):
            groups.setdefault(tuple(components), []).append(list(components.values()))
    if not groups:
        return None
    at_probes = [(names, np.array(numbers)) for names, numbers in groups.items()]
    return lambda values: np.max([mises(values[:, k], names).max(axis=1) for names, k in at_probes], axis=0)


def _luffing_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Force of the luffing cylinder along itself."""
    return _largest([k for k in columns.at_pivot().values() if columns.names[k] == CYLINDER])


#: All of them, by the keys of a chart's limits.
QUANTITIES = {
    one.key: one
    for one in (
        Quantity("stress", "von Mises' stress at probes", "Pa", _stress),
        Quantity("field", "von Mises' stress of walls", "Pa", _stress),
        Quantity("pad", "force of a pad", "N", _forces("pad")),
        Quantity("cylinder", "force of a cylinder that moves sections", "N", _cylinders),
        Quantity("rope", "force of a rope, or of the cylinder that moves sections on ropes", "N", _ropes),
        Quantity("support", "force of a support", "N", _supports),
        Quantity("luffing", "force of the luffing cylinder", "N", _luffing_measure),
        Quantity("deflection", "deflection of the tip", "m", _deflection),
    )
}


def mises(components: Array, names: Sequence[str]) -> Array:
    """Von Mises' stress (...) in Pa of components (..., c) by their names."""
    return np.asarray(np.sqrt(np.maximum(np.sum(components @ MISES[tuple(names)] * components, axis=-1), 0.0)))


def fits(patterns: Sequence[str], name: str) -> bool:
    """Whether a name fits one of some patterns with ``*`` for any text."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)
