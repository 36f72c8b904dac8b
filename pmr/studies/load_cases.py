"""Load cases of a chart: loads that act at once, with the factors that a user chooses, and the standard behind them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from pmr.errors import InputError
from pmr.scene.keys import SceneTable, Usual, key_error

#: Hoisting classes of EN 13001-2: the least dynamic factor phi2,min for drives HD1, and its slope beta2 in s/m.
CLASSES = {"HC1": (1.05, 0.17), "HC2": (1.10, 0.34), "HC3": (1.15, 0.51), "HC4": (1.20, 0.68)}


class Exposed(SceneTable):
    """Area on which wind blows."""

    load: str = Field(description="Name of a load of the scene that acts where the wind does, and along it")
    area: Annotated[float, Field(gt=0.0), Usual(1e-3, 1e4, unit="m^2")] = Field(description="Area across the wind, m^2")
    shape: float = Field(description="Shape factor; negative where the load of the scene points against the wind")


class Wind(SceneTable):
    r"""Wind of constant speed, with a force :math:`F = q A c` on each area, where :math:`q = \rho v^2 / 2`.

    A is the area, c its shape factor, :math:`\rho` the density of the air and v the speed.  Without areas the wind has
    the pressure q on all sections of the boom, as far as they are outside of other sections (`pmr.scene.built.Load`).
    """

    speed: Annotated[float, Field(gt=0.0), Usual(0.5, 75.0, unit="m/s")] = Field(description="m/s")
    density: Annotated[float, Field(gt=0.0), Usual(0.5, 2.0, unit="kg/m^3")] = Field(
        default=1.25, description="Density of the air, kg/m^3"
    )
    on: tuple[Exposed, ...] = Field(
        default=(), description="Areas that the wind acts on; without them it blows on all sections of the boom"
    )
    azimuth: Annotated[float, Usual(0.0, 400.0)] = Field(
        default=0.0,
        description="Without `on`: angle from the boom to the direction in which the wind blows, to the left, in the "
        "scene's unit of angles; 0 blows from behind",
    )
    shape: Annotated[float, Field(gt=0.0)] = Field(
        default=1.6, description="Without `on`: shape factor of sections that have no wind of their own in the scene"
    )

    @model_validator(mode="after")
    def _check_areas(self) -> Self:
        """Refuse a direction and a shape factor beside areas, which have their own."""
        for key in ("azimuth", "shape") if self.on else ():
            if getattr(self, key) != type(self).model_fields[key].default:  # stored studies have all keys
                raise key_error(key, getattr(self, key), "a wind without `on` is allowed with it")
        return self

    @property
    def pressure(self) -> float:
        """Dynamic pressure q in Pa."""
        return self.density * self.speed**2 / 2.0

    @property
    def section_load(self) -> str:
        """Name of the load on all sections; empty if the wind acts on areas."""
        return "" if self.on else f"wind {self.azimuth:g} by {self.shape:g}"

    @property
    def forces(self) -> dict[str, float]:
        """Forces of the wind in N, by name of a load of the scene.

        Each area names a load: the force acts at the place of this load and along its axis.  Forces of areas with the
        same load are summed.  The result is empty if the wind has no areas.
        """
        by_load = dict[str, float]()
        for exposed in self.on:
            by_load[exposed.load] = by_load.get(exposed.load, 0.0) + self.pressure * exposed.area * exposed.shape
        return by_load

    @property
    def acting(self) -> dict[str, float]:
        """Amounts by which the wind acts: `forces` in N or, without areas, the pressure in Pa on all sections.

        The pressure has the name `section_load`.
        """
        return self.forces or {self.section_load: self.pressure}


class Hoist(SceneTable):
    """How a load is hoisted off the ground, for the dynamic factor on its weight that is computed at each point."""

    speed: Annotated[float, Field(gt=0.0), Usual(1e-3, 5.0, unit="m/s")] = Field(
        description="Steady speed of the hook, m/s"
    )
    rope_stiffness: Annotated[float, Field(gt=0.0), Usual(1e4, 1e10, unit="N/m")] = Field(
        description="Stiffness of all falls of the rope together, N/m"
    )
    hoisting_class: str | None = Field(
        default=None, description="One of `classes`, whose factor is shown for comparison"
    )


class LoadCase(SceneTable):
    """Loads that act at once, with factors chosen by the user."""

    name: str = Field(description="What it is called")
    standard: str = Field(default="", description="Source of the factors, for the report")
    weight: Annotated[float, Field(ge=0.0)] = Field(
        default=1.0, description="Factor on the weight of the boom, with the masses on it"
    )
    machine: Annotated[float, Field(ge=0.0)] = Field(
        default=1.0, description="Factor on the weight of the machine's masses, which hold it down"
    )
    load: Annotated[float, Field(ge=0.0)] = Field(
        default=1.0,
        description="Factor on the load that is looked for and on hoisted masses; 0 out of service, without a load",
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

    def check_loads(self, key: str, forces: Mapping[str, bool]) -> None:
        """Raise InputError if the case names a load that the scene lacks, or if wind on an area names no force.

        `key` is the key of the case in the study file, for the message.  `forces` says of each load of the scene, by
        name, whether it is a force.  Wind on an area acts along a force; loads of other kinds are refused there.
        """
        kinds = {"loads": sorted(forces), "forces": sorted(load for load, is_force in forces.items() if is_force)}
        named: list[tuple[str, str, str, Any]] = [
            ("loads", f"loads.{name}", name, amount) for name, amount in self.loads.items()
        ]
        areas = enumerate(self.wind.on if self.wind else ())
        named += [("forces", f"wind.on[{k}].load", exposed.load, exposed.load) for k, exposed in areas]
        for kind, of, name, value in named:
            if name not in kinds[kind]:
                allowed = f"{', '.join(kinds[kind]) or f'no {kind}'} of the scene are allowed"
                raise InputError("study", f"{key}.{of}", value, allowed)

    def hoisting_factor(self, classes: Mapping[str, tuple[float, float]]) -> float:
        """Return the dynamic factor of the case's hoisting class at the case's speed; 1 if the case has no class.

        `classes` has the least factor and its slope over the speed, in s/m, of each hoisting class by name.
        """
        if self.hoisting_class is None or self.hoisting_speed is None:
            return 1.0
        return hoisting_factor(classes[self.hoisting_class], self.hoisting_speed)

    def acting_amounts(self, classes: Mapping[str, tuple[float, float]], hoisted: float = 0.0) -> dict[str, Any]:
        """Return the case as plain values: ``name``, ``weight``, ``machine``, ``load``, ``hoisted`` and ``loads``.

        - ``weight`` and ``machine`` are the factors on the weights of the boom and of the machine.
        - ``load`` is the factor on the load that is searched for: the case's own factor times the hoisting factor with
          the hoisting `classes`.
        - ``hoisted`` is a mass in kg whose weight is added, 0 without a load at the tip.  It is needed for masses of
          the scene that are hoisted with the load; the argument `hoisted` is their sum in kg.  As parts of the boom
          they have the factor ``weight``, but they should have the factor ``load``.  So the added mass is their sum
          times the difference of the two factors.
        - ``loads`` maps the names of loads to their values in their own units, such as N.  The wind's forces, or its
          pressure under the name `Wind.section_load`, are among them.
        """
        load, loads = self.load * self.hoisting_factor(classes), self.loads | (self.wind.acting if self.wind else {})
        factors = {"weight": self.weight, "machine": self.machine, "load": load}
        more = (load - self.weight) * hoisted if self.in_service else 0.0
        return {"name": self.name, **factors, "hoisted": more, "loads": loads}


def hoisting_factor(of_class: tuple[float, float], speed: float) -> float:
    r"""Return :math:`\phi_2 = \phi_{2,min} + \beta_2 v`, the dynamic factor of a hoisting class at a speed v in m/s.

    `of_class` has :math:`\phi_{2,min}` and :math:`\beta_2` in s/m; `speed` is v.
    """
    least, slope = of_class
    return least + slope * speed
