"""A box boom by its dimensions: its profile, what thickens its walls, and where along it nothing changes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from pydantic import Field, ValidationError, model_validator

from pmr.scene.plates import Face
from pmr.scene.profile import BoxProfile, WallName
from pmr.scene.refusals import of_key
from pmr.scene.section import Distance, Length, Section, Size

#: Places along a box are that far apart, as a share of its length: beams on shorter elements lose their digits.
APART = 1e-3
#: Round-off of a user's arithmetic, likewise.
SLACK = 1e-9


class Doubler(Section):
    """Plates on the walls over a part of the length, which then count as that much thicker about the same middle."""

    start: Distance = Field(description="Where they begin along x")
    end: Length = Field(description="Where they end")
    thickness: Length = Field(description="Of the plates")
    faces: tuple[Face, ...] | None = Field(
        default=None, min_length=1, description="On which faces, by default all; rounded corners go with bottom and top"
    )


@dataclass(frozen=True)
class Stretch:
    """A part of a box between two places along it, m, and its profiles there; in between they change linearly."""

    start: float
    end: float
    first: BoxProfile
    last: BoxProfile


class Box(BoxProfile):
    """A tube of plates along x by the dimensions of its mid-surface; width along y, height along z."""

    length: Length = Field(description="Length along x")
    doublers: tuple[Doubler, ...] = Field(default=(), description="Plates that thicken walls over a part of the length")
    frames: tuple[Size, ...] = Field(
        default=(), description="Places along x where a shell is stiffened by a transverse plate all around"
    )
    frame_depth: Distance = Field(default=0.0, description="How far these plates reach inwards from the wall")

    @model_validator(mode="after")
    def _doubles(self) -> Box:
        for i, one in enumerate(self.doublers):
            key = f"doublers[{i}]"
            if not one.start + APART * self.length <= one.end <= (1.0 + SLACK) * self.length:
                least = one.start + APART * self.length
                raise of_key(f"{key}.end", one.end, f"from {least:g} m up to the length, {self.length:g} m, is allowed")
            strange = next((face for face in one.faces or () if face not in self._plates), None)
            if strange:
                raise of_key(f"{key}.faces", strange, f"faces of this profile are allowed: {', '.join(self._plates)}")
        for a, b in pairwise(self.breaks):
            if b - a < (1.0 - SLACK) * APART * self.length:
                allowed = f"one place, or places {APART * self.length:g} m apart, a thousandth of the length, are"
                raise of_key("doublers", None, f"{allowed} allowed: something ends at {a:.6g} and at {b:.6g} m")
            self._thickened(a, b)
        return self

    @property
    def breaks(self) -> list[float]:
        """Places along x where something begins or ends, its ends too, m."""
        found = [0.0]
        for at in sorted(at for one in self.doublers for at in (one.start, one.end)):
            if SLACK * self.length < at - found[-1] and at < (1.0 - SLACK) * self.length:
                found.append(at)
        return [*found, self.length]

    @property
    def stretches(self) -> list[Stretch]:
        """Parts along x in which nothing begins or ends."""
        found = []
        for a, b in pairwise(self.breaks):
            profile = self._thickened(a, b)
            found.append(Stretch(a, b, profile, profile))
        return found

    @property
    def varies(self) -> bool:
        """Whether its section is not the same all along."""
        return bool(self.doublers)

    @property
    def _plates(self) -> list[Face]:
        return [edge.face for edge in self.edges]

    def _thickened(self, start: float, end: float) -> BoxProfile:
        """Its profile between two places, with the doublers that are there."""
        middle = (start + end) / 2.0
        found = {i: one for i, one in enumerate(self.doublers) if one.start < middle < one.end}
        if not found:
            return self
        names: dict[WallName, None] = dict.fromkeys((*self._plates, "bottom", "top"))  # corners take those of halves
        walls: dict[WallName, float] = {
            name: self.thickness(name)
            + sum(one.thickness for one in found.values() if one.faces is None or name in one.faces)
            for name in names
        }
        try:
            return BoxProfile(
                width=self.width, height=self.height, wall=walls, radius=self.radius, chamfer=self.chamfer
            )
        except ValidationError as error:
            (i, one), why = found.popitem(), error.errors()[0]["msg"]
            allowed = f"plates that the profile has room for are allowed; with its walls: {why}"
            raise of_key(f"doublers[{i}].thickness", one.thickness, allowed) from None
