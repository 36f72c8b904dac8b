"""Contacts between bodies, and the places on bodies that they join."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import BEYOND_ENDS, InputError
from pmr.scene.joints import SHEAR_STIFFNESS
from pmr.scene.names import ALONE as ALONE
from pmr.scene.names import SLIDER as SLIDER
from pmr.scene.names import input_of as input_of
from pmr.scene.names import named as named

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """Place at which a row of a body measures: x(t) = at + rate s(t)."""

    # a body of the system, and one of its rows
    body: str
    row: str
    at: float = 0.0  # m
    path: str | None = None  # name of the path s(t); None where the place does not travel
    rate: float = 1.0  # negative where the place travels towards the body's tail while the path grows

    def coordinate(self, s: Mapping[str, ArrayLike]) -> Array:
        """X in m from the path coordinates in m."""
        travelled = np.zeros(()) if self.path is None else self.rate * np.asarray(s[self.path], float)
        return np.asarray(self.at + travelled)


@dataclass(frozen=True)
class Contact:
    """A pad or slider between two places; a positive force pushes the inner body against its `direction`."""

    name: str
    inner: Place
    outer: Place | None = None  # None: on the ground
    # 1 or -1: the inner row's displacement, relative to the outer one's, closes the contact along it
    direction: float = 1.0
    compliance: float = 0.0  # 1/k in m/N; 0 for a rigid one
    # m, of a contact that only pushes: how far the inner place may go before it closes; None: it holds both ways
    clearance: float | None = None
    friction: float = 0.0  # Coulomb's coefficient along the path (`pmr.system.friction`)
    kind: str = "pad"  # or ``cylinder``, ``support``, ``straight`` (`pmr.results.outputs`)
    arm: float = 0.0  # m: of friction, from the axis to the face that the contact presses on
    shear_stiffness: float = SHEAR_STIFFNESS  # N/m: along the path, while it sticks
    # of a rope (`pmr.system.compliance`): by how much its compliance grows with a path, 1/N, and of which
    lengthening: float = 0.0
    path: str | None = None
    bears: tuple[tuple[str, float], ...] = ()  # shares of the forces of other contacts, by their names

    def __post_init__(self) -> None:
        for place in (self.inner, *filter(None, (self.outer,))):
            if not (np.isfinite(place.at) and np.isfinite(place.rate) and place.rate):
                raise refusal(self.name, "place", (place.at, place.rate), "finite at and rate, rate not 0, are allowed")
        if self.direction not in (1.0, -1.0):
            raise refusal(self.name, "direction", self.direction, "1 or -1 is allowed")
        if not 0.0 <= self.compliance < np.inf:
            raise refusal(self.name, "compliance", self.compliance, "0 or more, in m/N, is allowed")
        if not np.isfinite(self.lengthening) or (self.lengthening and self.path is None):
            raise refusal(self.name, "lengthening", self.lengthening, "a finite number, with a path, is allowed")
        if self.clearance is not None and not 0.0 <= self.clearance < np.inf:
            raise refusal(self.name, "clearance", self.clearance, "a length from 0 on is allowed")
        if not 0.0 < self.shear_stiffness < np.inf:
            raise refusal(self.name, "shear_stiffness", self.shear_stiffness, "more than 0 N/m is allowed")
        if self.outer is not None and self.outer.body == self.inner.body:
            raise refusal(self.name, "outer", self.outer.body, "another body than the inner one, or none, is allowed")


def refusal(contact: str, key: str, value: object, allowed: str) -> InputError:
    """Error about a contact, by its name."""
    return InputError("system", f"contacts.{contact}.{key}", value, allowed)


@dataclass(frozen=True)
class JointPad:
    """A pad of a joint; from `direction` on as of a `Contact`."""

    name: str
    row: str  # what it measures, on both sections
    from_end: float  # m, of the section's tail or mouth that it sits at
    direction: float = 1.0
    compliance: float = 0.0
    clearance: float | None = None
    friction: float = 0.0
    arm: float = 0.0
    shear_stiffness: float = SHEAR_STIFFNESS


@dataclass(frozen=True)
class Joint:
    r"""Pads between two neighbouring sections of a telescope.

    The tail of the inner section is at s on the outer section of length L_out.  A pad at a distance d from the inner
    tail, and a pad at d from the outer mouth, have the places

    .. math:: x_{in} = d,\; x_{out} = s + d \qquad \text{and} \qquad x_{in} = L_{out} - d - s,\; x_{out} = L_{out} - d

    Attributes
    ----------
    inner, outer : str
        Bodies of the system.
    inner_length, outer_length : float, m
    path : str
        Name of the path s(t): the place of the inner tail on the outer section, in m from the outer tail.
    tail, mouth : tuples of JointPad
        Pads that move with the tail of the inner section, and pads that stay at the mouth of the outer one.
    """

    inner: str
    outer: str
    inner_length: float
    outer_length: float
    path: str
    tail: tuple[JointPad, ...]
    mouth: tuple[JointPad, ...]

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """For a `System`."""
        at_tail = [
            (pad, Place(self.inner, pad.row, pad.from_end), Place(self.outer, pad.row, pad.from_end, self.path))
            for pad in self.tail
        ]
        places = [(pad, self.outer_length - pad.from_end) for pad in self.mouth]
        at_mouth = [
            (pad, Place(self.inner, pad.row, x, self.path, -1.0), Place(self.outer, pad.row, x)) for pad, x in places
        ]
        return tuple(
            Contact(
                pad.name,
                inner,
                outer,
                pad.direction,
                pad.compliance,
                pad.clearance,
                pad.friction,
                arm=pad.arm,
                shear_stiffness=pad.shear_stiffness,
            )
            for pad, inner, outer in (*at_tail, *at_mouth)
        )

    def check(self, s: Array) -> None:
        """Refuse places s (T,) m of the inner tail that its pads don't allow.

        Raises
        ------
        InputError
            If the inner section leaves the outer one through its tail, its pads pass those at the mouth, or the inner
            section ends before the pads at the mouth do.
        """
        key, beyond = f"joints.{self.inner}", BEYOND_ENDS * self.outer_length
        first, last = float(np.min(s)), float(np.max(s))
        if first < -beyond:
            allowed = f"0 m or more is allowed: there the tail of {self.inner} is at that of {self.outer}"
            raise InputError("system", key, first, allowed)
        needed = max(pad.from_end for pad in self.tail) + max(pad.from_end for pad in self.mouth)
        overlap = self.outer_length - last
        if not overlap > needed + 1e-9 * self.outer_length:
            allowed = (
                f"less than {self.outer_length - needed:g} m is allowed: the overlap is {overlap:g} m, and pads reach "
                f"{needed:g} m from the tail of {self.inner} and the mouth of {self.outer}"
            )
            raise InputError("system", key, last, allowed)
        least = self.outer_length - min(pad.from_end for pad in self.mouth) - self.inner_length
        if first < least - beyond:
            allowed = (
                f"{least:g} m or more is allowed: else {self.inner} ends before a pad at the mouth of {self.outer}"
            )
            raise InputError("system", key, first, allowed)
