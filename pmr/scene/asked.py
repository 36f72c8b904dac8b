"""What is asked: time steps, what is observed, how the model is reduced, who simulates it, what it is compared with."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from pmr.scene.offered import AS_WORD, or_offered
from pmr.scene.section import (
    Count,
    Distance,
    ExistingFile,
    Frequency,
    Length,
    Name,
    Place,
    Positive,
    Pressure,
    Quantity,
    Section,
    Share,
    Switch,
    Time,
)

Pair = Literal["reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf"]
OutputKind = Literal["beam", "tip", "pad_force", "cylinder_force", "velocity", "probe"]
OwnBasis = Literal["free_modes", "eigenmodes", "paper", "file"]
BasisName = Annotated[OwnBasis, or_offered("pmr.bases"), AS_WORD]
SimulatorName = Literal["march", "exudyn", "exudyn-multiplier", "exudyn-callback"]


def _or_ratio(schema: dict[str, Any]) -> None:
    """A ratio at two frequencies may stand in the place of mass and stiffness."""
    hertz = {"type": "number", "exclusiveMinimum": 0.0, "unit": "Hz"}
    about = "Damping ratio at the two frequencies"
    ratio = {"type": "number", "minimum": 0.0, "unit": "1", "description": about, "default": None}
    two = {"type": "array", "items": hertz, "minItems": 2, "maxItems": 2, "default": None}
    schema["properties"] |= {"ratio": ratio, "frequencies": two | {"description": "Where that ratio holds, ascending"}}
    schema["dependencies"] = {"ratio": ["frequencies"], "frequencies": ["ratio"]}
    schema["not"] = {"required": ["ratio"], "anyOf": [{"required": ["mass"]}, {"required": ["stiffness"]}]}


class Damping(Section):
    """Rayleigh damping D = mass M + stiffness K; or given as a `ratio` at two `frequencies` in Hz.

    Less in between, more outside: zeta = (a / omega + b omega) / 2 at both gives a = 2 zeta omega_1 omega_2 /
    (omega_1 + omega_2) and b = 2 zeta / (omega_1 + omega_2).  Bathe: Finite Element Procedures, 1996, section 9.3.3.
    A scene that extends another one may say it in either way: keys of the other way are not taken over.
    """

    model_config = ConfigDict(json_schema_extra=_or_ratio)

    mass: Annotated[float, Field(ge=0.0, strict=True), Quantity("1/s", 0.0, 1e9)] = Field(
        default=0.0, description="Share of the mass matrix M in D"
    )
    stiffness: Annotated[float, Field(ge=0.0, strict=True), Quantity("s", 0.0, 1e6)] = Field(
        default=0.0, description="Share of the stiffness matrix K in D"
    )

    @model_validator(mode="before")
    @classmethod
    def _ratio(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and {"ratio", "frequencies"} & set(data)):
            return data
        try:
            ratio, (first, second) = float(data["ratio"]), map(float, data["frequencies"])
            fits = set(data) == {"ratio", "frequencies"} and ratio >= 0.0 and 0.0 < first < second < math.inf
        except (KeyError, TypeError, ValueError):
            fits = False
        if not fits:
            raise ValueError("ratio with two ascending frequencies in Hz, or mass and stiffness, are allowed")
        one, two = 2.0 * math.pi * first, 2.0 * math.pi * second
        return {"mass": 2.0 * ratio * one * two / (one + two), "stiffness": 2.0 * ratio / (one + two)}


class TimeChoice(Section):
    """Generalized-alpha, index 3, constant step."""

    end: Annotated[float, Field(gt=0.0, strict=True), Quantity("s", 1e-9, 1e9)] = Field(description="Simulated time")
    step: Time = Field(description="Time step")
    rho_inf: Annotated[float, Field(ge=0.0, le=1.0, strict=True), Quantity("1", 0.0, 1.0)] = Field(
        default=0.9, description="Spectral radius at infinite frequency: 1 damps nothing"
    )

    @property
    def steps(self) -> int:
        return round(self.end / self.step)


class Observe(Section):
    """Where the motion is compared and drawn: places along the axis, and a group at the end, whose mean counts.

    Without `start` and `end` the places are a beam's nodes; of more than a thousand every second, third ...
    """

    start: Place | None = Field(default=None, description="First place along the axis")
    end: Place | None = Field(default=None, description="Last place along the axis")
    count: Annotated[int, Field(ge=1, strict=True), Quantity("1", 1, 10_000)] = Field(
        default=29, description="How many places there are from start to end"
    )
    tip: Name = Field(default="tip", description="The group at the end")
    rotation: Switch = Field(default=False, description="Whether the tip's rotation is observed too")
    frequency_response: Switch = Field(
        default=False, description="Whether the tip's response to each load in frequency is found along the path"
    )

    @model_validator(mode="after")
    def _both_ends(self) -> Observe:
        if (self.start is None) != (self.end is None):
            raise ValueError("start and end are allowed together; without them a beam's nodes are observed")
        return self

    @property
    def stations(self) -> tuple[float, ...] | None:
        """Places along the axis, m; None for a beam's nodes."""
        if self.start is None or self.end is None:
            return None
        return tuple(float(x) for x in np.linspace(self.start, self.end, self.count))

    def tip_along(self, direction: str) -> str:
        """What the output of the tip's displacement along y or z is called."""
        return f"{self.tip} {direction}"


class Recovery(Section):
    """Full fields from reduced coordinates: displacement and, if asked for, stress, every so many seconds."""

    every: Time = Field(default=0.02, description="Time between two of them")
    stress: Switch = Field(default=True, description="Whether stresses are asked for")
    frames: Count = Field(default=101, description="Of the fields that are stored, for pictures")
    components: Switch = Field(default=False, description="Whether signed stresses are stored beside von Mises'")
    series: Switch = Field(default=True, description="Whether a series of fields is written that ParaView opens")


class Repeated(Section):
    """A line of a load spectrum."""

    cycles: Positive = Field(description="How often the simulated cycle comes, with this share of its stresses")
    factor: Positive = Field(default=1.0, description="Of all stresses")


class Fatigue(Section):
    """An S-N line, and how often what is simulated is gone through: the damage at each probe that measures stress."""

    slope: Positive = Field(description="m of the line, in logarithms")
    reference: Pressure = Field(description="Range of a stress that is endured 2e6 times")
    cut_off: Pressure | None = Field(default=None, description="Range below which a cycle does no damage")
    cycles: Positive = Field(default=1.0, description="How often the simulated cycle comes")
    spectrum: tuple[Repeated, ...] = Field(default=(), description="In place of `cycles`: with shares of its stresses")

    @model_validator(mode="after")
    def _one_of_both(self) -> Fatigue:
        if self.spectrum and "cycles" in self.model_fields_set:
            raise ValueError("give cycles or spectrum, one of them")
        return self

    @property
    def lines(self) -> tuple[Repeated, ...]:
        """Of the spectrum."""
        return self.spectrum or (Repeated(cycles=self.cycles),)


class Reduction(Section):
    """What the reduced model's `coordinates` multiply.

    `basis`: ``free_modes``, the lowest eigenmodes with all that slides released (free-interface modes);
    ``eigenmodes`` takes `modes` of them with the slider held at each of several `positions`, compressed by POD;
    ``paper`` does the same as Weyrer et al. do, for whom every row of a support costs a coordinate, the weakest of the
    basis (`pmr.reduction.galerkin`); ``file`` reads vectors from a `file`.  Any model can have any of them.

    `flexibility` adds what the basis leaves out, quasi-static, as tables in s: far fewer coordinates do then, 6 being
    the default for free modes, which have it unless the scene says otherwise.

    For free modes with flexibility, `estimate` adds an error estimate that needs no full model but a second simulation
    with four modes more, and attachment modes for the loads of the first one.

    `ports` are places where something is to be hung on the reduced body, in Exudyn say: attachment modes for all forces
    and moments there join the coordinates, which then answer to them exactly at rest.
    """

    basis: BasisName = Field(default="free_modes", description="See above; or one of an installed package")
    file: ExistingFile | None = Field(
        default=None, description="npz file with an array V: a column a vector on the full model's coordinates"
    )
    flexibility: Switch = Field(default=False, description="Residual flexibility; true by default for free modes")
    estimate: Switch = Field(default=True, description="Whether the error is estimated")
    snapshots: Count = Field(default=5, description="Slider positions at which eigenmodes are taken")
    modes: Count = Field(default=6, description="Eigenmodes at each position")
    coordinates: Count = Field(default=20, description="Of the reduced model; 6 for free modes with flexibility")
    positions: Literal["nodes", "path"] | Annotated[tuple[Distance, ...], Field(min_length=1)] = Field(
        default="path", description="Evenly over the path, at a beam's nodes, or as listed"
    )
    ports: tuple[str | Place, ...] = Field(
        default=(), description="Named groups or places along x, for attachment modes"
    )
    solver: Literal["auto", "dense", "slepc"] = Field(default="auto", description="Of eigenproblems")
    product: Literal["euclidean", "mass"] = Field(default="euclidean", description="In which a basis is orthonormal")

    @model_validator(mode="before")
    @classmethod
    def _flexibility_goes_with_free_modes(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("residual_inertia") is False:  # of a scene that a file records
            data = {key: value for key, value in data.items() if key != "residual_inertia"}
        if not isinstance(data, dict) or data.get("basis", "free_modes") != "free_modes":
            return data
        data = {"flexibility": True} | data
        return {"coordinates": 6} | data if data["flexibility"] is True else data

    @property
    def pooled(self) -> bool:
        """Whether the basis is the POD of eigenmodes at several positions."""
        return self.basis in ("eigenmodes", "paper")

    @property
    def given(self) -> bool:
        """Whether its vectors come from outside: from a file, or from a function of an installed package."""
        return self.basis != "free_modes" and not self.pooled

    @property
    def extendable(self) -> bool:
        """Whether modes beyond the coordinates may be kept, whose flexibility is known apart from the rest."""
        return self.basis == "free_modes" and self.flexibility and not self.ports

    @property
    def estimable(self) -> bool:
        """Whether what the modes leave out is kept by its inertia, too, with which the error is estimated."""
        return self.extendable and self.estimate


class Simulation(Section):
    """Who simulates.

    The reduced model goes through every one of `simulators`: the first one's motion is compared and drawn, the others
    say how far they agree with it.  ``march`` is the compiled engine, ``exudyn-callback`` the paper's way.  With
    residual flexibility ``exudyn`` has springs that travel in place of constraints, ``exudyn-multiplier`` constraints.
    The full model goes through one that fits its size; ``petsc``, for large ones, works on all ranks.
    """

    simulators: tuple[SimulatorName, ...] = Field(
        default=("march",), min_length=1, description="Of the reduced model, the first one counts"
    )
    repeats: Count = Field(default=3, description="Of each simulator of the reduced model; seconds are the least")
    full: Literal["auto", "march", "exudyn", "petsc"] = Field(default="auto", description="Of the full model")
    newton: dict[str, bool | int | float] = Field(
        default={}, description="Exudyn's settings of Newton's method by their own names, as relativeTolerance"
    )

    @field_validator("simulators")
    @classmethod
    def _different(cls, simulators: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(simulators)) < len(simulators):
            raise ValueError("each simulator once is allowed")
        return simulators


class Compare(Section):
    """References to compare the reduced model with."""

    against: tuple[Literal["full", "ancf"], ...] = Field(default=("full",), description="Which ones")
    ancf_elements: Count = Field(default=20, description="Of the ANCF cable")
    richer: Literal["none", "next", "beam3d", "shell"] = Field(
        default="none", description="Structural model beside which the error of the scene's own one is measured"
    )
    model_tolerance: Annotated[float, Field(gt=0.0, lt=1.0, strict=True), Quantity("1", 0.0, 1.0)] = Field(
        default=0.05, description="Largest error of the structural model that body.model = 'auto' may choose"
    )


class _Ordered(Section):
    outputs: tuple[OutputKind, ...] = Field(default=("beam", "tip"), min_length=1, description="Where errors count")
    mesh: Switch = Field(default=True, description="Whether the part of the mesh is found out")


class Accuracy(_Ordered):
    """An error that is allowed, instead of coordinates and step, which are chosen to hold it.

    `tolerance` is that of the reduction and the step together, in each of the `outputs`; the search for a step begins
    at `time.step`.  With `mesh` the part of the mesh, found out by a second one with shorter cells, counts, too.
    """

    tolerance: Annotated[float, Field(gt=0.0, lt=1.0, strict=True), Quantity("1", 0.0, 1.0)] = Field(
        description="Allowed error as a fraction"
    )


class Budget(_Ordered):
    """The other way round: what a model may cost, one of three; the best one within it is chosen, and its error said.

    `real_time` is simulated over computed time; both times are those of `march` on the machine in use.  Coordinates
    are those of all bodies together.
    """

    coordinates: Count | None = Field(default=None, description="Most coordinates")
    microseconds_per_step: Annotated[float, Field(gt=0.0, strict=True), Quantity("us", 0.0, 1e9)] | None = Field(
        default=None, description="Longest time of a step"
    )
    real_time: Annotated[float, Field(gt=0.0, strict=True), Quantity("1", 0.0, 1e12)] | None = Field(
        default=None, description="Least multiple of real time"
    )

    @model_validator(mode="after")
    def _one(self) -> Budget:
        if sum(limit is not None for limit in (self.coordinates, self.microseconds_per_step, self.real_time)) != 1:
            raise ValueError("give coordinates, microseconds_per_step or real_time, one of them")
        return self


class PublishedFrequency(Section):
    """The first natural frequency of a boom that reaches so far."""

    reach: Length = Field(description="Of the tip from the base's tail")
    first: Frequency = Field(description="Lowest natural frequency")


class Published(Section):
    """Figures from a publication, shown beside ours."""

    source: str = Field(description="Where they stand")
    errors: dict[Pair, dict[Literal["tip", "beam"], Share]] = Field(default={}, description="As fractions")
    max_displacement: Distance | None = Field(default=None, description="Largest displacement")
    max_error: Distance | None = Field(default=None, description="Largest error")
    frequencies: tuple[PublishedFrequency, ...] = Field(default=(), description="First ones of a boom, at rest")
    remarks: tuple[str, ...] = Field(default=(), description="Where and why our figures differ, for the report")

    @property
    def of_any_motion(self) -> Published | None:
        """What a scene with changed keys may be compared with: frequencies, for errors are those of one motion."""
        left: dict[str, Any] = {"errors": {}, "max_displacement": None, "max_error": None}
        return self.model_copy(update=left) if self.frequencies else None
