r"""Limits of a load chart: what may not be passed, and which share of a limit a load uses.

The share is 1 where the limit is reached, with the limit's own factor :math:`\gamma`:

========================================  ==================================================================
stress, pad, cylinder, support, deflection :math:`\gamma |r| / r_{most}` of the largest of what it looks at
buckling                                  :math:`\gamma \Lambda_{least} / \Lambda`, all axial forces growing
frequency                                 :math:`\gamma f_{least} / f`, the load as a mass that hangs at the tip
overturning                               :math:`\gamma M_{load} / M_{rest}` about each edge of the polygon
luffing                                   :math:`\gamma |M / a| / F_{most}`, moment about the pivot over the arm of
                                          `frame.cylinder`, the load at the deflected tip
function                                  :math:`\gamma |r| / r_{most}` of what a user's function makes of `AtRest`
========================================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pmr.errors import InputError, plugins
from pmr.scene import Scene
from pmr.scene.names import named
from pmr.simulation.postures import HOOK, WEIGHT, Postures
from pmr.system.from_scene import force_names
from pmr.system.loaded import Form, State

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0.0)]
#: What outputs and which contacts a limit of each kind looks at.
OUTPUTS = {"stress": "probe", "deflection": "tip", "support": "support"}
CONTACTS = {"pad": "pad", "cylinder": "cylinder", "support": "support"}
NAMED = ("stress", *CONTACTS)
LEAST = ("buckling", "frequency")
#: The limit that every chart has: beyond it nothing stands.
STABILITY = "stability"
#: Von Mises' stress squared by the components that models have.
MISES = {
    ("axial",): np.eye(1),
    ("axial", "torsion"): np.diag([1.0, 3.0]),
    ("along", "across", "shear"): np.array([[1.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 3.0]]),
    ("xx", "yy", "zz", "yz", "xz", "xy"): np.block(
        [[1.5 * np.eye(3) - 0.5, np.zeros((3, 3))], [np.zeros((3, 3)), 3.0 * np.eye(3)]]
    ),
}


@dataclass(frozen=True)
class AtRest:
    """The boom in equilibrium under a load: what a function of the entry points `pmr.limits` is given."""

    load: float  # kg
    luffing: float  # rad
    slewing: float  # rad
    outputs: Mapping[str, float]  # m or Pa by name: the tip along the boom's axes, stresses at probes
    forces: Mapping[str, float]  # N or N m of pads and cylinders by name, positive where they push


class Mass(BaseModel):
    """A part of the machine below the boom."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(description="For people")
    mass: Positive = Field(description="kg")
    at: tuple[float, float, float] = Field(
        description="Its centre from the pivot, m: X where the boom points unslewed, Y to its left, Z up"
    )
    slews: bool = Field(default=False, description="Whether it turns with the boom, as a counterweight does")


class Limit(BaseModel):
    """What may not be passed, and by which factor."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(min_length=1, description="What its column is called")
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
        "function",
    ] = Field(description="What is limited")
    function: str | None = Field(
        default=None, description="Name of a function that an installed package offers as an entry point `pmr.limits`"
    )
    most: Positive | None = Field(
        default=None,
        description="Largest amount: von Mises stress in Pa, force in N, deflection in m, or what the function returns",
    )
    least: Positive | None = Field(default=None, description="Smallest amount: buckling factor, frequency in Hz")
    factor: Positive = Field(default=1.0, description="Of safety, of the user's own choice")
    which: tuple[str, ...] = Field(
        default=("*",), description="Names of probes, pads, cylinders or supports, with * for any text; by default all"
    )
    area: tuple[Positive, Positive] | None = Field(
        default=None, description="Length and width of a pad, m: then `most` is a pressure in Pa"
    )
    polygon: tuple[tuple[float, float], ...] = Field(
        default=(), description="Corners X, Y between which the machine stands, from the pivot, m: its tipping lines"
    )
    height: float = Field(default=0.0, description="Of the pivot above these, m")
    machine: tuple[Mass, ...] = Field(default=(), description="Masses of the machine that keep it standing")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needed = "" if self.of == "overturning" else "least" if self.of in LEAST else "most"
        for key in ("most", "least"):
            if (getattr(self, key) is not None) != (key == needed):
                raise ValueError(f"a limit of {self.of} {f'takes {needed}' if needed else 'takes no amount'}: {key}")
        if (self.of == "overturning") != bool(self.polygon or self.machine):
            raise ValueError("polygon and machine belong to a limit of overturning, which needs both")
        if self.of == "overturning" and (len(self.polygon) < 3 or not self.machine or not _area(self.polygon)):
            raise ValueError("overturning needs a polygon with an area, and masses of the machine")
        if self.area is not None and self.of != "pad":
            raise ValueError("area belongs to a limit of pads")
        if (self.function is not None) != (self.of == "function"):
            raise ValueError("function belongs to a limit of 'function', which needs one")
        return self

    def share(self, at: Postures, k: int, amounts: Sequence[float], gravity: float) -> Callable[[State], float]:
        """Of the limit that a state at the k-th place uses, where parts act by `amounts`, the load's factor among them.

        An InputError is raised where it looks at nothing.
        """
        if self.of == "buckling":
            return lambda state: self.factor * float(self.least or 0.0) * state.form.inverse_factor(state.load)
        if self.of == "frequency":
            return lambda state: _ratio(self.factor * float(self.least or 0.0), state.form.frequency(state.load))
        if self.of == "overturning":
            held, tips = self._moments(at, k, np.asarray(amounts), gravity)
            return lambda state: max(
                _ratio(self.factor * state.load * b, a) for a, b in zip(held.tolist(), tips.tolist(), strict=True)
            )
        allowed = float(self.most or 0.0) * float(np.prod(self.area or (1.0,))) / self.factor
        if self.of == "stress":
            groups = self._stresses(at)
            return lambda state: max(_mises(state.outputs[i], form) for i, form in groups) / allowed
        if self.of == "luffing":
            pressed = self._luffing(at, k, np.asarray(amounts))
            return lambda state: abs(pressed(state)) / allowed
        if self.of == "function":
            amount = self._own(at, k)
            return lambda state: abs(amount(state)) / allowed
        outputs, contacts = self._looked_at(at)
        if self.of == "deflection":
            return lambda state: float(np.linalg.norm(state.outputs[outputs])) / allowed
        return lambda state: (
            float(max(np.abs(state.outputs[outputs]).max(initial=0.0), np.abs(state.forces[contacts]).max(initial=0.0)))
            / allowed
        )

    def directly(self, form: Form) -> float | None:
        """The load in kg that it allows as long as no contact opens; None for a limit that is no eigenvalue."""
        if self.of == "buckling":
            return form.load_of_factor(self.factor * float(self.least or 0.0))
        if self.of == "frequency":
            return form.load_of_frequency(self.factor * float(self.least or 0.0))
        return None

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
            self._function()
        if self.of not in NAMED:
            return
        known = [
            named(body, probe.name)
            for body, part in scene.bodies.items()
            for probe in part.probes
            if "stress" in probe.measures
        ]
        known = known if self.of == "stress" else list(force_names(scene)[self.of])
        if not all(any(fnmatchcase(name, pattern) for name in known) for pattern in self.which):
            raise self._nothing(known)

    def _function(self) -> Callable[[AtRest], float]:
        offered = plugins.offered("pmr.limits", frozenset())
        found: Any = offered.get(self.function or "")
        if found is None:
            known = f"one of {', '.join(sorted(offered))}" if offered else "none: no package offers any"
            raise InputError("study", f"limits.{self.name}.function", self.function, f"{known} is allowed")
        if not callable(found):
            raise plugins.refused("pmr.limits", self.function or "")
        return cast(Callable[[AtRest], float], found)

    def _own(self, at: Postures, k: int) -> Callable[[State], float]:
        """What the user's function makes of states; anything but a number is refused."""
        function, luffing, slewing = self._function(), float(at.luffing[k]), float(at.slewing[k])

        def amount(state: State) -> float:
            outputs = dict(zip(at.output_names, state.outputs.tolist(), strict=True))
            forces = dict(zip(at.force_names, state.forces.tolist(), strict=True))
            try:
                found = float(function(AtRest(state.load, luffing, slewing, outputs, forces)))
            except (ArithmeticError, KeyError, TypeError, ValueError) as error:
                raise InputError(
                    "study", f"limits.{self.name}.function", self.function, f"it failed: {error!r}"
                ) from None
            if np.isnan(found):
                raise InputError("study", f"limits.{self.name}.function", self.function, "it returned no number")
            return found

        return amount

    def _looked_at(self, at: Postures) -> tuple[list[int], list[int]]:
        """Numbers of outputs and of contacts."""
        outputs, contacts = (
            [k for k, (kind, name) in enumerate(zip(kinds, names, strict=True)) if kind == wanted and self._means(name)]
            for kinds, names, wanted in (
                (at.output_kinds, at.output_names, OUTPUTS.get(self.of)),
                (at.force_kinds, at.force_names, CONTACTS.get(self.of)),
            )
        )
        if not outputs and not contacts:
            known = [
                n for kind, n in zip(at.output_kinds, at.output_names, strict=True) if kind == OUTPUTS.get(self.of)
            ]
            known += [
                n for kind, n in zip(at.force_kinds, at.force_names, strict=True) if kind == CONTACTS.get(self.of)
            ]
            raise self._nothing(known)
        return outputs, contacts

    def _stresses(self, at: Postures) -> list[tuple[list[int], Array]]:
        """Numbers of the components at each probe, and what von Mises' stress squared is of them."""
        probes = dict[str, dict[str, int]]()
        for k, name in enumerate(at.output_names):
            probe, known, component = name.rpartition(" stress ")
            if at.output_kinds[k] == "probe" and known:
                probes.setdefault(probe, {})[component] = k
        found = [(list(one.values()), MISES[tuple(one)]) for probe, one in probes.items() if self._means(probe)]
        if not found:
            raise self._nothing(list(probes))
        return found

    def _means(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.which)

    def _nothing(self, known: Sequence[str]) -> InputError:
        allowed = f"names among {', '.join(known)} are allowed" if known else f"the scene has no {self.of} to look at"
        return InputError("study", f"limits.{self.name}.which", ", ".join(self.which), allowed)

    def _luffing(self, at: Postures, k: int, amounts: Array) -> Callable[[State], float]:
        """Force in N of the cylinder that raises the boom, positive where it presses."""
        c, s = np.cos(at.slewing[k]), np.sin(at.slewing[k])
        about = at.wrenches[:, k, 4] * c - at.wrenches[:, k, 3] * s  # of each part, along the axis of luffing
        load = np.array([name == HOOK for name in at.parts])
        rest, hook = float(~load * amounts @ about), float(load * amounts @ about)
        weight = -float(load * amounts @ at.wrenches[:, k, 2])  # of a kg of the load
        if not at.arm[k] > 0.0:
            found = f"at {np.rad2deg(at.luffing[k]):.4g} degrees the cylinder has an arm of {at.arm[k]:.2g} m"
            raise InputError("study", "luffing", None, f"angles at which it raises the boom are allowed: {found}")
        z = next(n for n, kind in enumerate(at.output_kinds) if kind == "tip" and at.output_names[n].endswith("tip z"))

        def pressed(state: State) -> float:
            outwards = -state.outputs[z] * np.sin(at.luffing[k])
            return float((rest + state.load * (hook + weight * outwards)) / at.arm[k])

        return pressed

    def _moments(self, at: Postures, k: int, amounts: Array, gravity: float) -> tuple[Array, Array]:
        """What keeps the machine from tipping over each edge, N m, and what a kg of the load adds to tipping, N m."""
        corners = np.array([(*one, -self.height) for one in self.polygon], float)
        if _area(self.polygon) < 0.0:
            corners = corners[::-1]
        edges = np.roll(corners, -1, axis=0) - corners
        edges /= np.linalg.norm(edges, axis=1)[:, None]
        force, moment = at.wrenches[:, k, :3], at.wrenches[:, k, 3:]
        load = np.array([name == HOOK for name in at.parts])
        resting, hook = ((share * amounts) @ np.hstack([force, moment]) for share in (~load, load))
        weight = np.zeros(6)
        for one in self.machine:
            c, s = (np.cos(at.slewing[k]), np.sin(at.slewing[k])) if one.slews else (1.0, 0.0)
            x, y = c * one.at[0] - s * one.at[1], s * one.at[0] + c * one.at[1]
            pull = -one.mass * amounts[at.parts.index(WEIGHT)] * gravity
            weight += np.array([0.0, 0.0, pull, y * pull, -x * pull, 0.0])
        wrenches = np.stack([resting + weight, hook])[:, None]
        moments = wrenches[..., 3:] - np.cross(corners, wrenches[..., :3])
        held, tips = np.einsum("ei,wei->we", edges, moments)
        return -held, tips


def _area(polygon: Sequence[tuple[float, float]]) -> float:
    """Twice the signed area, positive where the corners go round anticlockwise."""
    x, y = np.array(polygon, float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _mises(components: Array, form: Array) -> float:
    return float(np.sqrt(np.maximum(components @ form @ components, 0.0)))


def _ratio(part: float, whole: float) -> float:
    """Of what is used; infinite where nothing is there to be used."""
    if whole <= 0.0:
        return np.inf
    return part / whole
