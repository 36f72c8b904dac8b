"""What a column of a response is: an output with a kind, a body, a place, a direction and a unit."""

from __future__ import annotations

from dataclasses import dataclass

#: Kinds of outputs: displacements of places along a body and of its tip, forces of pads (sliders are pads without
#: faces), of cylinders and of supports that give way, what probes measure, reactions of rigid supports, friction of all
#: pads of a joint along the boom, places and rates of a machine that moves by itself.
KINDS = ("beam", "tip", "pad", "cylinder", "support", "probe", "reaction", "friction", "machine")
FORCES = ("pad", "cylinder", "support")


@dataclass(frozen=True)
class Output:
    """Meaning of one column of a response."""

    name: str
    kind: str  # one of `KINDS`
    body: str  # empty for a body alone
    place: float | None = None  # m along the body, of displacements
    direction: str = ""  # of displacements x, y or z
    unit: str = "m"

    @property
    def is_force(self) -> bool:
        """Is it the force of a contact or spring?"""
        return self.kind in FORCES

    @classmethod
    def of(cls, name: str, kind: str, body: str, place: float | None, unit: str) -> Output:
        """Output whose kind and direction are given in one, such as ``"tip z"``."""
        what, _, direction = kind.partition(" ")
        return cls(name, what, body, place, direction, unit)
