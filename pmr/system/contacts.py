"""Contacts between bodies, and the places on bodies that they join."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """Where a row of a body measures: at x(t) = at + rate s(t).

    Attributes
    ----------
    body, row : str
        A body of the system, and one of its rows.
    at : float, m
    path : str, optional
        Name of the path s(t); None where the place does not travel.
    rate : float
        Negative where the place travels towards the body's tail while the path grows.
    """

    body: str
    row: str
    at: float = 0.0
    path: str | None = None
    rate: float = 1.0

    def coordinate(self, s: Mapping[str, ArrayLike]) -> Array:
        """X in m from the path coordinates in m."""
        travelled = np.zeros(()) if self.path is None else self.rate * np.asarray(s[self.path], float)
        return np.asarray(self.at + travelled)


@dataclass(frozen=True)
class Contact:
    """A pad or slider between two places; its force is positive where it pushes the inner body against its `direction`.

    Attributes
    ----------
    name : str
    inner : Place
    outer : Place, optional
        None: on the ground.
    direction : float
        1 or -1: the inner row's displacement, relative to the outer one's, closes the contact along it.
    compliance : float, m/N
        1/k; 0 for a rigid one.
    clearance : float, m, or None
        Of a contact that only pushes: how far the inner place may go before it closes.  None: it holds both ways.
    friction : float
        Coulomb's coefficient along the path.  Nothing is simulated with it: what drives a section has to overcome it.
    """

    name: str
    inner: Place
    outer: Place | None = None
    direction: float = 1.0
    compliance: float = 0.0
    clearance: float | None = None
    friction: float = 0.0

    def __post_init__(self) -> None:
        if self.direction not in (1.0, -1.0):
            raise refused(self.name, "direction", self.direction, "1 or -1 is allowed")
        if not 0.0 <= self.compliance < np.inf:
            raise refused(self.name, "compliance", self.compliance, "0 or more, in m/N, is allowed")
        if self.clearance is not None and not 0.0 <= self.clearance < np.inf:
            raise refused(self.name, "clearance", self.clearance, "a length from 0 on is allowed")
        if self.outer is not None and self.outer.body == self.inner.body:
            raise refused(self.name, "outer", self.outer.body, "another body than the inner one, or none, is allowed")


def refused(contact: str, key: str, value: object, allowed: str) -> InputError:
    """What is wrong with a contact, by its name."""
    return InputError("system", f"contacts.{contact}.{key}", value, allowed)
