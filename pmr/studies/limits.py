r"""Limits of a load chart: what may not be passed, and which share of a limit a load uses.

The share is 1 where the limit is reached, with the limit's own factor :math:`\gamma`: :math:`\gamma |r| / r_{most}`, r
being the run's own quantity (`pmr.results.quantities`) or what a user makes of `AtRest`, and of the others

===========  ===============================================================================
buckling     :math:`\gamma \Lambda_{least} / \Lambda`, all axial forces growing
frequency    :math:`\gamma f_{least} / f`, the load as a mass at the tip
overturning  :math:`\gamma M_{load} / M_{rest}` about each edge of the polygon (`pmr.studies.tipping`)
===========  ===============================================================================
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from pmr.errors import InputError
from pmr.results.quantities import MEASURES, Columns, Measure, fits
from pmr.scene import Scene
from pmr.scene.keys import Hinted, Usual, named
from pmr.scene.mechanism import rope_shares
from pmr.simulation.statics.loaded import Form, States
from pmr.simulation.statics.postures import Postures
from pmr.studies.field_probes import FIELD, WHOLE, bodies_with_field
from pmr.studies.own_limits import Own, amount_of, check_names, expression_of, function_of
from pmr.studies.searches import Share
from pmr.studies.tipping import Mass, Tipping, area
from pmr.system.from_scene import force_names

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0.0)]
#: Whose names can be checked without a model.
NAMED = ("stress", "rope", "pad", "cylinder", "support")
#: Keys of what the user makes of a state.
OWN = ("function", "expression")
LEAST = ("buckling", "frequency")
#: What is usual of `most`, by what it limits.
_STRESS, _FORCE = Usual(1e6, 1e10, unit="Pa"), Usual(0.05, 1e3, "weight", "N")
USUAL_MOST = {
    **dict.fromkeys(("stress", "field"), _STRESS),
    **dict.fromkeys(("pad", "cylinder", "support", "luffing", "rope"), _FORCE),
    "deflection": Usual(1e-5, 1.0, "reach", "m"),
    "pressure": Usual(1e4, 1e10, unit="Pa"),
}
#: The limit that every chart has: beyond it nothing stands.
STABILITY = "stability"


class Limit(Hinted):
    """Limit of a load chart, with its safety factor."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(min_length=1, description="Name of the limit, and of its column")
    of: Literal[
        "stress",
        "pad",
        "cylinder",
        "support",
        "luffing",
        "deflection",
        "buckling",
        "frequency",
        "overturning",
        "rope",
        "function",
        "expression",
        "field",
    ] = Field(description="Quantity that is limited")
    function: str | None = Field(
        default=None, description="Name of a function that an installed package offers as an entry point `pmr.limits`"
    )
    expression: str | None = Field(
        default=None,
        description='Arithmetic over load (kg), luffing, slewing (rad), output["name"] (m, Pa) and force["name"] (N)',
    )
    most: Positive | None = Field(
        default=None,
        description="Largest allowed value: stress in Pa, force in N, deflection in m, or of expression or function",
    )
    least: Positive | None = Field(default=None, description="Smallest allowed value: buckling factor, frequency in Hz")
    factor: Positive = Field(default=1.0, description="Safety factor, of your own choice")
    which: tuple[str, ...] = Field(
        default=("*",),
        description="Names of probes, pads, supports, sections or their regions, with * for any text; by default all",
    )
    area: Annotated[tuple[Positive, Positive], Usual(1e-3, 5.0, unit="m")] | None = Field(
        default=None, description="Length and width of a pad, m; with it `most` is a pressure in Pa"
    )
    polygon: Annotated[tuple[tuple[float, float], ...], Usual(0.0, 3.0, "reach", "m")] = Field(
        default=(), description="Corners X, Y of the support polygon from the pivot, m; its edges are the tipping lines"
    )
    height: Annotated[float, Usual(0.0, 3.0, "reach", "m")] = Field(
        default=0.0, description="Height of the pivot above these corners, m"
    )
    machine: tuple[Mass, ...] = Field(default=(), description="Masses of the machine below the boom")

    @property
    def hint_numbers(self) -> dict[str, tuple[float, Usual]]:
        usual = USUAL_MOST["pressure" if self.area else self.of] if self.of in USUAL_MOST else None
        return {"most": (self.most, usual)} if self.most is not None and usual is not None else {}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needed = "" if self.of == "overturning" else "least" if self.of in LEAST else "most"
        for key in ("most", "least"):
            if (getattr(self, key) is not None) != (key == needed):
                raise ValueError(f"a limit of {self.of} {f'takes {needed}' if needed else 'takes no amount'}: {key}")
        if (self.of == "overturning") != bool(self.polygon or self.machine):
            raise ValueError("polygon and machine belong to a limit of overturning, which needs both")
        if self.of == "overturning" and (len(self.polygon) < 3 or not self.machine or not area(self.polygon)):
            raise ValueError("overturning needs a polygon with an area, and masses of the machine")
        if self.area is not None and self.of != "pad":
            raise ValueError("area belongs to a limit of pads")
        for key in OWN:
            if (getattr(self, key) is not None) != (self.of == key):
                raise ValueError(f"{key} belongs to a limit of {key!r}, which needs one")
        if self.expression is not None:
            expression_of(self.expression)
        return self

    def share(self, at: Postures, k: int, amounts: Sequence[float]) -> Share:
        """Function of states at the k-th place that returns the used share of the limit, parts acting by `amounts`.

        An InputError is raised where it looks at nothing.
        """
        least = self.factor * float(self.least or 0.0)
        if self.of == "buckling":
            return lambda states: least * np.array([form.inverse_factor(load) for form, load in _each(states)])
        if self.of == "frequency":
            return lambda states: np.array([_ratio(least, form.frequency(load)) for form, load in _each(states)])
        if self.of == "overturning":
            tipping = self.tipping(at, k, amounts)
            return lambda states: tipping.share(states, self.factor)
        allowed = float(self.most or 0.0) * float(np.prod(self.area or (1.0,)))
        if self.of in OWN:
            amount = amount_of(self._own(), f"limits.{self.name}.{self.of}", getattr(self, self.of), at, k)
            return lambda states: self.factor / allowed * np.abs(amount(states))
        if self.of == "luffing" and not at.arm[k] > 0.0:
            reason = f"at {np.rad2deg(at.luffing[k]):.4g} degrees the cylinder has an arm of {at.arm[k]:.2g} m"
            raise InputError("study", "luffing", None, f"angles at which it raises the boom are allowed: {reason}")
        measure = self.measure(at.columns)
        return lambda states: self.factor / allowed * measure(np.hstack([states.outputs, states.forces]))

    def measure(self, columns: Columns) -> Measure:
        """The amount of which `most` is allowed, from values of these columns; an InputError is raised without any."""
        measure = MEASURES[self.of](columns, self.looks_at)
        if measure is None:
            probes = [probe for probe in columns.stresses() if FIELD not in probe] if self.of == "stress" else []
            raise self._unknown_name(probes)
        return measure

    def directly(self, form: Form, near: float, up_to: float) -> float | None:
        """The load in kg that it allows as long as no contact opens; None for a limit that is no eigenvalue.

        It may be known to be `near` a load, and is not needed above the largest.
        """
        if self.of == "buckling":
            return form.load_of_factor(self.factor * float(self.least or 0.0), near, up_to)
        if self.of == "frequency":
            return form.load_of_frequency(self.factor * float(self.least or 0.0), near, up_to)
        return None

    def tipping(self, at: Postures, k: int, amounts: Sequence[float]) -> Tipping:
        """Moments about the edges of a limit of overturning."""
        return Tipping.of(self.polygon, self.height, self.machine, at, k, np.asarray(amounts))

    @property
    def grows(self) -> bool:
        """Whether what it uses grows with the load alone."""
        return self.of in ("buckling", "frequency", "overturning")

    def check(self, scene: Scene) -> None:
        """An InputError is raised where a name that it looks at is none of the scene's; that takes no model."""
        if self.of == "luffing" and (scene.frame is None or scene.frame.cylinder is None):
            allowed = "a scene with frame.cylinder is allowed, which says where its hinges are"
            raise InputError("study", f"limits.{self.name}.of", self.of, allowed)
        if self.of == "function":
            function_of(self.name, self.function)
        if self.expression is not None:
            check_names(self.name, self.expression, scene)
        if self.of == "field" and not (names := bodies_with_field(scene)):
            raise self._unknown_name(names)
        if self.of not in NAMED:
            return
        names = [
            named(body, probe.name)
            for body, part in scene.bodies.items()
            for probe in part.probes
            if "stress" in probe.measures
        ]
        if self.of == "rope":
            names = list(rope_shares(scene))
        elif self.of != "stress":
            names = list(force_names(scene)[self.of])
        if not all(any(fits((pattern,), name) for name in names) for pattern in self.which):
            raise self._unknown_name(names)

    def _own(self) -> Own:
        """Function or expression of the user that evaluates a state."""
        return function_of(self.name, self.function) if self.of == "function" else expression_of(self.expression or "")

    def looks_at(self, name: str) -> bool:
        """Return whether the limit depends on a column, a probe or a point of the field, by its name."""
        if self.of not in ("stress", "field"):
            return fits(self.which, name)
        body, separator, suffix = name.rpartition(FIELD)
        if self.of == "stress":
            return not separator and fits(self.which, name)
        body, region = body.removesuffix(": "), suffix.rpartition(" ")[0]
        return bool(separator) and (fits(self.which, body or WHOLE) or fits(self.which, named(body, region)))

    def _unknown_name(self, names: Sequence[str]) -> InputError:
        allowed = f"names among {', '.join(names)} are allowed" if names else f"the scene has no {self.of} to look at"
        return InputError("study", f"limits.{self.name}.which", ", ".join(self.which), allowed)


def _each(states: States) -> Iterator[tuple[Form, float]]:
    return zip(states.forms, states.load.tolist(), strict=True)


def _ratio(part: float, total: float) -> float:
    """Ratio of a part to the total; infinite where the total is not positive."""
    if total <= 0.0:
        return np.inf
    return part / total
