"""Load cases of a chart: loads that act at once, factors that the user chooses, the standard that gives the factors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from pmr.errors import InputError
from pmr.scene.keys import SceneTable, Usual

#: Hoisting classes of EN 13001-2: the least dynamic factor phi2,min for drives HD1, and its slope beta2 in s/m.
CLASSES = {"HC1": (1.05, 0.17), "HC2": (1.10, 0.34), "HC3": (1.15, 0.51), "HC4": (1.20, 0.68)}


class Exposed(SceneTable):
    """Area on which wind blows."""

    load: str = Field(description="Name of a load of the scene that acts where the wind does, and along it")
    area: Annotated[float, Field(gt=0.0), Usual(1e-3, 1e4, unit="m^2")] = Field(description="Area across the wind, m^2")
    shape: float = Field(description="Shape factor; negative where the load of the scene points against the wind")


class Wind(SceneTable):
    r"""Wind of constant speed, with a force :math:`F = q A c` on each area, where :math:`q = \rho v^2 / 2`.

    A is the area, c its shape factor, :math:`\rho` the density of the air and v the speed.
    """

    speed: Annotated[float, Field(gt=0.0), Usual(0.5, 75.0, unit="m/s")] = Field(description="m/s")
    density: Annotated[float, Field(gt=0.0), Usual(0.5, 2.0, unit="kg/m^3")] = Field(
        default=1.25, description="Density of the air, kg/m^3"
    )
    on: Annotated[tuple[Exposed, ...], Field(min_length=1)] = Field(description="Areas that the wind acts on")

    @property
    def pressure(self) -> float:
        """Dynamic pressure q in Pa."""
        return self.density * self.speed**2 / 2.0

    @property
    def forces(self) -> dict[str, float]:
        """Forces of the wind in N, by the names of the scene's loads along which they act."""
        by_load = dict[str, float]()
        for exposed in self.on:
            by_load[exposed.load] = by_load.get(exposed.load, 0.0) + self.pressure * exposed.area * exposed.shape
        return by_load


class LoadCase(SceneTable):
    """Loads that act at once, with factors chosen by the user."""

    name: str = Field(description="What it is called")
    standard: str = Field(default="", description="Source of the factors, for the report")
    weight: Annotated[float, Field(ge=0.0)] = Field(default=1.0, description="Factor on all weights")
    load: Annotated[float, Field(ge=0.0)] = Field(
        default=1.0, description="Factor on the load that is looked for; 0 out of service, without a load"
    )
    hoisting_class: str | None = Field(
        default=None, description="One of `classes`, whose factor multiplies the load too"
    )
    hoisting_speed: Annotated[float, Field(gt=0.0), Usual(1e-3, 5.0, unit="m/s")] | None = Field(
        default=None, description="Speed of the hook, m/s"
    )
    loads: dict[str, float] = Field(
        default={},
        description="Loads of the scene by name, in their units (N, N m, K or Pa); those that are not named do not act",
    )
    wind: Wind | None = Field(default=None, description="Forces by speed, areas and shape factors, beside `loads`")

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        """Refuse a hoisting class without a speed, a speed without a class, and a load in both `loads` and `wind`."""
        if (self.hoisting_class is None) != (self.hoisting_speed is None):
            raise ValueError("hoisting_class and hoisting_speed go together")
        twice = set(self.loads) & set(self.wind.forces if self.wind else ())
        if twice:
            raise ValueError(f"loads and wind.on name the same load: {', '.join(sorted(twice))}")
        return self

    @property
    def in_service(self) -> bool:
        """Whether a load hangs at the tip in this load case."""
        return self.load > 0.0

    def check_loads(self, key: str, forces: Mapping[str, bool], classes: Mapping[str, tuple[float, float]]) -> None:
        """Raise InputError if the case names a load or a hoisting class that does not exist.

        `key` is the key of the case in the study file, for the message.  `forces` says of each load of the scene
        whether it is a force, as that of wind on an area is.  `classes` maps the name of a hoisting class to its
        phi2,min and beta2 in s/m, as `hoisting_factor` uses them.
        """
        if self.hoisting_class is not None:
            hoisting_factor(f"{key}.hoisting_class", classes, self.hoisting_class, 0.0)
        named: list[tuple[str, str, Any]] = [(f"loads.{name}", name, amount) for name, amount in self.loads.items()]
        areas = enumerate(self.wind.on if self.wind else ())
        named += [(f"wind.on[{k}].load", exposed.load, exposed.load) for k, exposed in areas]
        for of, name, value in named:
            names = (
                sorted(forces) if of.startswith("loads") else [load for load, is_force in forces.items() if is_force]
            )
            if name not in names:
                kind = "loads" if of.startswith("loads") else "forces"
                allowed = f"{', '.join(sorted(names)) or f'no {kind}'} of the scene are allowed"
                raise InputError("study", f"{key}.{of}", value, allowed)

    def hoisting_factor(self, classes: Mapping[str, tuple[float, float]]) -> float:
        """Return the dynamic factor of the case's hoisting class at the case's speed; 1 if the case has no class."""
        if self.hoisting_class is None:
            return 1.0
        return hoisting_factor("hoisting_class", classes, self.hoisting_class, self.hoisting_speed or 0.0)

    def acting_amounts(self, classes: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
        """Return the case as plain values under the keys ``name``, ``weight``, ``load`` and ``loads``.

        ``weight`` is the factor on all weights.  ``load`` is the factor on the load that is searched for, times the
        hoisting factor.  ``loads`` maps the names of the scene's loads to their values in N or N m; forces of the wind
        are added.
        """
        load, loads = self.load * self.hoisting_factor(classes), self.loads | (self.wind.forces if self.wind else {})
        return {"name": self.name, "weight": self.weight, "load": load, "loads": loads}


def hoisting_factor(key: str, classes: Mapping[str, tuple[float, float]], name: str, speed: float) -> float:
    r"""Return :math:`\phi_2 = \phi_{2,min} + \beta_2 v`, the dynamic factor of a hoisting class at a speed v in m/s.

    `name` is the hoisting class and `speed` is v.  `classes` maps names of classes to :math:`\phi_{2,min}` and
    :math:`\beta_2` in s/m.  InputError, with `key` as the key in its message, is raised for a class that is not among
    `classes`.
    """
    if name not in classes:
        raise InputError("study", key, name, f"one of {', '.join(classes)} is allowed")
    least, slope = classes[name]
    return least + slope * speed
