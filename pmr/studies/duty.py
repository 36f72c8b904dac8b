"""Load cases of a chart, and its duty tables: the allowed load over radius and boom length, as manuals print it.

A load case has the loads that act at once, and factors that the user chooses, with the standard that gives them.  A
duty table has a load at each round radius, and at the least and the greatest one.  It is interpolated between the
luffing angles of the chart; outside the radii that a boom length reaches there is none.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.interpolate import PchipInterpolator

from pmr.errors import InputError, letters
from pmr.errors.environment import import_package
from pmr.files.arrays import Array
from pmr.scene.keys import SceneTable, Usual, key_error
from pmr.studies.charting import governing_limit
from pmr.studies.study import csv_text

#: Words in place of a limit where none is reached up to the largest load that is tried.
NOT_LIMITED = "not limited by what is looked at"
#: Distances in m between the radii of a table, times a power of ten, and the largest number of radii.
STEPS, MOST_RADII = (1.0, 2.0, 5.0), 30
#: Largest difference in rad between angles that count as the same; also a share of a radius.
SAME_ANGLE = 1e-6


@dataclass(frozen=True)
class ChartLoads:
    """Loads (..., l) in kg at which l limits are reached at the points of a chart, with their errors (..., l) in kg.

    A load is NaN where no load up to `up_to` in kg reaches the limit; an error that is NaN counts as 0.
    """

    load: Array
    error: Array
    up_to: float

    @cached_property
    def least(self) -> Array:
        """Smallest load of all limits (...,) in kg; infinite where no limit is reached."""
        return np.asarray(np.nan_to_num(self.load, nan=np.inf).min(axis=-1))

    @cached_property
    def which(self) -> NDArray[np.int64]:
        """Number of the limit with the smallest load (...,); -1 where no limit is reached."""
        return governing_limit(self.load)

    @cached_property
    def lower(self) -> Array:
        """Loads (..., l) in kg less their errors; a limit that is not reached has the load `up_to`."""
        return np.asarray(np.nan_to_num(self.load, nan=self.up_to) - np.nan_to_num(self.error))

    @cached_property
    def lower_bound(self) -> Array:
        """Load (...,) in kg that all limits allow at least, less the errors; 0 where this is negative."""
        return np.maximum(self.lower.min(axis=-1), 0.0)

    @cached_property
    def may_govern(self) -> NDArray[np.bool_]:
        """Whether each limit may govern within the errors (..., l); false at points where only one may.

        A limit may govern if its load minus its error is at most the smallest sum of load and error of any limit at the
        point.  A limit that is not reached may govern only if `up_to` minus its error is below `up_to`.
        """
        not_reached = np.isnan(self.load)
        low = np.where(not_reached & (self.lower >= self.up_to), np.inf, self.lower)
        high = np.where(not_reached, np.inf, self.load + np.nan_to_num(self.error)).min(axis=-1, keepdims=True)
        may = (low <= high) & np.isfinite(low)
        return np.asarray(may & (may.sum(axis=-1, keepdims=True) > 1))


class LeastLoads(NamedTuple):
    """Smallest loads of all slewing angles, for E boom lengths in increasing order, A luffing angles and l limits."""

    load: Array  # (E, A, l) kg, NaN where a limit is not reached
    error: Array  # (E, A, l) kg
    place: Array  # (E, A, 2) m, radius and height of the tip from the pivot
    luffing: Array  # (A,) rad
    order: NDArray[np.int64]  # (E,), number of the row of the chart that has each boom length

    @classmethod
    def from_rows(cls, rows: Sequence[Mapping[str, Array]], turns: int) -> LeastLoads:
        """Return the smallest loads of all `turns` slewing angles, from the arrays of all rows of a chart.

        The arrays of a row, by name, are those of `pmr.studies.charting.allow_row`.  Their first axis has the points of
        the row, all slewing angles of a luffing angle in succession.
        """
        load, error, place = (
            np.array([row[name].reshape(-1, turns, row[name].shape[1]) for row in rows])
            for name in ("load", "error", "place")
        )
        at = np.where(np.isnan(load), np.inf, load).argmin(axis=2)[:, :, None]
        load, error = (np.take_along_axis(values, at, 2)[:, :, 0] for values in (load, error))
        place = place[:, :, 0]
        order = np.argsort(np.linalg.norm(place[:, 0], axis=1), kind="stable")
        return cls(load[order], error[order], place[order], rows[0]["luffing"].reshape(-1, turns)[:, 0], order)

    def at_radii(self, radii: Array, lower: Array, e: int, up_to: float) -> Array:
        """Return loads, lower bounds and differences (3, R, l) in kg of l limits at R `radii`, for one boom length.

        The boom length has the number `e`, and the `radii` (R,) in m are those of the tip.  All three are NaN at radii
        that the tip does not reach.  Loads are interpolated between luffing angles with curves.  The differences are
        those between interpolation with curves and with straight lines.  Lower bounds are interpolated from `lower`
        (E, A, l) in kg, the bounds with E boom lengths at A luffing angles; the differences are subtracted from them.
        A limit that is not reached counts as reached at `up_to` in kg.  If the tip has a radius at two angles, above
        and below the horizontal, the smaller load and bound count, and the larger difference.
        """
        luffing, order = np.unique(self.luffing, return_index=True)
        place, load = self.place[e, order, 0], np.nan_to_num(self.load[e, order], nan=up_to)
        angles = _angles_at_radii(radii, place, luffing)
        of_load, straight, bound = (
            interpolate_loads(angles, luffing, values, up_to, smooth=smooth)
            for values, smooth in ((load, True), (load, False), (lower[e, order], True))
        )
        apart = np.abs(of_load - straight)
        return np.array([np.fmin(*of_load), np.fmin(*np.maximum(bound - apart, 0.0)), np.fmax(*apart)])


@dataclass(frozen=True)
class DutyTable:
    """Allowed loads at R radii for E boom lengths; NaN outside the radii that a boom length reaches.

    Where no limit is reached, the load is `up_to`, the largest one that was tried: the allowed load is larger.
    """

    radii: Array  # (R,) m
    lengths: Array  # (E,) m, distances of the undeformed tip from the pivot
    load: Array  # (R, E) kg
    lower: Array  # (R, E) kg: the load less its error bars
    which: NDArray[np.int64]  # (R, E), number of the limit that governs; -1 where no limit is reached
    up_to: float  # kg
    extensions: tuple[Mapping[str, Any], ...] = ()  # (E,) mappings of extensions in m by parameter of the study's runs
    interpolation: float = 0.0  # largest share of a load by which straight lines differ from the curves between angles

    @property
    def column_names(self) -> list[str]:
        """Boom lengths as text, with the extensions of each section where several columns have the same length."""
        names = [f"{length:.4g} m" for length in self.lengths]
        return [
            f"{name} ({extensions_text(self.extensions[e])})" if self.extensions and names.count(name) > 1 else name
            for e, name in enumerate(names)
        ]

    def load_text(self, load: float, digits: str = ".0f") -> str:
        """Return a load in kg as text in the format `digits`.

        A load at which the search ended is ``>`` and the largest load that was tried.
        """
        return f">{self.up_to:{digits}}" if load >= self.up_to else f"{load:{digits}}"

    @classmethod
    def from_loads(cls, least: LeastLoads, up_to: float, rows: Sequence[Mapping[str, Any]] = ()) -> DutyTable:
        """Return the duty table from the loads `least` of a chart; `up_to` is the largest load in kg that was tried.

        `rows` are the parameters of the rows of the chart, the extensions in m; they tell boom lengths apart that are
        equal.
        """
        radii = _round_radii(least.place[:, :, 0])
        lower = np.maximum(ChartLoads(least.load, least.error, up_to).lower, 0.0)
        columns = np.array([least.at_radii(radii, lower, e, up_to) for e in range(len(least.load))])
        load, bound, apart = np.moveaxis(columns, 0, 2)  # (R, E, l) each
        limited, which = load.min(axis=2), load.argmin(axis=2)
        between = (limited > 0.0) & (limited < up_to)
        share = np.take_along_axis(apart, which[..., None], 2)[between, 0] / limited[between]
        lengths = np.linalg.norm(least.place[:, 0], axis=1)
        which, extensions = np.where(limited < up_to, which, -1), tuple(rows[row] for row in least.order if rows)
        return cls(radii, lengths, limited, bound.min(axis=2), which, up_to, extensions, share.max(initial=0.0))

    def csv(self, names: Sequence[str]) -> str:
        """Return the table as text in CSV; `names` are the names of the limits.

        Each boom length has columns for load, lower bound and limit; their cells are empty at radii that it does not
        reach.
        """
        heads = ["radius [m]"]
        for name in self.column_names:
            heads += [f"{name}: {column}" for column in ("load [kg]", "lower bound [kg]", "governed by")]
        rows = []
        for r, radius in enumerate(self.radii):
            row = [f"{radius:.9g}"]
            for e in range(len(self.lengths)):
                reached = np.isfinite(self.load[r, e])
                by = names[self.which[r, e]] if self.which[r, e] >= 0 else NOT_LIMITED
                cells = (*(self.load_text(of[r, e], ".9g") for of in (self.load, self.lower)), by)
                row += cells if reached else ("", "", "")
            rows.append(row)
        return csv_text(heads, rows)

    def workbook(self, title: str, names: Sequence[str]) -> bytes:
        """Return the table as an XLSX file with the given title, and sheets of loads, lower bounds and limits.

        A cell holds the load as a number, and shows the letter of its limit after it; where no limit is reached it
        holds ``>`` and the largest load that was tried, as text.  `names` are those of the limits.  Raises InputError
        if openpyxl is not installed.
        """
        book = import_package("openpyxl").Workbook()
        book.properties.title = title
        for sheet, values in ((book.active, self.load), (book.create_sheet(), self.lower)):
            sheet.title = "Loads in kg" if values is self.load else "Lower bounds in kg"
            lengths = zip(self.lengths, self.column_names, strict=True)
            heads = (name if "(" in name else round(float(length), 3) for length, name in lengths)
            sheet.append(["radius in m, boom length in m →", *heads])
            for radius, row in zip(self.radii, values, strict=True):
                loads = (None if np.isnan(cell) else float(cell) for cell in row)
                cells = (self.load_text(cell) if cell is not None and cell >= self.up_to else cell for cell in loads)
                sheet.append([float(radius), *cells])
            for r, row in enumerate(self.which, start=2):
                for e, number in enumerate(row, start=2):
                    sheet.cell(r, e).number_format = f'0" {letters(int(number))}"' if number >= 0 else "0"
            sheet.freeze_panes, sheet.column_dimensions["A"].width = "B2", 32
        legend = book.create_sheet("Limits")
        legend.append(["letter", "limit"])
        for number, name in enumerate(names):
            legend.append([letters(number), name])
        file = io.BytesIO()
        book.save(file)
        return file.getvalue()


def extensions_text(parameters: Mapping[str, Any]) -> str:
    """Return the extensions in m of a row of a chart as text with their names, such as "fly 3.2 + middle 0".

    `parameters` are the extensions of the row's run, by names such as ``extension.fly``; None stands for 0.  The text
    is empty without extensions.
    """
    return " + ".join(f"{name.removeprefix('extension.')} {float(out or 0.0):.4g}" for name, out in parameters.items())


def _angles_at_radii(radii: Array, place: Array, luffing: Array) -> Array:
    """Return the two luffing angles (2, R) in rad at which the tip has each of the `radii` (R,) in m.

    `place` (A,) are the tip's radii in m at A increasing angles `luffing`.  An angle is NaN if it is outside their
    range, or if the tip has the radius at no angle, or at no second one.
    """
    angles = np.full((2, len(radii)), np.nan)
    if len(luffing) == 1:
        angles[0, np.isclose(radii, place[0], rtol=1e-9)] = luffing[0]
        return angles
    # the tip turns about the pivot: its radius is across cos(angle) + up sin(angle)
    across, up = np.linalg.lstsq(np.column_stack([np.cos(luffing), np.sin(luffing)]), place, rcond=None)[0]
    length = np.hypot(across, up)
    turned = np.where(radii <= length * (1.0 + SAME_ANGLE), np.arccos(np.clip(radii / length, -1.0, 1.0)), np.nan)
    angles[:] = np.arctan2(up, across) + np.array([[1.0], [-1.0]]) * turned
    outside = (angles < luffing[0] - SAME_ANGLE) | (angles > luffing[-1] + SAME_ANGLE)
    return np.where(outside, np.nan, np.clip(angles, luffing[0], luffing[-1]))


def interpolate_loads(angles: Array, luffing: Array, load: Array, up_to: float, smooth: bool = True) -> Array:
    """Loads (..., l) in kg that l limits allow at luffing angles `angles` (...) in rad; NaN where an angle is NaN.

    They are interpolated between the loads `load` (A, l) in kg at A increasing angles `luffing` (A,) in rad; a single
    angle gives its load everywhere.  The inverse of the load is interpolated, because a moment that a limit allows is
    the load times a radius.  The interpolation is by monotone cubic curves, or by straight lines if not `smooth`.
    `up_to` in kg, the largest load that was tried, sets the small offset that keeps the inverse of a load of 0 finite;
    it is no upper limit.  Between two angles of which one allows no load, no load is allowed, because the angle at
    which the boom is permitted again is not known.
    """
    if len(luffing) == 1:
        return np.where(np.isnan(angles)[..., None], np.nan, load[0])
    offset = 1e-3 * up_to  # keeps the inverse of a load of 0 finite
    inverse = 1.0 / (load + offset)
    if smooth:
        curves = PchipInterpolator(luffing, inverse)(angles)
    else:
        curves = np.stack([np.interp(angles, luffing, values) for values in inverse.T], axis=-1)
    between = 1.0 / curves - offset
    interval = np.clip(np.searchsorted(luffing, angles) - 1, 0, len(luffing) - 2)
    low, high = load[interval], load[interval + 1]
    # no round-off where both ends have the same load, and none at the angles themselves
    between = np.where((low == high) | (np.minimum(low, high) <= 0.0), np.minimum(low, high), between)
    for end, values in ((interval, low), (interval + 1, high)):
        between = np.where(np.isclose(angles, luffing[end], rtol=0.0, atol=SAME_ANGLE)[..., None], values, between)
    return np.where(np.isnan(angles)[..., None], np.nan, between)


def _round_radii(radius: Array) -> Array:
    """Return ascending radii (R,) in m for a table: the least and the greatest `radius`, and round ones between them.

    `radius` (E, A) in m has the radii with E boom lengths at A luffing angles.  All of them are returned, each once, if
    A is 1 or if they are nearly equal.
    """
    low, high = float(radius.min()), float(radius.max())
    if radius.shape[1] == 1 or high - low < 1e-6 * abs(high):
        return np.unique(radius)
    decade = 10.0 ** np.floor(np.log10((high - low) / MOST_RADII))
    step = next(s for s in (decade * STEPS[0], decade * STEPS[1], decade * STEPS[2], 10.0 * decade)
                if (high - low) / s <= MOST_RADII)  # fmt: skip
    between = step * np.arange(np.floor(low / step + 1e-9) + 1.0, np.ceil(high / step - 1e-9))
    return np.concatenate([[low], between, [high]])


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
        """Forces of the wind in N, by the name of that load of the scene along which a force acts."""
        by_load = dict[str, float]()
        for exposed in self.on:
            by_load[exposed.load] = by_load.get(exposed.load, 0.0) + self.pressure * exposed.area * exposed.shape
        return by_load

    @property
    def acting(self) -> dict[str, float]:
        """Forces in N by the name of a load or, without areas, the pressure in Pa by the name of the sections' load."""
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

    def check_loads(self, key: str, forces: Mapping[str, bool]) -> None:
        """Raise InputError if the case names a load that the scene lacks, or wind on an area one that is no force.

        `key` is the key of the case in the study file, for the message.  `forces` says of each load of the scene, by
        name, whether it is a force.
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

    def acting_amounts(self, classes: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
        """Return the case as plain values under the keys ``name``, ``weight``, ``machine``, ``load`` and ``loads``.

        ``weight`` and ``machine`` are the factors on the weights of the boom and of the machine.  ``load`` is the
        factor on the load that is searched for, times the hoisting factor with the hoisting `classes`.  ``loads`` maps
        the names of loads to their values in their own units, such as N.  The wind's forces, or its pressure under
        the name `Wind.section_load`, are among them.
        """
        load, loads = self.load * self.hoisting_factor(classes), self.loads | (self.wind.acting if self.wind else {})
        factors = {"weight": self.weight, "machine": self.machine, "load": load}
        return {"name": self.name, **factors, "loads": loads}


def hoisting_factor(of_class: tuple[float, float], speed: float) -> float:
    r"""Return :math:`\phi_2 = \phi_{2,min} + \beta_2 v`, the dynamic factor of a hoisting class at a speed v in m/s.

    `of_class` has :math:`\phi_{2,min}` and :math:`\beta_2` in s/m; `speed` is v.
    """
    least, slope = of_class
    return least + slope * speed
