r"""Limits of a load chart: quantities with allowed amounts, and the share of a limit that a load uses.

`KINDS` declares each of them once: its amount, its unit and how the share follows from states.  The share is 1 where
the limit is reached.  With the limit's safety factor :math:`\gamma` and its amount, the key ``most`` or ``least``, the
share is :math:`\gamma |r| / r_{most}` for a quantity r that runs have too (`pmr.results.quantities`), and for the value
r of a user's function or expression of `pmr.studies.further_limits.AtRest`.  For other kinds it is

===========  ===============================================================================
lift-off     :math:`\gamma r_{least} / r` with the smallest force r of an outrigger on the ground
buckling     :math:`\gamma \Lambda_{least} / \Lambda` with the buckling factor :math:`\Lambda` on all axial forces
frequency    :math:`\gamma f_{least} / f` with the lowest frequency f, the load as a mass, all pads closed
overturning  :math:`\gamma M_{load} / M_{rest}` with the moments of load and rest about each edge of the polygon
===========  ===============================================================================

The moments are those of `pmr.studies.further_limits`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import eq
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from pmr.errors import InputError, similar_name_hint
from pmr.files.arrays import Array
from pmr.results.quantities import (
    LIMITED,
    LIMITS,
    Columns,
    Measure,
    matches_pattern,
    pad_pressure_measure,
    supports_with_lugs,
)
from pmr.scene import Scene
from pmr.scene.choice import traits_of
from pmr.scene.ground import MachineMass, edge_rows, polygon_area
from pmr.scene.keys import SceneTable, Usual, qualified_name
from pmr.scene.mechanism import rope_shares
from pmr.scene.members import members, pads_on_faces
from pmr.scene.rotation import boom_rotation
from pmr.scene.structures import Probe
from pmr.simulation.statics.loaded import Form, LoadedStates
from pmr.simulation.statics.postures import MACHINE_WEIGHT, PostureMatrices, StandAtRest
from pmr.studies import tasks
from pmr.studies.further_limits import (
    TippingMoments,
    amounts_of_states,
    check_names,
    expression_function,
    pivot_rows,
    plugin_function,
    weight_of_masses,
)
from pmr.system.from_scene import force_names

Positive = Annotated[float, Field(gt=0.0)]
#: Function from p states to the shares (p,) of a limit that they use; at a share of 1 the limit is reached.
Share = Callable[[LoadedStates], Array]
#: The limit that every chart has: beyond it there is no stable equilibrium.
STABILITY = "stability"
#: The same in words, as pages show it.
STABILITY_WORDS = "buckling of the boom"
#: Text between the body's name and the rest in names of probes of the stress field; faces of walls with such probes.
FIELD, FACES = "field of ", ("outer", "inner")
#: Name of the region of a mesh without regions.
WHOLE = "walls"
#: Most numbers that a limit of the field may store for all points of a chart.
MOST_NUMBERS = 2**27


class Eigenvalue(NamedTuple):
    """Eigenvalue of a boom that a chart limits, such as its lowest frequency.

    Attributes
    ----------
    load : callable
        Called with a form and the allowed amount; returns the load in kg at which the eigenvalue reaches the amount
        while no contact opens or closes.  The load is infinite if there is none.
    all_closed : bool
        Whether the eigenvalue is that with all contacts closed, also where pads that only push are open.
    """

    load: Callable[[Form, float], float]
    all_closed: bool = False


@dataclass(frozen=True)
class Kind:
    """A quantity that a chart can limit, and how the used share of a limit on it is computed.

    Attributes
    ----------
    amount : str
        The limit's key that holds the allowed amount: ``most``, ``least``, or nothing.
    unit : str
        Unit of the amount; empty for a number without a unit, or if only the user knows the unit.
    share : callable
        Called with a limit, postures, the number k of a posture and the amounts (w,) of the w components
        ``PostureMatrices.loads``; returns the `Share`, a function from states to used shares.
    usual : Usual, optional
        Range in which the amount usually lies.
    names : callable, optional
        Returns the scene's names among which the limit's key ``which`` chooses; None if only a model knows these names,
        or if the kind has no names.
    eigenvalue : Eigenvalue, optional
        How the allowed load follows from the amount; only for limits on eigenvalues.
    grows : bool
        Whether the share can only grow with the load, so that the share at the largest load tells whether any load
        reaches the limit.
    in_richer_model : bool
        Whether a richer structural model has the quantity at the same positions.
    words : str
        Name of the limit in a chart's list of limits that it lacks; empty if it is not listed.
    has_parts : bool
        Whether the limit is on parts with names among which its key ``which`` chooses.
    """

    amount: Literal["most", "least", ""]
    unit: str
    share: Callable[[Limit, PostureMatrices, int, Sequence[float]], Share]
    usual: Usual | None = None
    names: Callable[[Scene], Sequence[str]] | None = None
    eigenvalue: Eigenvalue | None = None
    grows: bool = False
    in_richer_model: bool = True
    words: str = ""
    has_parts: bool = False


def _share_of_quantity(limit: Limit, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
    """Return the function from p states to the used shares (p,) of a limit on a quantity that runs have, too.

    `amounts` are not used.  Raises InputError if the limit is on the luffing cylinder and the cylinder has no lever arm
    to raise the boom at the k-th posture of `at`.
    """
    if limit.of in ("luffing", "luffing-pull") and not at.place.arm[k] > 0.0:
        reason = f"at {np.rad2deg(at.place.luffing[k]):.4g} degrees the cylinder has an arm of {at.place.arm[k]:.2g} m"
        raise InputError("study", "luffing", None, f"angles at which it raises the boom are allowed: {reason}")
    measure, share_of_unit = limit.measure(at.columns), limit.factor / limit.allowed_amount
    return lambda states: share_of_unit * measure(np.hstack([states.outputs, states.forces]))


def _share_of_ground(limit: Limit, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
    """Return the function from p states to the used shares (p,) of a limit on forces of outriggers or on tipping.

    Forces on the ground are those of runs (`pmr.simulation.reactions`), at the k-th posture of `at`, where the
    components ``at.loads`` act by `amounts` (w,), one for each.  Where the machine tips, the shares of limits on
    forces of outriggers are infinite.  Raises InputError if the scene has no ground.
    """
    at_rest = limit.stand_in(at)
    measure, use = limit.measure(at_rest.columns), at_rest.columns.numbers_of_kind("tipping")
    turned = boom_rotation(at.place.luffing[k : k + 1], at.place.slewing[k : k + 1])[0]
    rows = np.kron(np.eye(2), turned) @ pivot_rows(at)
    resting = amounts[at.loads.names.index(MACHINE_WEIGHT)] * at_rest.weight[k]

    def share(states: LoadedStates) -> Array:
        """Used shares (p,) in p states."""
        on_ground, allowed = at_rest.stand.columns(states.outputs @ rows.T + resting), limit.allowed_amount
        value = measure(on_ground)
        if limit.of == "tipping":
            return np.asarray(limit.factor / allowed * value)
        used = limit.factor / allowed * value if limit.least is None else [_ratio(allowed, least) for least in value]
        return np.where(np.any(on_ground[:, use] > 1.0, axis=1), np.inf, used)

    return share


def _share_of_user_function(limit: Limit, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
    """Return the function from p states to the used shares (p,) of a limit on a user's function or expression.

    The absolute value of the function or expression at the k-th posture of `at` is compared with the allowed amount.
    `amounts` are not used.
    """
    is_function, text = limit.of == "function", limit.function or limit.expression or ""
    evaluate = plugin_function(limit.name, text) if is_function else expression_function(text)
    amount = amounts_of_states(evaluate, f"limits.{limit.name}.{limit.of}", text, at, k)
    return lambda states: limit.factor / limit.allowed_amount * np.abs(amount(states))


def _share_of_buckling(limit: Limit, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
    """Return the function from p states to the used shares (p,) of a limit on the buckling factor.

    Posture and `amounts` are not used, as the factor follows from the closed contacts of each state (`Form`).
    """
    amount = limit.allowed_amount
    return lambda states: amount * np.array([form.inverse_factor(load) for form, load in _forms_and_loads(states)])


def _share_of_frequency(limit: Limit, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
    """Return the function from p states to the used shares (p,) of a limit on the lowest natural frequency.

    The frequency is that with all contacts closed, as runs state it.  Posture and `amounts` are not used.
    """
    amount = limit.allowed_amount
    return lambda states: np.array(
        [_ratio(amount, form.equations.all_closed.frequency(load)) for form, load in _forms_and_loads(states)]
    )


def _share_of_overturning(limit: Limit, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
    """Return the function from p states to the used shares (p,) of a limit on overturning, about the worst edge.

    The machine stands at the k-th posture of `at`; the components ``at.loads`` act by `amounts` (w,), one for each.
    """
    tipping = limit.tipping_moments(at, k, amounts)
    return lambda states: tipping.share(states, limit.factor)


def _stress_probes(scene: Scene) -> list[str]:
    """Names of a scene's probes that measure stress, with the name of the section before each of a boom's probes."""
    bodies = scene.bodies.items()
    return [qualified_name(body, p.name) for body, part in bodies for p in part.probes if "stress" in p.measures]


def _force_names_of(kind: str) -> Callable[[Scene], Sequence[str]]:
    """Return a function that takes a scene and lists the names of its contact forces of this kind."""
    return lambda scene: force_names(scene)[kind]


#: Usual range of a quantity, by its unit.
USUAL = {"Pa": Usual(1e6, 1e10, unit="Pa"), "N": Usual(0.05, 1e3, "weight", "N"), "m": Usual(1e-5, 1.0, "reach", "m")}
USUAL_PRESSURE = Usual(1e4, 1e10, unit="Pa")
#: By quantity: a function that lists the scene's names among which a limit chooses; only where this needs no model.
NAMES: Mapping[str, Callable[[Scene], Sequence[str]]] = {
    "stress": _stress_probes,
    "rope": lambda scene: list(rope_shares(scene)),
    "lug": lambda scene: list(supports_with_lugs(scene)),
    **{kind: _force_names_of(kind) for kind in ("pad", "cylinder", "support")},
}
#: All kinds of limits by name: quantities that runs have too, and others.
KINDS: Mapping[str, Kind] = {
    key: Kind(
        "least" if q.extreme == "least" else "most",
        q.unit.removeprefix("1"),
        _share_of_ground if q.place == "ground" else _share_of_quantity,
        None if q.place == "ground" else USUAL.get(q.unit),
        NAMES.get(key),
        in_richer_model=q.unit != "Pa",
        words=LIMITS[key].usual,
        has_parts=LIMITS[key].has_parts,
    )
    for key, q in LIMITED.items()
} | {
    "buckling": Kind("least", "", _share_of_buckling, eigenvalue=Eigenvalue(Form.load_of_factor), grows=True),
    "frequency": Kind(
        "least", "Hz", _share_of_frequency, eigenvalue=Eigenvalue(Form.load_of_frequency, all_closed=True), grows=True
    ),
    "overturning": Kind("", "", _share_of_overturning, grows=True, words="tipping"),
    "function": Kind("most", "", _share_of_user_function, in_richer_model=False),
    "expression": Kind("most", "", _share_of_user_function, in_richer_model=False),
}
if TYPE_CHECKING:
    KindName = str
else:
    KindName = Literal[tuple(KINDS)]


class Limit(SceneTable):
    """Limit of a load chart, with its safety factor."""

    name: str = Field(min_length=1, description="Name of the limit, and of its column")
    of: KindName = Field(description="Quantity that is limited")
    function: str | None = Field(
        default=None, description="Name of a function that an installed package offers as an entry point `pmr.limits`"
    )
    expression: str | None = Field(
        default=None,
        description='Arithmetic over load (kg), luffing, slewing (rad), output["name"] (m, Pa) and force["name"] (N)',
    )
    most: Positive | None = Field(
        default=None,
        description="Largest allowed value: stress in Pa, force in N, deflection in m, angle in rad, or of a function; "
        "without it a limit of pads is their allowed_pressure of the scene",
    )
    least: Positive | None = Field(
        default=None, description="Smallest allowed value: buckling factor, frequency in Hz, force of an outrigger in N"
    )
    factor: Positive = Field(default=1.0, description="Safety factor, of your own choice")
    note: str = Field(default="", description="Text that the report shows behind the limit, as on its accuracy")
    which: tuple[str, ...] = Field(
        default=("*",),
        min_length=1,
        description="Names of probes, pads, supports, sections or their regions, with * for any text; by default all",
    )
    area: Annotated[tuple[Positive, Positive], Usual(1e-3, 5.0, unit="m")] | None = Field(
        default=None, description="Length and width of a pad, m; with it `most` is a pressure in Pa"
    )
    polygon: Annotated[tuple[tuple[float, float], ...], Usual(0.0, 3.0, "reach", "m")] = Field(
        default=(), description="Corners X, Y of the support polygon from the pivot, m; its edges are the tipping lines"
    )
    height: Annotated[float, Usual(0.0, 3.0, "reach", "m")] = Field(
        default=0.0, description="Height of the pivot above these corners, m"
    )
    machine: tuple[MachineMass, ...] = Field(
        default=(), description="Masses of the machine below the boom; without them and `polygon` those of frame.ground"
    )

    @property
    def kind(self) -> Kind:
        """Entry of `KINDS` for the quantity that is limited."""
        return KINDS[self.of]

    @property
    def by_scene(self) -> bool:
        """Whether the limit is the allowed pressure that the scene states for each pad."""
        return self.of == "pad" and self.most is None

    @property
    def hint_numbers(self) -> dict[str, tuple[float, Usual]]:
        """`most` with its usual range, as ``{"most": (value, range)}`` for hints; empty if either is missing."""
        usual = USUAL_PRESSURE if self.area else self.kind.usual
        return {"most": (self.most, usual)} if self.most is not None and usual is not None else {}

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        """Refuse a limit without a key that its quantity needs, and one with a key of other kinds of limits."""
        needed = self.kind.amount
        for key in ("most", "least"):
            if (getattr(self, key) is not None) != (key == needed) and not (key == "most" and self.by_scene):
                raise ValueError(f"a limit of {self.of} {f'takes {needed}' if needed else 'takes no amount'}: {key}")
        if self.which != ("*",) and not self.kind.has_parts:
            raise ValueError(f"which belongs to a limit of parts with names: {self.of} has none")
        if self.polygon or self.machine:
            if self.of != "overturning":
                raise ValueError("polygon and machine belong to a limit of overturning")
            if len(self.polygon) < 3 or not self.machine or not polygon_area(self.polygon):
                raise ValueError("overturning needs a polygon with an area, and masses of the machine")
        if self.area is not None and self.of != "pad":
            raise ValueError("area belongs to a limit of pads")
        if self.area is not None and self.most is None:
            raise ValueError("area goes with most, the pressure")
        for key in ("function", "expression"):
            if (getattr(self, key) is not None) != (self.of == key):
                raise ValueError(f"{key} belongs to a limit of {key!r}, which needs one")
        if self.expression is not None:
            expression_function(self.expression)
        return self

    @property
    def allowed_amount(self) -> float:
        """Amount that is compared with the quantity, in the unit of the quantity.

        It is `most`.  For a pad with an `area` it is the force `most` (a pressure) times the area, and for a limit with
        `least` it is `factor` times `least`.  It is 1, a share, for pads whose allowed pressure the scene states.  For
        overturning it is 0 and has no meaning.
        """
        if self.by_scene:
            return 1.0
        if self.least is not None:
            return self.factor * self.least
        return float(self.most or 0.0) * float(np.prod(self.area or (1.0,)))

    def share(self, at: PostureMatrices, k: int, amounts: Sequence[float]) -> Share:
        """Return the function from p states to the used shares (p,) of the limit at the k-th posture of `at`.

        `amounts` (w,) are the amounts by which the w loads in ``at.loads`` act (weights, load, loads of the scene).
        Raises InputError if the model has none of the columns that the limit depends on.
        """
        return self.kind.share(self, at, k, amounts)

    def measure(self, columns: Columns) -> Measure:
        """Return the function from values (p, c) of c `columns` in p states to the quantity (p,) that is limited.

        Raises InputError if none of the columns belongs to the limit.
        """
        measure = self._measure_of(columns, self.concerns)
        if measure is None:
            probes = [probe for probe in columns.stress_columns() if FIELD not in probe] if self.of == "stress" else []
            raise self._unknown_name(probes)
        return measure

    def _measure_of(self, columns: Columns, looks_at: Callable[[str], bool]) -> Measure | None:
        """Return the `Measure` of the parts for whose names `looks_at` is true; None if these parts have no columns."""
        return pad_pressure_measure(columns, looks_at) if self.by_scene else LIMITS[self.of].measure(columns, looks_at)

    def governing_member(self, scene: Scene, columns: Columns, values: Array) -> str:
        """Return the name of the pad, cylinder, rope, support or probe with the largest value in a state.

        Only members that the limit concerns are compared.  `values` (c,) are those of the `columns` in this state.  The
        name is empty for limits without such members, as on the ground, a deflection or the stress field.
        """
        sizes = dict[str, float]()
        for member in filter(self.concerns, self.kind.names(scene) if self.kind.names else ()):
            measure = self._measure_of(columns, partial(eq, member))
            if measure is not None:
                sizes[member] = float(measure(values[None])[0])
        return max(sizes, key=lambda member: sizes[member], default="")

    def tipping_moments(self, at: PostureMatrices, k: int, amounts: Sequence[float]) -> TippingMoments:
        """Return the moments that tip the machine about the edges of its support polygon at the k-th posture of `at`.

        `amounts` (w,) are the amounts by which the w loads in ``at.loads`` act (weights, load, loads of the scene).
        The polygon is that of this limit or, if it has none, of the scene's ground.
        """
        of_components = np.asarray(amounts)
        if self.polygon:
            edges, resting = edge_rows(self.polygon, self.height), weight_of_masses(self.machine, at, k, of_components)
        else:
            at_rest = self.stand_in(at)
            edges = edge_rows(at_rest.stand.polygon, at_rest.stand.height)
            resting = of_components[at.loads.names.index(MACHINE_WEIGHT)] * at_rest.weight[k]
        return TippingMoments.compute(edges, resting, at, k, of_components)

    def stand_in(self, at: PostureMatrices) -> StandAtRest:
        """Return what the machine stands on in the postures `at`; raises InputError if their scene has no ground."""
        if at.ground is None:
            raise self._no_ground()
        return at.ground

    def check(self, scene: Scene) -> None:
        """Raise InputError if the scene lacks what the limit needs.

        The limit may need:

        - a probe, contact, function or quantity that it names,
        - the frame's cylinder or ground,
        - a body with a field of stress,
        - an allowed pressure of a pad, if the limit takes its value from the scene.

        No model is built, so names that only a model knows are not checked.
        """
        if self.of in ("luffing", "luffing-pull") and (scene.frame is None or scene.frame.cylinder is None):
            allowed = "a scene with frame.cylinder is allowed, which says where its hinges are"
            raise InputError("study", f"limits.{self.name}.of", self.of, allowed)
        on_ground = self.of == "overturning" and not self.polygon or self.kind.share is _share_of_ground
        if on_ground and (scene.frame is None or scene.frame.ground is None):
            raise self._no_ground()
        if self.of == "function":
            plugin_function(self.name, self.function)
        if self.expression is not None:
            check_names(self.name, self.expression, scene)
        if self.of == "field" and not any(traits_of(member).has_cells for member in members(scene)):
            raise self._unknown_name(())
        if self.kind.names is not None:
            names = self.kind.names(scene)
            if not all(any(matches_pattern((pattern,), name) for name in names) for pattern in self.which):
                raise self._unknown_name(names)
        pads = [pad for name, pad in pads_on_faces(scene).items() if self.concerns(name)] if self.by_scene else []
        if self.by_scene and not any(np.isfinite(pad.allowed_force) for pad in pads):
            allowed = "a force or a pressure is allowed, or allowed_pressure of pads in the scene"
            raise InputError("study", f"limits.{self.name}.most", None, allowed)

    def concerns(self, name: str) -> bool:
        """Return whether the limit depends on the column, probe or point of a stress field called `name`."""
        if self.of not in ("stress", "field"):
            return matches_pattern(self.which, name)
        body, separator, suffix = name.rpartition(FIELD)
        if self.of == "stress":
            return not separator and matches_pattern(self.which, name)
        body, region = body.removesuffix(": "), suffix.rpartition(" ")[0]
        return bool(separator) and (
            matches_pattern(self.which, body or WHOLE) or matches_pattern(self.which, qualified_name(body, region))
        )

    def _no_ground(self) -> InputError:
        """Return the error for a limit on a machine whose outriggers and masses are not known."""
        of_its_own = " or a polygon and a machine of the limit's own" if self.of == "overturning" else ""
        allowed = f"a scene with frame.ground{of_its_own} is needed, to say what the machine stands on"
        return InputError("study", f"limits.{self.name}.of", self.of, allowed)

    def _unknown_name(self, names: Sequence[str]) -> InputError:
        """Return the error for a name in ``which`` that is not among `names`.

        If `names` is empty, the error says that the scene has nothing to limit.
        """
        no_such = f"there is no {self.of}{'' if self.which == ('*',) else ' of this name'}"
        wrong = [of for of in self.which if not any(matches_pattern((of,), name) for name in names)]
        of_begin = [f"{of} *" for of in wrong if any(name.startswith(f"{of} ") for name in names)]
        hint = f"did you mean {of_begin[0]!r}? " if of_begin else similar_name_hint(", ".join(wrong), names)
        allowed = f"{hint}names among {', '.join(names)} are allowed" if names else no_such
        return InputError("study", f"limits.{self.name}.which", ", ".join(self.which), allowed)


def _forms_and_loads(states: LoadedStates) -> Iterator[tuple[Form, float]]:
    """Yield a pair for each state: the `Form` of its closed contacts, and its load in kg."""
    return zip(states.forms, states.load.tolist(), strict=True)


def _ratio(part: float, total: float) -> float:
    """Return `part` divided by `total`; infinite if `total` is not positive."""
    return part / total if total > 0.0 else np.inf


def with_fields(scene: Scene, patterns: Sequence[str], places: int) -> Scene:
    """Return the scene with probes at all stress points of those bodies and regions that fit one of the `patterns`.

    Without patterns the scene is returned as it is.  A region is named by its body and its own name, ``fly: flange``.
    `places` is the number of points of the chart.  Raises InputError if no body or region fits, or if the stresses at
    all these points and places would fill the memory.
    """
    if not patterns:
        return scene
    built, parts, count = tasks.bodies_of(scene), list[Any](), 0
    for name, part in zip(scene.names, scene.sections, strict=True):
        probes = list(_field_probes(name, built[name].structure.model, patterns))
        count += len(probes)
        parts.append(part.with_keys(probes=(*part.probes, *probes)))
    if not count:
        raise InputError("study", "limits.which", ", ".join(patterns), "a body or region with walls is allowed")
    contacts = 12 * len(scene.sections)
    if 3 * count * places * contacts > MOST_NUMBERS:
        allowed = f"fewer places or a coarser mesh: {places} places look at {count} points each"
        raise InputError("study", "limits.which", ", ".join(patterns), allowed)
    return scene.with_keys(sections=tuple(parts))


def _field_probes(name: str, model: Any, patterns: Sequence[str]) -> Iterator[Probe]:
    """Yield probes at the stress points of each region if its name, or its body's name, fits one of the `patterns`.

    Points of a shell are those on its `FACES`.  `name` is that of the body, and `model` its structural model.  Nothing
    is yielded for a model without stresses, or if its stresses are neither on faces nor complete with six components.
    """
    rows = model.stresses() if hasattr(model, "stresses") else None
    if rows is None or not set(FACES) & set(rows.faces) and len(rows.components) < 6:
        return
    faces = [face for face in FACES if face in rows.faces] or list(rows.faces)
    for region, cells in (dict(model.grid.regions) or {WHOLE: np.unique(rows.cell)}).items():
        if not (matches_pattern(patterns, name or WHOLE) or matches_pattern(patterns, qualified_name(name, region))):
            continue
        for face in faces:
            at = rows.points_on(face)
            for number in at[np.isin(rows.cell[at], cells)].tolist():
                point = tuple(float(x) for x in rows.points[number])
                yield Probe(name=f"{FIELD}{region} {number}", at=point, face=face, measures=("stress",))
