"""The bodies of a scene, and what is said of a body alone."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pmr.errors import InputError
from pmr.scene import asked
from pmr.scene.built import WEIGHT, Body, Load, MeshChoice, PadRing, Slider, Support
from pmr.scene.parts import Part
from pmr.scene.signals import SignalBase
from pmr.scene.structures import PointMass
from pmr.scene.whole import Whole


class Listed(Whole):
    """Bodies from the base out; keys of a body are those of a body alone, and an InputError where there are several."""

    sections: Annotated[tuple[Part, ...], Field(min_length=1)] = Field(description="From the base out")

    @property
    def alone(self) -> Part:
        """The only body; an InputError is raised where there are several."""
        if len(self.sections) > 1:
            allowed = "a scene of one body is allowed here; pmr run takes booms of several sections"
            raise InputError("scene", "sections", None, allowed)
        return self.sections[0]

    @property
    def body(self) -> Body:
        return self.alone.body

    @property
    def mesh(self) -> MeshChoice:
        return self.alone.mesh

    @property
    def supports(self) -> tuple[Support, ...]:
        return self.alone.supports

    @property
    def pads(self) -> tuple[PadRing, ...]:
        return self.alone.pads

    @property
    def masses(self) -> tuple[PointMass, ...]:
        return self.alone.masses

    @property
    def loads(self) -> tuple[Load, ...]:
        return self.alone.loads

    @property
    def observe(self) -> asked.Observe:
        return self.alone.observe

    @property
    def reduction(self) -> asked.Reduction:
        return self.alone.reduction

    @property
    def slider(self) -> Slider:
        slider = self.alone.slider
        assert slider is not None  # as the checks say
        return slider

    @property
    def signals(self) -> dict[str, SignalBase]:
        """Signal of each input of the model, by its name, as users of Exudyn give them to `add_sliding_body`."""
        weight = {WEIGHT: self.gravity.signal} if self.gravity else {}
        return {load.name: load.signal for load in self.loads} | weight

    @property
    def path_bounds(self) -> tuple[float, float]:
        """Smallest and largest s(t) in m over the simulated time."""
        return self.slider.path.bounds(0.0, self.time.end)

    @property
    def travel(self) -> tuple[float, float]:
        """Smallest and largest s in m that the model is made for."""
        return self.slider.travel or self.path_bounds

    @property
    def points(self) -> tuple[float, ...]:
        """Distances ahead of s, m, of the points that slide: none where pads do."""
        if self.slider.offsets is not None:
            return self.slider.offsets
        return () if any(ring.moving for ring in self.pads) else (0.0,)
