r"""Systems of bodies and the contacts between them; each place of a contact has a path coordinate of its own.

.. math::
    M_b \ddot q_b + D_b \dot q_b + K_b q_b + \sum_\rho C_{\rho b}^T \lambda_\rho = B_b f, \qquad
    \sum_b C_{\rho b} q_b + H_\rho f - \sum_\sigma (G_{\rho\sigma} + \delta_{\rho\sigma} / k_\rho) \lambda_\sigma = 0

for bodies b with coordinates q, and contacts rho and sigma with forces lambda and pads of the compliance 1/k.  C is
+c(x) on the inner body of a contact and -c(x) on its outer body; G and H belong to the residual flexibility, f are the
inputs (docs/system_of_bodies.md).  The ground is a body without coordinates.  A single body on one path is the special
case in which all contacts are with the ground.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pmr.errors import BEYOND_ENDS, InputError, overview
from pmr.files.arrays import Array
from pmr.scene.signals.base import Interval
from pmr.system import saved
from pmr.system.body import Body, SlidingBody, names_of, units_of
from pmr.system.contacts import (
    ALONE,
    SLIDER,
    Compliance,
    Contact,
    Friction,
    Place,
    contact_error,
    input_name,
    qualified_name,
)
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row
from pmr.system.terms import Hoist, Term, recorded_hoist, term_error


@dataclass(frozen=True)
class Side:
    """One of the two places that a contact joins: the contact's number, the place, and the sign of the place's row."""

    contact: int
    place: Place
    sign: float


AnyBody = TypeVar("AnyBody", bound=Body, covariant=True)


@dataclass(frozen=True)
class BodySystem(Generic[AnyBody]):
    """Bodies of one kind, the m contacts that join them, and the terms that vary in time.

    An InputError is raised for any of these faults:

    - a contact or term names a missing body or row, or a rope's path does not exist;
    - a contact has friction, and neither of its places travels on a path with the name of its inner body;
    - two contacts or two terms have the same name;
    - a body has no carriers and the system is not `on_one_path`;
    - a full body's support combines several coordinates, and no contact uses it.
    """

    # by their names; their rows are on carriers, or in tables over its path for a single body
    bodies: Mapping[str, AnyBody]
    contacts: tuple[Contact, ...]
    terms: tuple[Term, ...] = field(default=(), kw_only=True)  # terms of the equations of motion that vary in time
    hoist: Hoist = field(default=Hoist(), compare=False, repr=False, kw_only=True)  # whose rope pulls inputs

    def __post_init__(self) -> None:
        for term in self.terms:
            if [other.name for other in self.terms].count(term.name) > 1:
                raise term_error(term.name, "name", term.name, "names that differ are allowed")
            for name in term.bodies:
                if name not in self.bodies:
                    raise term_error(term.name, "bodies", name, f"{', '.join(self.bodies)} are allowed")
        names = self.contact_names
        for contact in self.contacts:
            if names.count(contact.name) > 1:
                raise contact_error(contact.name, "name", contact.name, "names that differ are allowed")
            travels = {place.path for place in (contact.inner, contact.outer) if place is not None}
            if contact.friction and contact.inner.body not in travels:
                allowed = f"0 is allowed, or a place that travels on the path {contact.inner.body!r}"
                raise contact_error(contact.name, "friction", contact.friction, allowed)
        for side in self.sides:
            name, place = self.contacts[side.contact].name, side.place
            if place.body not in self.bodies:
                raise contact_error(name, "body", place.body, f"{', '.join(self.bodies)} are allowed")
            body = self.bodies[place.body]
            if place.row not in body.row_names:
                raise contact_error(name, "row", place.row, f"{', '.join(body.row_names)} are allowed on {place.body}")
        for path in self.compliance.paths:
            if path not in self.paths:
                rope = next(contact.name for contact in self.contacts if contact.lengthening and contact.path == path)
                raise contact_error(rope, "path", path, f"{', '.join(self.paths) or 'none'} are allowed")
        for name, body in self.bodies.items():
            if body.carriers is None and not self.on_one_path:
                allowed = "a model with carriers is allowed (`pmr.reduction.residual.section_model`)"
                raise InputError("system", f"bodies.{name}", None, allowed)
            used = {side.place.row for side in self.sides if side.place.body == name}
            missing = [row for row in body.lasting_rows if row not in used]
            if missing:
                allowed = f"the row {missing[0]} always holds {name}: a contact of it with the ground is needed"
                raise InputError("system", "contacts", None, allowed)

    @property
    def on_one_path(self) -> bool:
        """Whether this is one body whose contacts share one path, and each join a row of its own to the ground."""
        places = [contact.inner for contact in self.contacts]
        return (
            len(self.bodies) == 1
            and len(self.paths) <= 1
            and len({place.row for place in places}) == len(places)
            and all(contact.outer is None and contact.direction == 1.0 for contact in self.contacts)
            and all(place.path is None or (place.at, place.rate) == (0.0, 1.0) for place in places)
        )

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts."""
        return tuple(contact.name for contact in self.contacts)

    @cached_property
    def sides(self) -> tuple[Side, ...]:
        """Sides of all contacts in their order: for each contact the inner side, then an outer side on a body."""
        sides = []
        for k, contact in enumerate(self.contacts):
            sides.append(Side(k, contact.inner, contact.direction))
            if contact.outer is not None:
                sides.append(Side(k, contact.outer, -contact.direction))
        return tuple(sides)

    def sides_of(self, body: str) -> list[int]:
        """Numbers of the sides, among `sides`, that are on the body called `body`."""
        return [number for number, side in enumerate(self.sides) if side.place.body == body]

    def side_multipliers(self, body: str, forces: Array) -> Array:
        """Multipliers (T, k) in N on the k sides of a body: contact forces (T, m) in N times the sign of each side."""
        return np.asarray(forces @ self._signs[body])

    @cached_property
    def _signs(self) -> dict[str, Array]:
        """Matrix (m, k) for each body, by its name: the sign of its side k in the row of the side's contact, else zero.

        A product with this matrix is ten times as quick as picking columns.
        """
        signs = {}
        for body in self.bodies:
            body_sides = [self.sides[number] for number in self.sides_of(body)]
            signs[body] = np.zeros((len(self.contacts), len(body_sides)))
            for k, side in enumerate(body_sides):
                signs[body][side.contact, k] = side.sign
        return signs

    @property
    def paths(self) -> tuple[str, ...]:
        """Names of the P paths along which places of contacts travel, each once."""
        return tuple(dict.fromkeys(side.place.path for side in self.sides if side.place.path is not None))

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs of all bodies: ``body.input``, or only ``input`` if there is a single body."""
        return tuple(
            input_name(name, body_input) for name, body in self.bodies.items() for body_input in body.input_names
        )

    @property
    def load_columns(self) -> dict[str, slice]:
        """Columns of each body's inputs among `input_names`, by the bodies' names."""
        counts = [len(body.input_names) for body in self.bodies.values()]
        return dict(zip(self.bodies, consecutive(counts), strict=True))

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of the loads that a user gives if there is no frame.

        They are the inputs that no hoist rope pulls, then the drivers of a hoist.
        """
        return (*(name for name in self.input_names if name not in self.hoist.inputs), *self.hoist.drivers)

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the terms that vary in time."""
        return tuple(term.name for term in self.terms)

    @cached_property
    def compliance(self) -> Compliance:
        """Compliance A(s) (m, m) of the m contacts: of their pads, supports, cylinders and ropes, not of bodies."""
        return Compliance.from_contacts(self.contacts)

    def contact_compliance(self, x: Array) -> Array:
        """Compliance (..., m, m) in m/N of the contacts themselves, with the sides at x (..., sides) in m."""
        return self.compliance.matrix(self.rope_coordinates(x))

    def rope_coordinates(self, x: Array) -> Array:
        """Path coordinates (..., Q) in m of the Q paths that lengthen ropes, in the order of `compliance.paths`.

        The path coordinates follow from the coordinates x (..., sides) in m of all places on their bodies.
        """
        lengths = []
        for path in self.compliance.paths:
            k, place = next((k, side.place) for k, side in enumerate(self.sides) if side.place.path == path)
            lengths.append((x[..., k] - place.at) / place.rate)
        return np.moveaxis(np.array(lengths).reshape(-1, *x.shape[:-1]), 0, -1)

    @property
    def clearance(self) -> Array:
        """Clearance (m,) in m of each contact that only pushes; NaN for contacts that hold both ways."""
        return np.array([np.nan if c.clearance is None else c.clearance for c in self.contacts])

    def row(self, place: Place) -> Row:
        """Return the row that measures the motion at a place, for any path coordinate; it is built at the first call.

        The row has weights on the carriers of the place's body (`pmr.system.rows`).
        """
        if place not in self._rows:
            body = self.bodies[place.body]
            assert body.carriers is not None
            self._rows[place] = body.carriers.row(body.row_names.index(place.row), place.row)
        return self._rows[place]

    @cached_property
    def _rows(self) -> dict[Place, Row]:
        """Rows that the method `row` has built, by their places; empty at first."""
        return {}

    def range_of(self, place: Place) -> Interval:
        """Lowest and highest coordinate in m, on the place's body, at which the row of the place is defined."""
        body = self.bodies[place.body]
        if body.carriers is None:
            return body.domain
        breaks = self.row(place).breaks
        return Interval(float(breaks[0]), float(breaks[-1]))

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest coordinate in m of each path, by the path's name.

        Between these the rows of all places of the path are defined.
        """
        ranges = {path: (-np.inf, np.inf) for path in self.paths}
        for side in self.sides:
            place = side.place
            if place.path is not None:
                ends = sorted((x - place.at) / place.rate for x in self.range_of(place))
                low, high = ranges[place.path]
                ranges[place.path] = max(low, ends[0]), min(high, ends[1])
        return ranges

    def side_rates(self, rates: Mapping[str, ArrayLike]) -> Array:
        """Rates (..., sides) in m/s of the places of all sides; `rates` maps names of all paths to their rates in m/s.

        A place that does not travel has the rate 0.
        """
        shape = np.broadcast_shapes(*(np.shape(values) for values in rates.values()))
        by_side = np.zeros((*shape, len(self.sides)))
        for k, side in enumerate(self.sides):
            if side.place.path is not None:
                by_side[..., k] = side.place.rate * np.asarray(rates[side.place.path])
        return by_side

    def side_coordinates(self, s: Mapping[str, ArrayLike]) -> Array:
        """Coordinates x (..., sides) in m of all places on their bodies; `s` maps names of paths to coordinates in m.

        The result is clipped to the ranges of the rows, which round-off may exceed.  An InputError is raised if a path
        is missing from `s`, or leads a place to where its row is not defined.
        """
        for side in self.sides:
            if side.place.path is not None and side.place.path not in s:
                allowed = f"a path for it is needed; given: {', '.join(s) or 'none'}"
                raise contact_error(self.contacts[side.contact].name, "path", side.place.path, allowed)
        x = np.empty((len(self.sides), *np.broadcast_shapes(*(np.shape(values) for values in s.values()))))
        for k, side in enumerate(self.sides):
            x[k] = at = side.place.coordinate(s)
            (least, most), (low, high) = (at.min(initial=np.inf), at.max(initial=-np.inf)), self.range_of(side.place)
            if least >= low and most <= high:
                continue
            slack = BEYOND_ENDS * (high - low)
            outside = ~((at >= low - slack) & (at <= high + slack))  # so is a path that is not finite
            if outside.any():
                allowed = f"{low:g} to {high:g} m are allowed on {side.place.body}"
                raise contact_error(self.contacts[side.contact].name, "place", float(at[outside][0]), allowed)
            x[k] = np.clip(at, low, high)
        return np.moveaxis(x, 0, -1)


@dataclass(frozen=True)
class System(BodySystem[SlidingBody]):
    """Bodies and the contacts that join them; each body is a reduced model, or a full one stored on one process."""

    provenance: dict[str, Any] = field(default_factory=dict)  # how it was made: scene, its hash, versions
    # function that makes the terms for other models of the bodies; None for a system from a file, which has only terms
    terms_of: Callable[[Mapping[str, SlidingBody]], tuple[Term, ...]] | None = field(
        default=None, compare=False, repr=False, kw_only=True
    )
    # by name: models of bodies before cylinder modes and modes without inertia were added; they serve to estimate
    # errors
    on_modes: Mapping[str, ReducedModel] = field(default_factory=dict, repr=False, kw_only=True)

    def __repr__(self) -> str:
        sizes = [f"{name or 'body'} ({body.size} coordinates)" for name, body in self.bodies.items()]
        return overview("System", bodies=sizes, contacts=self.contact_names)

    @cached_property
    def largest_flexibility(self) -> float:
        """Largest residual flexibility in m/N of a carrier or row of the bodies; 0 if the bodies have none."""
        largest = 0.0
        for body in self.bodies.values():
            if body.carriers is not None and body.carriers.flexibility is not None:
                largest = max(largest, float(body.carriers.flexibility.rows.diagonal().max(initial=0.0)))
            elif body.carriers is None and body.flexibility is not None:
                at_breaks = np.diagonal(body.flexibility.rows.c[-1], axis1=1, axis2=2)
                largest = max(largest, float(at_breaks.max(initial=0.0)))
        return largest

    def with_bodies(self, bodies: Mapping[str, SlidingBody]) -> System:
        """Return the system with other models of the same bodies.

        If the system has a function `terms_of`, it makes the terms of these models; otherwise the terms are taken over
        as they are.  The models in `on_modes` belong to the present bodies, so the result has none.
        """
        terms = self.terms if self.terms_of is None else self.terms_of(bodies)
        return replace(self, bodies=bodies, terms=terms, on_modes={})

    def __post_init__(self) -> None:
        super().__post_init__()
        for term in self.terms:
            term.check(sum(self.bodies[name].size for name in term.bodies))

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs of all bodies: ``body: output``, or only ``output`` if there is a single body."""
        return tuple(qualified_name(name, output) for name, body in self.bodies.items() for output in names_of(body))

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit of each output, in the order of `output_names`."""
        return tuple(unit for body in self.bodies.values() for unit in units_of(body))

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input of reduced bodies, in the order of `input_names`; inputs of full bodies are left out."""
        return tuple(unit for body in self.bodies.values() for unit in getattr(body, "input_units", ()))

    @property
    def reduced(self) -> dict[str, ReducedModel]:
        """Reduced bodies by their names.

        An InputError is raised if a body is not reduced.
        """
        reduced_bodies = {name: body for name, body in self.bodies.items() if isinstance(body, ReducedModel)}
        for name in self.bodies:
            if name not in reduced_bodies:
                kind = type(self.bodies[name]).__name__
                raise InputError("system", f"bodies.{name}", kind, "a ReducedModel is allowed here")
        return reduced_bodies

    @property
    def modal(self) -> dict[str, ReducedModel]:
        """Reduced bodies by their names: the models in `on_modes`, and those in `reduced` of all other bodies.

        The models in `on_modes` have neither cylinder modes nor modes without inertia.  An InputError is raised if a
        body is not reduced.
        """
        return self.reduced | dict(self.on_modes)

    def ensure_constant(self, source: str) -> System:
        """Return the system; raise an InputError if the system has terms that vary in time, friction, or a hoist.

        `source` is what can't handle them, such as a file's name; the message begins with it.
        """
        self.ensure_without_terms(source).ensure_frictionless(source)
        if self.hoist:
            allowed = (
                "a scene without it is allowed here; march, a stepper and an FMU for Co-Simulation follow its payload"
            )
            raise InputError(source, "hoist", None, allowed)
        return self

    def ensure_frictionless(self, source: str) -> System:
        """Return the system; raise an InputError about `source` if a contact has friction.

        `source` is what can't handle friction.
        """
        if (friction := Friction.from_contacts(self.contacts)) is not None:
            names = ", ".join(self.contact_names[k] for k in friction.pads)
            raise InputError(source, "friction", names, "0 is allowed here; `pmr simulate` follows friction")
        return self

    def ensure_without_terms(self, source: str) -> System:
        """Return the system; raise an InputError about `source` if the system has terms that vary in time.

        `source` is what can't handle such terms.
        """
        if self.terms:
            allowed = (
                "a system without terms that vary in time (a frame that moves, second order) is allowed here; "
                "`pmr simulate` follows them if all motions are prescribed"
            )
            raise InputError(source, "terms", ", ".join(self.term_names), allowed)
        return self

    def save(self, path: str | Path) -> Path:
        """Write reduced bodies, contacts, terms and provenance to one npz file without pickle; return its path.

        The file also has the models in `on_modes`, with which errors are estimated.  An InputError is raised if a body
        is not reduced.
        """
        saved.write(
            Path(path), saved.StoredSystem(self.reduced, self.contacts, self.terms, self.provenance, self.on_modes)
        )
        return Path(path)

    @classmethod
    def load(cls, path: str | Path) -> System:
        """Read a system from a file that `save` wrote; the file of one reduced model gives a system of one body.

        Raises
        ------
        InputError
            If the file is missing, is neither a system nor a reduced model, has less content than its header says,
            contradicts itself, or has a later format.
        """
        content = saved.read(Path(path))
        try:
            if isinstance(content, ReducedModel):
                return cls.of(content)
            return cls(
                content.bodies,
                content.contacts,
                content.provenance,
                terms=content.terms,
                on_modes=content.on_modes,
                hoist=recorded_hoist(content.provenance),
            )
        except InputError as error:
            raise InputError(str(path), error.key, error.value, error.allowed) from None

    @classmethod
    def of(cls, body: SlidingBody) -> System:
        """Return the system of a single body.

        Each of its rows is a contact with the ground, unless it is in `body.held`.  Places whose rows depend on s
        travel on the path ``slider``.  An InputError is raised if the body is a section of a boom, because the joints
        that hold it are missing.
        """
        body.ensure_whole("system")
        provenance = body.provenance if isinstance(body, ReducedModel) else {}
        return cls({ALONE: body}, ground_contacts(body), provenance, hoist=recorded_hoist(provenance))


def ground_contacts(body: Body) -> tuple[Contact, ...]:
    """Contacts of a single body with the ground, one for each row that is not in `body.held`.

    Rows in `body.held` are supports that fix one coordinate of the model, which is left out of the equations.
    """
    return tuple(
        Contact(
            name,
            Place(ALONE, name, path=SLIDER) if number in body.moving else Place(ALONE, name, body.domain[0]),
            compliance=float(body.row_compliance[number]),
            clearance=None if np.isnan(body.row_clearance[number]) else float(body.row_clearance[number]),
        )
        for number, name in enumerate(body.row_names)
        if number not in body.held
    )


def consecutive(sizes: Iterable[int]) -> tuple[slice, ...]:
    """Consecutive slices of the given sizes, from 0 on."""
    ends = np.cumsum([0, *sizes]).tolist()
    return tuple(slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
