"""What all sections of a scene are made of: frozen tables, and numbers that know their unit and their bounds.

The bounds are those of double precision, far from all that is built, so that models in any consistent units pass: what
lies beyond is a slip of the pen, and ends in figures that mean nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetJsonSchemaHandler, ValidationInfo

from pmr.errors import InputError
from pmr.errors.text import NAMED, is_name, no_file, visible


@dataclass(frozen=True)
class Usual:
    """Smallest and largest usual magnitude of a number that is not 0, in its unit or in multiples of a scale.

    Scales have names: "length", "mass" and "weight" of the section (of the whole boom outside of sections), "reach" and
    "boom" (its mass) of the whole boom, "time" that is simulated, and what a table adds by `Hinted.hint_scales`.  A
    signal is judged by its largest magnitude; its `unit` stands here.
    """

    low: float
    high: float
    scale: str = ""
    unit: str = ""


class Hinted(BaseModel):
    """A table of a file that tells what is usual of its numbers, beside what their fields declare."""

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Further scales of its numbers, from those around it."""
        return {}

    @property
    def hint_numbers(self) -> dict[str, tuple[float, Usual]]:
        """Further numbers by their keys, such as those that a file may hold in place of a field."""
        return {}


class Section(Hinted):
    """A table of a scene file: frozen, and without keys of its own making."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


@dataclass(frozen=True)
class Quantity:
    """Unit of a number ("1" if it has none), and the smallest and largest one that can be computed with."""

    unit: str
    low: float
    high: float

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core_schema), "unit": self.unit}


_Positive, _NotNegative, _Strict = Field(gt=0.0, strict=True), Field(ge=0.0, strict=True), Field(strict=True)
_Count = Field(ge=1, strict=True)

Length = Annotated[float, _Positive, Quantity("m", 1e-6, 1e6), Usual(1e-5, 300.0)]
Thickness = Annotated[Length, Usual(5e-5, 0.3)]  # of a plate
Size = Annotated[
    float, _Positive, Quantity("m", 0.0, 1e6), Usual(0.0, 300.0)
]  # whoever meshes says how small it may be
Distance = Annotated[float, _NotNegative, Quantity("m", 0.0, 1e6), Usual(0.0, 300.0)]
Place = Annotated[float, _Strict, Quantity("m", -1e6, 1e6), Usual(0.0, 300.0)]
Area = Annotated[float, _Positive, Quantity("m^2", 1e-14, 1e10), Usual(1e-6, 2.0)]
SecondMoment = Annotated[float, _Positive, Quantity("m^4", 1e-26, 1e20), Usual(1e-12, 0.5)]
#: What is stiffer is "rigid".
Stiffness = Annotated[float, _Positive, Quantity("N/m", 1e-6, 1e15), Usual(2e5, 1e14)]
PadStiffness = Annotated[Stiffness, Usual(2e6, 1e14)]
AxialStiffness = Annotated[float, _Positive, Quantity("N", 1e-3, 1e15)]
Pressure = Annotated[float, _Positive, Quantity("Pa", 1e-3, 1e18)]
Density = Annotated[float, _Positive, Quantity("kg/m^3", 1e-9, 1e9)]
Mass = Annotated[float, _NotNegative, Quantity("kg", 0.0, 1e12), Usual(0.05, 1e8)]
Inertia = Annotated[float, _NotNegative, Quantity("kg m^2", 0.0, 1e15)]
Frequency = Annotated[float, _Positive, Quantity("Hz", 1e-9, 1e12)]
Speed = Annotated[float, _Positive, Quantity("m/s", 1e-12, 1e9)]
Time = Annotated[float, _Positive, Quantity("s", 1e-12, 1e9)]
Share = Annotated[float, _NotNegative, Quantity("1", 0.0, 1e9)]
Friction = Annotated[float, _NotNegative, Quantity("1", 0.0, 1.0)]  # dry steel on steel has 0.8
Positive = Annotated[float, _Positive, Quantity("1", 1e-12, 1e18)]
Count = Annotated[int, _Count, Quantity("1", 1, 1_000_000)]
Component = Annotated[float, _Strict, Quantity("1", -1e300, 1e300)]


def _check_name(text: str) -> str:
    if not is_name(text):
        raise ValueError(NAMED)
    return text


#: What something is called, in files that other programs read too.
Name = Annotated[str, AfterValidator(_check_name)]
#: The same where nothing need be said.
NameOrNone = Annotated[str, AfterValidator(lambda text: _check_name(text) if text else text)]
#: Free text, for people: what steers a terminal is spelled out.
Text = Annotated[str, AfterValidator(visible)]

Vector = tuple[Component, Component, Component]
Point = tuple[Place, Place, Place]
Direction = Literal["x", "y", "z", "rx", "ry", "rz"]
Switch = Annotated[bool, Field(strict=True)]


#: Context of a validation that takes the names of files as they are: of a scene that a saved model holds.
RECORDED = {"files": "names"}


def _exists(file: Path, info: ValidationInfo) -> Path:
    if info.context == RECORDED:
        return file
    if not isfile(file):
        raise ValueError(f"{no_file(file)}: {file}")
    try:
        with file.open("rb") as stream:
            stream.read(1)  # a file may open and still not be read
    except OSError as error:
        raise ValueError(f"can't be read: {error.strerror}") from None
    return file


ExistingFile = Annotated[Path, AfterValidator(_exists)]


@cache
def quantity_of(section: type[BaseModel], key: str) -> Quantity | None:
    """Unit and bounds of the numbers that a key of a section holds: one, several, or some by name."""
    return next((part for part in _declarations(section, key) if isinstance(part, Quantity)), None)


@cache
def usual_of(section: type[BaseModel], key: str) -> tuple[Usual, ...]:
    """Usual ranges of these numbers, all of which hold."""
    return tuple(part for part in _declarations(section, key) if isinstance(part, Usual))


def _declarations(section: type[BaseModel], key: str) -> Iterator[Any]:
    field = section.model_fields[key]
    yield from _annotations((*field.metadata, field.annotation))


def _annotations(parts: tuple[Any, ...]) -> Iterator[Any]:
    for part in parts:
        yield part
        yield from _annotations((*getattr(part, "__metadata__", ()), *get_args(part)))


def check_sizes(part: Section) -> None:
    """Refuse any number, in a section or in those within it, that is out of its range."""
    for key, value, quantity in _quantities(part, ""):
        if not quantity.low <= value <= quantity.high:
            raise InputError(
                "scene", key, value, f"a number from {quantity.low:g} to {quantity.high:g} is allowed (SI units)"
            )


def _quantities(part: Any, key: str, quantity: Quantity | None = None) -> Iterator[tuple[str, float, Quantity]]:
    """Key and value of every number in a section and in those within it, and what is known of it."""
    if isinstance(part, (int, float)) and quantity is not None:
        yield key, part, quantity
    elif isinstance(part, (tuple, list)):
        for i, entry in enumerate(part):
            yield from _quantities(entry, f"{key}[{i}]", quantity)
    elif isinstance(part, dict):
        for name, entry in part.items():
            yield from _quantities(entry, f"{key}.{name}", quantity)
    elif isinstance(part, Section):
        for name in type(part).model_fields:
            entry_key = f"{key}.{name}" if key else name
            yield from _quantities(getattr(part, name), entry_key, quantity_of(type(part), name))
