r"""A frame that moves: a boom that is raised (luffing) and turned about the vertical (slewing).

With x along the boom, z up where it lies level, and the angles :math:`\varphi` of luffing and :math:`\psi` of slewing,

.. math::
    \omega = (\dot\psi \sin\varphi,\; -\dot\varphi,\; \dot\psi \cos\varphi)

is the frame's angular velocity in its own axes; the vertical is :math:`(\sin\varphi, 0, \cos\varphi)` there.
"""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from pmr.scene.joints import Linear
from pmr.scene.refusals import of_key
from pmr.scene.section import Point, Section, Switch
from pmr.scene.signals import Constant, Signal, SignalBase

#: What inputs are called that accelerate a body with the frame, before the field: ``inertia x``, ``inertia zx``.
INERTIA = "inertia "


class Frame(Section):
    """A frame that turns about a pivot: every body moves in it, and gravity turns with it."""

    pivot: Point | None = Field(
        default=None, description="Where the tail of the base is from the pivot, along the axes of the boom"
    )
    luffing: Signal | None = Field(default=None, description="Angle over time by which the boom is raised")
    slewing: Signal | None = Field(default=None, description="Angle over time by which it is turned, upwards axis")
    unit: Literal["rad", "degrees"] = Field(default="rad", description="Of both angles")
    second_order: Switch | Literal["auto"] = Field(
        default=False,
        description="Whether axial forces bend what is bent, and the small motion itself feels that the frame turns; "
        "auto: where they come to more than 0.2 % of what buckles the boom",
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.luffing is None and self.slewing is None:
            raise ValueError("an angle is needed: luffing, slewing or both")
        if self.pivot is None:
            raise of_key("pivot", None, "a place is needed, [0.0, 0.0, 0.0] for a base whose tail is at the pivot")
        return self

    @property
    def place(self) -> tuple[float, float, float]:
        """Of the base's tail, from the pivot, m."""
        assert self.pivot is not None  # as the validator says
        return self.pivot

    @property
    def angles(self) -> tuple[SignalBase, SignalBase]:
        """Luffing and slewing in rad."""
        return self._in_rad(self.luffing), self._in_rad(self.slewing)

    def rotation(self, t: ArrayLike) -> NDArray[np.float64]:
        """From axes of the boom into those of the ground at the times t (T,) s, (T, 3, 3)."""
        luffing, slewing = (np.atleast_1d(angle.value(np.asarray(t))) for angle in self.angles)
        return rotation(luffing, slewing)

    def _in_rad(self, angle: SignalBase | None) -> SignalBase:
        if angle is None:
            return Constant(amount=0.0)
        return angle if self.unit == "rad" else Linear(signal=angle, ratio=float(np.pi) / 180.0, offset=0.0)


def rotation(luffing: NDArray[np.float64], slewing: NDArray[np.float64]) -> NDArray[np.float64]:
    r"""From axes of the boom into those of the ground, :math:`R_Z(\psi) R_Y(-\varphi)` (T, 3, 3), of angles (T,) rad.

    On the ground Z is upwards, and X where the boom points at a slewing angle of 0.
    """
    (c, s), (cz, sz) = (np.cos(luffing), np.sin(luffing)), (np.cos(slewing), np.sin(slewing))
    rows = [[cz * c, -sz, -cz * s], [sz * c, cz, -sz * s], [s, np.zeros_like(s), c]]
    return np.moveaxis(np.array(rows), -1, 0)
