"""The table of quantities that results state: name, unit and sign of each, and how it follows from a response.

Summaries, warnings, tables, pages, studies and load charts read this table (`QUANTITIES`, by the keys that summaries
and studies use).  A quantity that can limit a load chart has a `Measure`, a function of all columns of a run's
`Response` at each time, or of all columns in each state of a load chart.  So the limit of a chart and the number in a
run's results are computed by one function.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from pmr.files.arrays import Array, Summary
from pmr.results.field_stress import FIBRE, PLANE, SPATIAL, von_mises
from pmr.results.response import Extreme, Extremes, Output, Response
from pmr.scene.built import Support, force_name, reaction_name
from pmr.scene.choice import traits_of
from pmr.scene.keys import cylinder_name, qualified_name
from pmr.scene.mechanism import AT_GROUND, AT_PIVOT, CYLINDER, MACHINE, drive_rows, rope_shares
from pmr.scene.members import members, pads_on_faces
from pmr.scene.scene import Scene

#: Function from the values (T, c) of all c columns at T times to one quantity (T,).
Measure = Callable[[Array], Array]

#: Pattern of the direction in the name of a support's constraint, such as x in ``base pivot x``, or z in ``base support
#: z at 2 m``.
DIRECTION = re.compile(r" r?[xyz](?= (?:at|on) |$)")
#: SI prefixes of values in sentences, each after the factor that it stands for.
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"))
#: Beginnings of the names of forces of contacts, of reactions of rigid supports, and of those at the pivot.
FORCE_OF, REACTION_OF, PIVOT = force_name(""), reaction_name(""), reaction_name(f"{AT_PIVOT} ")
#: Beginnings of the names of reactions at the pivot, on the ground and of a machine that moves.
ON_MACHINE = tuple(reaction_name(f"{place} ") for place in (AT_PIVOT, AT_GROUND, MACHINE))
#: Matrices A by which the square of the von Mises stress is s^T A s, by the names of the stress components s.
MISES: Mapping[tuple[str, ...], Array] = {
    ("axial",): FIBRE[:1, :1],
    ("axial", "torsion"): FIBRE,
    ("along", "across", "shear"): PLANE,
    ("xx", "yy", "zz", "yz", "xz", "xy"): SPATIAL,
}


@dataclass(frozen=True)
class Columns:
    """Description of c columns of values: outputs and contact forces, with names, kinds, units and bodies.

    Attributes
    ----------
    names, kinds, units, bodies : tuples of str, (c,)
        Name, kind, unit and body of each column.  The kind is without a direction, such as ``"tip"``; the name of a
        force is that of its contact.
    drives : mapping
        For each section, by name, the shares (c,) with which the columns are summed to the force that moves the section
        along the boom (`pmr.scene.mechanism.drive_rows`).
    ropes : tuple of str
        Names of the sections that hang on ropes, and of sections that others follow on ropes.
    pad_forces : array (c,), N
        Force of each pad at which its mean pressure is the allowed one; infinite for other columns and pads without it.
    lugs : mapping
        For each pin with lugs, by body and support such as ``base pin``, the shares (2, 3, c) with which the columns
        are summed to the forces of both lugs along x, y and z (`pmr.scene.built.Support.lug_shares`).
    on_machine : tuple of str
        Beginnings of the names of reactions at the pivot, on the ground and of the machine, which belong to no support.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    units: tuple[str, ...]
    bodies: tuple[str, ...]
    drives: Mapping[str, Array] = field(default_factory=dict)
    ropes: tuple[str, ...] = ()
    pad_forces: Array = field(default_factory=lambda: np.zeros(0))
    lugs: Mapping[str, Array] = field(default_factory=dict)
    on_machine: tuple[str, ...] = ON_MACHINE

    @classmethod
    def from_scene(cls, scene: Scene, response: Response) -> Columns:
        """Return the description of the columns of a scene's response, in the order of `Response.outputs`.

        Names of forces lose their beginning ``force of``, so that a pad has its own name.
        """
        return cls.of_outputs(
            scene, [replace(output, name=output.name.removeprefix(FORCE_OF)) for output in response.outputs]
        )

    @classmethod
    def of_outputs(cls, scene: Scene, outputs: Sequence[Output]) -> Columns:
        """Return the description of columns with the names, kinds, units and bodies of `outputs` of a scene."""
        names, pads = tuple(output.name for output in outputs), pads_on_faces(scene)
        springs = {
            name: unit
            for body, part in scene.bodies.items()
            for row, unit in part.spring_units.items()
            for name in (qualified_name(body, FORCE_OF + row), f"{body} {row}".strip())
        }
        columns = cls(
            names,
            tuple(output.kind for output in outputs),
            tuple(springs.get(output.name, output.unit) for output in outputs),
            tuple(output.body for output in outputs),
            drive_rows(scene, names),
            tuple(rope_shares(scene)),
            np.array([pads[output.name].allowed_force if output.name in pads else np.inf for output in outputs]),
            on_machine=reactions_on_machine(scene),
        )
        return replace(columns, lugs=_lug_shares(scene, columns))

    def numbers_of_kind(self, *kinds: str) -> list[int]:
        """Return the numbers of the columns whose kind is one of `kinds`."""
        return [k for k, kind in enumerate(self.kinds) if kind in kinds]

    def pivot_columns(self) -> dict[str, int]:
        """Return the numbers of the columns at the pivot: forces and moments by direction, luffing cylinder by name.

        If several columns have the same name, the number of the last one is returned.
        """
        return {name.removeprefix(PIVOT): k for k, name in enumerate(self.names) if name.startswith(PIVOT)}

    def support_columns(self) -> list[int]:
        """Return the numbers of the columns of support forces and moments, but for those on the machine."""
        return [k for k in self.numbers_of_kind("support", "reaction") if not self.names[k].startswith(self.on_machine)]

    def stress_columns(self) -> dict[str, dict[str, int]]:
        """Return, by the name of each probe, the numbers of its columns of stress by the stress component."""
        by_probe = dict[str, dict[str, int]]()
        for k in self.numbers_of_kind("probe"):
            probe, _, component = self.names[k].rpartition(" stress ")
            if self.units[k] == "Pa":
                by_probe.setdefault(probe, {})[component] = k
        return by_probe


def reactions_on_machine(scene: Scene) -> tuple[str, ...]:
    """Return `ON_MACHINE` for a scene with a frame; empty without one, where a support may have such a name."""
    return () if scene.frame is None else ON_MACHINE


#: Function that returns the `Measure` of a limit, or None if the limit depends on no column.  Its arguments are the
#: columns, and a function from the name of a part to whether the limit depends on this part.
MeasureOf = Callable[[Columns, Callable[[str], bool]], Measure | None]


class ChartLimit(NamedTuple):
    """Limit of a load chart on a quantity; all fields are required, so that a chart can name the limits that it lacks.

    Attributes
    ----------
    key : str
        Name of the limit in charts, such as ``"pad"``.
    measure : MeasureOf
        Function that returns, for the columns of a chart, the `Measure` that is limited; its larger values are worse.
    usual : str
        Words, such as ``"pad forces"``, by which a chart says that it has no such limit.  Empty if most machines have
        no such limit, so that a chart says nothing.
    has_parts : bool
        Whether the limit is on parts with names, such as pads, among which a chart chooses.
    """

    key: str
    measure: MeasureOf
    usual: str
    has_parts: bool


@dataclass(frozen=True)
class Quantity:
    """Quantity that results state.

    Attributes
    ----------
    key : str
        Key of the quantity in summaries, studies and options, such as ``"pad_force"``.
    label : str
        Name in the plural, as in "off by 3 % in pad forces".
    unit : str
    place : str
        Part that the quantity belongs to: ``"section"``, ``"tip"``, ``"pad"``, ``"cylinder"``, ``"rope"``,
        ``"support"``, ``"machine"``, ``"ground"``, ``"probe"``, ``"hoist"`` or ``"boom"``.
    kinds : tuple of str
        Kinds of the columns of a response that hold the quantity (`pmr.results.response.KINDS`).
    reported : str
        Name of the one number that is reported for the quantity, such as ``"largest pad force"``; empty if no number is
        reported.
    extreme : ``"size"``, ``"most"`` or ``"least"``
        Value that is reported: the one with the largest absolute value (with its sign), the largest, or the smallest.
    sign : str
        Meaning of a positive value; empty if the quantity has no sign, or if its sign is that of the axes.
    limit : ChartLimit, optional
        Limit of a load chart on the quantity; None if charts have no such limit.
    """

    key: str
    label: str
    unit: str
    place: str
    kinds: tuple[str, ...] = ()
    reported: str = ""
    extreme: str = "size"
    sign: str = ""
    limit: ChartLimit | None = None

    def histories(self, response: Response) -> dict[str, Array]:
        """Return the columns (T,) of a response that hold the quantity, by the names of the outputs.

        The columns are those of `Response.column`.  There are none for a quantity without `kinds`.
        """
        outputs = enumerate(response.outputs)
        return {output.name: response.column(k) for k, output in outputs if output.kind in self.kinds}

    def reported_extreme(self, extremes: Extremes) -> Extreme:
        """Return the extreme that is reported for the quantity: the largest absolute, the highest or the lowest value.

        `extremes` are those of a history; the quantity's field `extreme` says which one is reported.
        """
        return {"size": extremes.largest, "most": extremes.highest, "least": extremes.lowest}[self.extreme]


def with_unit(value: float, unit: str) -> str:
    """Return a value as text with three digits and its unit, such as ``12.3 kN``.

    Absolute values from a thousand on get the prefix k, M or G; smaller values get none.
    """
    size, prefix = next(((size, name) for size, name in _PREFIXES if abs(value) >= size), (1.0, ""))
    return f"{value / size:.3g} {prefix}{unit}"


def unit_text(unit: str) -> str:
    """Return the text of a unit in print, with exponents as superscripts; empty for a pure number, "1"."""
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def _largest_measure(numbers: Sequence[int]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest absolute value (T,) in some columns.

    These columns have the `numbers`, from 0.  None is returned if there are no numbers.
    """
    chosen = list(numbers)
    return (lambda values: np.abs(values[:, chosen]).max(axis=1)) if chosen else None


def _force_measure(kind: str) -> Callable[[Columns, Callable[[str], bool]], Measure | None]:
    """Return a function `MeasureOf`, whose measure is the largest absolute value (T,) in all columns of one `kind`.

    The function takes the columns, and a function from the name of a column to whether a limit depends on this column.
    It returns None if the limit depends on no column.
    """
    return lambda columns, looks_at: _largest_measure(
        [k for k in columns.numbers_of_kind(kind) if looks_at(columns.names[k])]
    )


def pad_pressure_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest share (T,) of a pad's allowed pressure.

    `looks_at` takes the name of a pad and says whether a limit depends on this pad.  The result is None if no such pad
    has an allowed pressure.
    """
    chosen = [k for k in columns.numbers_of_kind("pad") if looks_at(columns.names[k])]
    allowed = columns.pad_forces[chosen]
    if not np.isfinite(allowed).any():
        return None
    return lambda values: (np.abs(values[:, chosen]) / allowed).max(axis=1)


def _support_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest resultant force (T,) of a support.

    Supports may be rigid or elastic.  `looks_at` takes the name of a support and says whether a limit depends on this
    support.  If none of these supports has a force, their moments are taken.  Columns on the machine are never used.
    None is returned if there is no column.
    """
    groups = list(columns_by_support(columns, looks_at).values())
    if not groups:
        return None
    return lambda values: np.max([np.linalg.norm(values[:, of], axis=1) for of in groups], axis=0)


def columns_by_support(columns: Columns, looks_at: Callable[[str], bool]) -> dict[str, list[int]]:
    """Return the numbers of the columns of each support's forces, by body and support such as ``base pivot``.

    `looks_at` takes one of the two names of `support_names` and says whether this support is chosen.  If no chosen
    support has a force, the numbers are those of the columns of moments.  Columns on the machine are never chosen.
    """
    chosen = [k for k in columns.support_columns() if any(looks_at(name) for name in support_names(columns, k))]
    groups = dict[str, list[int]]()
    for k in [k for k in chosen if columns.units[k] == "N"] or chosen:
        groups.setdefault(DIRECTION.sub("", support_names(columns, k)[1]), []).append(k)
    return groups


def supports_with_lugs(scene: Scene) -> dict[str, tuple[str, Support]]:
    """Return body and `Support` of each pin with lugs, by body and name of the support such as ``base pin``."""
    return {
        resultant_name(body, support, " "): (body, support)
        for body, part in scene.bodies.items()
        for support in part.supports
        if support.lug_spacing is not None
    }


def _lug_shares(scene: Scene, columns: Columns) -> dict[str, Array]:
    """Return the field `Columns.lugs` of the columns of a scene; pins without a column are left out."""
    contacts, shares = {support_names(columns, k)[1]: k for k in columns.support_columns()}, dict[str, Array]()
    for name, (body, support) in supports_with_lugs(scene).items():
        of_lugs = np.zeros((2, 3, len(columns.names)))
        for direction in support.held_directions:
            if (k := contacts.get(f"{body} {support.row_name(direction)}".strip())) is not None:
                of_lugs[:, :, k] = support.lug_shares(direction)
        if of_lugs.any():
            shares[name] = of_lugs
    return shares


def lug_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest force (T,) in N of a lug.

    `looks_at` takes the name of a pin and says whether a limit depends on this pin.  None is returned if the limit
    depends on no pin with lugs.
    """
    rows = [shares for name, shares in columns.lugs.items() if looks_at(name)]
    if not rows:
        return None
    of_lugs = np.concatenate(rows)
    return lambda values: np.linalg.norm(np.tensordot(values, of_lugs, (1, 2)), axis=2).max(axis=1)


def resultant_name(body: str, support: Support, separator: str = ": ") -> str:
    """Return the name of the resultant force of a support: the body's name, then that of the support.

    A support without a name is called by its place.  The `separator` stands between both names: by default that of
    ``supports`` in summary.json, or a space as in names of contacts.  For a body without a name, the support's name is
    returned alone.
    """
    rows = DIRECTION.sub("", support.row_name(support.held_directions[0]))
    return f"{body}{separator}{rows}" if body else rows


def support_names(columns: Columns, number: int) -> tuple[str, ...]:
    """Return both names of the support in column `number`: that of the column, and that of the contact.

    The name of the contact is such as ``base pivot x``: body, support and direction.
    """
    body, name = columns.bodies[number], columns.names[number]
    if name.startswith(f"{body} "):  # a contact's
        return name, name
    row = name.removeprefix(REACTION_OF).removeprefix(f"{body}: ").removeprefix(FORCE_OF)
    return name, f"{body} {row}".strip()


def _cylinder_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest absolute force (T,) of section drives.

    `looks_at` takes the name of a cylinder and says whether a limit depends on this cylinder.  None is returned if the
    limit depends on no cylinder.  The force that moves a section along the boom is that of
    `pmr.scene.mechanism.drive_rows`: the force of one cylinder, or a sum over several cylinders for a section that
    hangs on ropes or that other sections follow.
    """
    return _drive_measure([row for name, row in columns.drives.items() if looks_at(cylinder_name(name))])


def _rope_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest absolute drive force (T,) in N of ropes.

    The drive force is the force that moves a section along the boom.  The sections are those in `columns.ropes`: a
    section that hangs on a rope, or one that pulls other sections by ropes.  `looks_at` takes the name of a section and
    says whether a limit depends on this section.  None is returned if the limit depends on no section.
    """
    return _drive_measure([columns.drives[name] for name in columns.ropes if looks_at(name)])


def _drive_measure(rows: Sequence[Array]) -> Measure | None:
    """Return a function from the values (T, c) of all columns to the largest absolute force (T,) of several drives.

    Each of `rows` holds the weights (c,) of the columns whose weighted sum is the force of one drive.  None is returned
    if there are no rows.
    """
    if not rows:
        return None
    shares = np.array(rows).T
    return lambda values: np.abs(values @ shares).max(axis=1)


def _deflection_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the displacement (T,) in m of the last tip.

    The tip is that of the last section.  Its displacement is the length of the displacement's vector.  There is one
    such tip, so `looks_at` is not called.  None is returned if no column is a displacement of a tip.
    """
    tips = columns.numbers_of_kind("tip")
    last = [k for k in tips if columns.bodies[k] == columns.bodies[tips[-1]]]
    return (lambda values: np.sqrt(np.sum(values[:, last] ** 2, axis=1))) if last else None


def _stress_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the largest von Mises stress (T,) in Pa at probes.

    `looks_at` takes the name of a probe and says whether a limit depends on this probe.  None is returned if the limit
    depends on no probe.
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
    """Return a function from the values (T, c) of all c columns to the absolute force (T,) of the luffing cylinder.

    None is returned if there is no luffing cylinder.  `looks_at` is not called, as there is at most one.
    """
    return _largest_measure([k for k in columns.pivot_columns().values() if columns.names[k] == CYLINDER])


def _luffing_pull_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the pull (T,) in N of the luffing cylinder.

    The pull is 0 where the cylinder pushes.  None is returned if there is no luffing cylinder.  `looks_at` is not
    called, as there is at most one.
    """
    forces = [k for k in columns.pivot_columns().values() if columns.names[k] == CYLINDER]
    return (lambda values: np.maximum(-values[:, forces], 0.0).max(axis=1)) if forces else None


def _least_ground_measure(columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
    """Return a function from the values (T, c) of all c columns to the smallest force (T,) in N of an outrigger.

    A positive force presses on the ground.  `looks_at` takes the name of an outrigger and says whether a limit depends
    on this outrigger.  None is returned if the limit depends on no outrigger.
    """
    chosen = [k for k in columns.numbers_of_kind("outrigger") if looks_at(columns.names[k])]
    return (lambda values: values[:, chosen].min(axis=1)) if chosen else None


#: Meaning of a positive force of a part that moves a section or raises the boom.
PUSHES, PRESSES = "pushes", "presses on the ground"

#: What the stress of a beam leaves out, to be read behind the figure.
UNBENT_WALLS = "without the bending of walls under pads"


def stress_remark(scene: Scene) -> str:
    """Return `UNBENT_WALLS` if a section of the scene is a beam of a box, else an empty text."""
    beams = (member for member in members(scene) if traits_of(member).is_beam)
    return UNBENT_WALLS if any(member.part.body.box for member in beams) else ""


def stress_name(scene: Scene) -> str:
    """Return the name of the largest stress that a run states.

    For a scene with beams of boxes, the name says that the stress is that of the beams alone.
    """
    return QUANTITIES["stress"].reported + (" of the beams" if stress_remark(scene) else "")


def wall_stress(summary: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the entry ``budget.model.wall_stress`` of a run's summary: the largest stress in walls at pads.

    None is returned if the summary has no such entry.  Summaries of earlier versions have a factor ``growth``, by which
    the stress grows with short cells; the returned ``value`` is multiplied by this factor.
    """
    model = summary.get("budget", {}).get("model") or {}
    stress: Mapping[str, Any] | None = model.get("wall_stress")
    return None if stress is None else {**stress, "value": stress["value"] * stress.get("growth", 1.0)}


#: All quantities, by their keys.
QUANTITIES: Mapping[str, Quantity] = {
    quantity.key: quantity
    for quantity in (
        # motion
        Quantity("beam", "displacements", "m", "section", ("beam", "tip")),
        Quantity(
            "tip", "displacements of the tip", "m", "tip", ("tip",), "largest deflection of the tip",
            limit=ChartLimit("deflection", _deflection_measure, "deflection", False),
        ),
        Quantity("largest", "largest displacement", "m", "section", ("beam", "tip"), "largest displacement"),
        Quantity("velocity", "velocities", "m/s", "section"),
        Quantity("hook_height", "heights of the hook", "m", "hoist", ("hook_height",)),
        Quantity("hook_place", "places of the hook", "m", "hoist", ("hook_place",)),
        Quantity("swing", "swings of the hook", "rad", "hoist", ("swing",), "largest swing of the hook"),
        Quantity("frequency", "natural frequencies", "Hz", "boom", (), "lowest natural frequency", "least"),
        # forces within the boom
        Quantity(
            "pad_force", "pad forces", "N", "pad", ("pad",), "largest pad force",
            sign="pushes the sections apart, or the body inwards",
            limit=ChartLimit("pad", _force_measure("pad"), "pad forces", True),
        ),
        Quantity("pad_pressure", "mean pressures of pads", "Pa", "pad", (), "largest mean pressure of a pad"),
        Quantity("pad_use", "use of pads", "1", "pad", (), "largest use of the allowed pressure of a pad", "most"),
        Quantity("indentation", "indentations of walls", "m", "pad", (), "largest indentation of walls under a pad"),
        Quantity(
            "cylinder_force", "forces of extension cylinders", "N", "cylinder", ("cylinder",),
            "largest force of an extension cylinder", sign=PUSHES,
            limit=ChartLimit("cylinder", _cylinder_measure, "forces of cylinders", True),
        ),
        Quantity(
            "rope_force", "rope forces", "N", "rope", (), "largest rope force",
            limit=ChartLimit("rope", _rope_measure, "forces of cylinders", True),
        ),
        Quantity(
            "luffing_force", "forces of the luffing cylinder", "N", "cylinder", (),
            "largest force of the luffing cylinder", sign=PUSHES,
            # a luffing cylinder is a support that gives way
            limit=ChartLimit("luffing", _luffing_measure, "forces of cylinders", False),
        ),
        Quantity(
            "luffing_pull", "pulls of the luffing cylinder", "N", "cylinder",
            limit=ChartLimit("luffing-pull", _luffing_pull_measure, "", False),
        ),
        Quantity(
            "luffing_use", "use of the luffing cylinder", "1", "cylinder", (), "largest use of the luffing cylinder",
            "most",
        ),
        Quantity(
            "extension_force", "forces on the free extension", "N", "cylinder", (),
            "largest force on the free extension", sign=PUSHES,
        ),
        # motion and oil of a cylinder that drives a free luffing angle or extension
        Quantity("luffing_angle", "luffing angles", "rad", "boom", ("machine",)),
        Quantity("driven_length", "lengths of the driven cylinder", "m", "cylinder"),
        Quantity("driven_speed", "speeds of the driven cylinder", "m/s", "cylinder", sign="gets longer"),
        Quantity("driven_acceleration", "second rates of the free extension", "m/s^2", "cylinder"),
        Quantity("driven_stop", "way by which stops give way", "m", "cylinder", sign="at the greatest extension"),
        Quantity("driven_volume", "volumes of oil in the driven cylinder", "m^3", "cylinder"),
        Quantity(
            "driven_pressure", "pressures of oil", "Pa", "cylinder", ("pressure",), "largest pressure of oil", "most",
            "above that of the surroundings",
        ),
        Quantity(
            "driven_flow", "flows of oil", "m^3/s", "cylinder", ("flow",), "largest flow of oil",
            sign="into the chamber, or out of the supply",
        ),
        Quantity(
            "driven_power", "power of the driven cylinder", "W", "cylinder", ("power",),
            "largest power of the driven cylinder", "most", "raises or extends the boom, or leaves the supply",
        ),
        Quantity(
            "hoist_force", "forces of the hoist rope", "N", "hoist", ("hoist_force",),
            "largest force of the hoist rope", "most", sign="pulls",
        ),
        Quantity("winch_pull", "pulls of the hoist rope on its winch", "N", "hoist", ("winch_pull",)),
        # forces on the supports of the boom
        Quantity("support_force", "forces of supports that give way", "N", "support", ("support",)),
        Quantity("reaction", "reactions of rigid supports", "N", "support", ("reaction",)),
        Quantity(
            "support", "forces of supports", "N", "support", ("support", "reaction"), "largest force of a support",
            limit=ChartLimit("support", _support_measure, "forces of supports", True),
        ),
        Quantity(
            "lug_force", "forces of lugs", "N", "support", (), "largest force of a lug", "most",
            limit=ChartLimit("lug", lug_measure, "forces of supports", True),
        ),
        Quantity("support_use", "use of supports", "1", "support", (), "largest use of a support", "most"),
        Quantity("support_moment", "moments of supports", "N m", "support", (), "largest moment of a support"),
        Quantity(
            "machine_force", "forces on the machine", "N", "machine", (),
            "largest component of the net force of the boom on its machine",
        ),
        Quantity(
            "machine_moment", "moments on the machine", "N m", "machine", (),
            "largest component of the net moment of the boom on its machine, about the pivot",
        ),
        Quantity(
            "ground_force", "forces on the ground", "N", "ground", (),
            "largest component of the net force of the machine on the ground",
        ),
        Quantity(
            "ground_moment", "moments on the ground", "N m", "ground", (),
            "largest component of the net moment of the machine on the ground",
        ),
        Quantity(
            "outrigger_force", "outrigger forces", "N", "ground", ("outrigger",), "largest force of an outrigger",
            "most", PRESSES, ChartLimit("outrigger", _force_measure("outrigger"), "", True),
        ),
        Quantity(
            "outrigger_rest", "smallest outrigger forces", "N", "ground", (), "smallest force of an outrigger",
            "least", PRESSES, ChartLimit("lift-off", _least_ground_measure, "", True),
        ),
        Quantity(
            "tipping_margin", "margins against tipping", "N m", "ground", ("margin",), "least margin against tipping",
            "least", "holds the machine down",
        ),
        Quantity(
            "tipping", "use of the support polygon", "1", "ground", ("tipping",), "largest use of the support polygon",
            "most", limit=ChartLimit("tipping", _force_measure("tipping"), "tipping", False),
        ),
        # strength
        Quantity(
            "stress", "stresses", "Pa", "section", (), "largest von Mises stress", "most",
            limit=ChartLimit("stress", _stress_measure, "stress", True),
        ),
        Quantity(
            "field", "stresses of walls", "Pa", "section", limit=ChartLimit("field", _stress_measure, "stress", True)
        ),
        Quantity(
            "wall_stress", "stresses of walls at pads", "Pa", "pad", (), "largest von Mises stress in walls", "most"
        ),
        Quantity("probe", "values at probes", "", "probe", ("probe",)),
        Quantity(
            "utilisation", "stresses over yield stresses", "1", "section", (), "largest stress over yield stress",
            "most",
        ),
        Quantity("damage", "damage by fatigue", "1", "probe", (), "largest damage by fatigue", "most"),
        Quantity("buckling", "buckling factors", "1", "boom", (), "buckling factor", "least"),
    )
}  # fmt: skip
#: One word for the quantity that has a unit, by the unit.
UNIT_QUANTITIES = {
    "m": "length", "N": "force", "N m": "moment", "Pa": "pressure", "K": "temperature", "m^3/s": "flow", "W": "power",
    "rad": "angle", "1": "share",
}  # fmt: skip
#: Limits of load charts on quantities, and the quantities that they limit, by the names of the limits.
LIMITS = {quantity.limit.key: quantity.limit for quantity in QUANTITIES.values() if quantity.limit is not None}
LIMITED = {quantity.limit.key: quantity for quantity in QUANTITIES.values() if quantity.limit is not None}


def error_label(name: str) -> str:
    """Return words for the error with the key `name` in summary.json, such as ``pad_force_between_kinks``.

    The words are the label of the quantity, with "between kinks" behind it if the key says so.  A key that is not in
    `QUANTITIES`, such as the name of a probe, is returned itself.
    """
    key, separator, _ = name.partition("_between_kinks")
    label = QUANTITIES[key].label if key in QUANTITIES else key
    return f"{label} between kinks" if separator else label


def von_mises_stress(components: Array, names: Sequence[str]) -> Array:
    """Return the von Mises stress (...) in Pa of stress components (..., c) in Pa.

    `names` are the names of the c components, one of the keys of `MISES`; others raise KeyError.
    """
    return von_mises(components, MISES[tuple(names)])


def matches_pattern(patterns: Sequence[str], name: str) -> bool:
    """Return whether a whole name fits one of the patterns, in which ``*`` stands for any text, also for none."""
    return any(re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name) for pattern in patterns)


#: Reasons why there is no estimate of outputs in which richer models disagree, by kind.
UNSETTLED_KINDS = {
    kind: f"{QUANTITIES[kind].label}, because pads lift off and close again and the motion depends on the exact time "
    "of impacts"
    for kind in ("pad_force", "cylinder_force", "velocity", "probe", "reaction")
}
#: Keys of the quantities in which models are compared, in the order in which errors are named.
COMPARED = ("tip", "beam", "pad_force", "cylinder_force", "support_force", "reaction", "frequency")
#: Keys of those of `COMPARED` whose error of the reduction is an estimate, also beside the full model.
ESTIMATED = ("frequency", "reaction")


class ReductionErrors(NamedTuple):
    """Errors of a reduction as fractions, by kind, and their `source` in words; both are empty if none is known."""

    source: str = ""
    by_kind: Mapping[str, float] = MappingProxyType({})


def reduction_error(summary: Summary) -> ReductionErrors:
    """Return the errors of the reduction in the summary of a run, for those kinds of `COMPARED` that it has.

    If the run compared displacements with the full model, the errors are differences to the full model.  Otherwise they
    are estimates.  Errors of frequencies and of reactions of rigid supports are always estimates.  For forces that jump
    at kinks of extensions, the error is that between the kinks.  Pad forces with impacts are left out.  Without an
    error of displacements there are no errors.
    """
    errors, estimate = summary.get("errors", {}).get("reduced_vs_full", {}), summary.get("estimate") or {}
    source, how = (errors, "compared with the full model") if "beam" in errors else (estimate, "estimated")
    if source.get("beam") is None:
        return ReductionErrors()
    kinds = [kind for kind in COMPARED if kind != "pad_force" or "impacts" not in summary]
    by_kind = {kind: source.get(f"{kind}_between_kinks", source.get(kind)) for kind in kinds}
    by_kind |= {kind: estimate.get(kind) for kind in ESTIMATED}
    return ReductionErrors(how, {kind: float(error) for kind, error in by_kind.items() if error is not None})
