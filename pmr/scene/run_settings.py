"""Tables of a scene for a run: time steps, observed outputs, reduction, simulators, and comparison."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pmr.scene.keys import (
    AS_WORD,
    Count,
    Distance,
    ExistingFile,
    Frequency,
    Length,
    Name,
    Once,
    Place,
    Positive,
    Pressure,
    Quantity,
    SceneTable,
    Share,
    Switch,
    Time,
    Usual,
    or_plugin_name,
)

Pair = Literal["reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf"]
OutputKind = Literal["beam", "tip", "pad_force", "cylinder_force", "velocity", "probe"]
OwnBasis = Literal["free_modes", "eigenmodes", "paper", "file"]
BasisName = Annotated[OwnBasis, or_plugin_name("pmr.bases"), AS_WORD]
SimulatorName = Literal["march", "exudyn", "exudyn-multiplier", "exudyn-callback"]


class TimeChoice(SceneTable):
    """Simulated time and steps of the generalized-alpha method (index 3, constant step)."""

    end: Annotated[float, Quantity("s", 1e-9, 1e9), Usual(1e-4, 4e3)] = Field(description="Simulated time")
    step: Annotated[Time, Usual(1e-9, 0.5)] = Field(description="Time step")
    rho_inf: Annotated[float, Field(ge=0.0, le=1.0), Quantity("1", 0.0, 1.0)] = Field(
        default=0.9,
        description="Spectral radius of generalized-alpha at infinite frequency: 1 has no numerical damping, so that "
        "errors in forces on parts with little mass do not decay. `pmr run` warns of them, `pmr.simulate` does not",
    )

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return round(self.end / self.step)


class Observe(SceneTable):
    """Positions along the axis at which the motion is compared and drawn, and the tip: the mean of a group at the end.

    Without `start` and `end` the positions are a beam's nodes.  If a beam has more than a thousand nodes, every second,
    third and so on is taken.
    """

    start: Place | None = Field(default=None, description="First place along the axis")
    end: Place | None = Field(default=None, description="Last place along the axis")
    count: Annotated[int, Quantity("1", 1, 10_000)] = Field(
        default=29, description="Number of places, evenly spaced from start to end"
    )
    tip: Name = Field(
        default="tip", description="Group at the end of the boom whose mean motion is reported as the tip"
    )
    rotation: Switch = Field(default=False, description="Whether the tip's rotation is recorded too, in rad")
    frequency_response: Switch = Field(
        default=False, description="Whether the frequency response of the tip to each load is computed along the path"
    )

    @model_validator(mode="after")
    def _check_ends(self) -> Observe:
        """Refuse an observed range with only one of its ends."""
        if (self.start is None) != (self.end is None):
            raise ValueError("start and end are allowed together; without them a beam's nodes are observed")
        return self

    @property
    def stations(self) -> tuple[float, ...] | None:
        """Observed positions along the axis in m, from `start` to `end`; None if the scene does not set these."""
        if self.start is None or self.end is None:
            return None
        return tuple(float(x) for x in np.linspace(self.start, self.end, self.count))

    @property
    def rotations(self) -> tuple[str, ...]:
        """Directions about which the tip's rotation is an output, such as ``ry``."""
        return ("ry",) if self.rotation else ()

    def tip_along(self, direction: str) -> str:
        """Return the name of the tip's output in a `direction`: displacement along y or z, or the rotation ry."""
        return f"{self.tip} {direction}"


class Recovery(SceneTable):
    """Fields of displacement and stress on the whole mesh, computed from the reduced coordinates at some times."""

    every: Time = Field(default=0.02, description="Time between two fields")
    stress: Switch = Field(default=True, description="Whether stresses are computed too")
    frames: Count = Field(default=101, description="Number of fields that are stored, for pictures")
    components: Switch = Field(
        default=False, description="Whether the stress components are stored beside the von Mises stress"
    )
    series: Switch = Field(default=True, description="Whether the fields are written as a series for ParaView")


class SpectrumLine(SceneTable):
    """A line of a load spectrum: a number of cycles with one factor on the stresses."""

    cycles: Positive = Field(description="How often the simulated cycle occurs with its stresses times `factor`")
    factor: Positive = Field(default=1.0, description="Factor on all stresses")


class Fatigue(SceneTable):
    """Fatigue damage at each probe that measures stress, from an S-N line and the number of simulated cycles."""

    slope: Annotated[Positive, Usual(2.0, 30.0)] = Field(
        description="Exponent m of the S-N line, N proportional to range^-m"
    )
    reference: Annotated[Pressure, Usual(2e5, 1e10)] = Field(description="Stress range that is endured 2e6 times")
    cut_off: Annotated[Pressure, Usual(2e5, 1e10)] | None = Field(
        default=None, description="Stress range below which a cycle does no damage"
    )
    cycles: Positive = Field(default=1.0, description="How often the simulated cycle occurs")
    spectrum: tuple[SpectrumLine, ...] = Field(
        default=(),
        description="Load spectrum, in place of `cycles`: a number of cycles for each factor on the stresses",
    )

    @model_validator(mode="after")
    def _check_cycles(self) -> Fatigue:
        """Refuse a number of cycles together with a spectrum."""
        if self.spectrum and self.cycles != 1.0:
            raise ValueError("give cycles or spectrum, one of them")
        return self


class BasisChoice(SceneTable):
    """Which vectors the coordinates multiply, and whether the flexibility that they leave out is added."""

    basis: BasisName = Field(
        default="free_modes",
        description="Which vectors the coordinates multiply (see above), or the name of one that an installed "
        "package adds",
    )
    file: ExistingFile | None = Field(
        default=None, description="npz file with an array V, whose columns are vectors on the full model's coordinates"
    )
    flexibility: Switch = Field(
        default=False, description="Whether residual flexibility is added; true by default for free modes"
    )
    estimate: Switch = Field(default=True, description="Whether the error of the reduction is estimated")


class Reduction(BasisChoice):
    """The basis of the reduced model and the number of its `coordinates`.

    `basis` ``free_modes`` takes the lowest eigenmodes without sliders and moving pads (free-interface modes).
    ``eigenmodes`` takes `modes` eigenmodes with the slider held at each of several `positions`, and compresses them by
    POD.  ``paper`` is the method of the paper by Weyrer et al.: it is like ``eigenmodes``, but each row of a support
    removes a coordinate, the weakest of the basis (`pmr.reduction.basis`).  ``file`` reads vectors from a `file`.  Each
    basis is possible with every structural model.

    `flexibility` adds the static flexibility of the modes that the basis leaves out, as tables in the path coordinate
    s.  Far fewer coordinates are then enough.  For free modes it is on by default, with 6 coordinates.

    `estimate` computes the error of free modes with flexibility.  It needs no full model; it simulates a second time,
    with four modes more and with attachment modes for the loads of the first simulation.

    `ports` are places to which other bodies will be attached, in Exudyn for example.  Attachment modes for all forces
    and moments there join the coordinates, so that the static answer to these forces is exact.
    """

    snapshots: Count = Field(default=5, description="Slider positions at which eigenmodes are taken")
    modes: Count = Field(default=6, description="Eigenmodes at each position")
    coordinates: Count = Field(
        default=20, description="Number of coordinates of the reduced model; 6 for free modes with flexibility"
    )
    positions: Literal["nodes", "path"] | Annotated[tuple[Distance, ...], Field(min_length=1)] = Field(
        default="path", description="Slider positions: evenly over the path, at a beam's nodes, or as listed"
    )
    ports: tuple[str | Place, ...] = Field(
        default=(), description="Named groups or places along x that get attachment modes"
    )
    solver: Literal["auto", "dense", "slepc"] = Field(default="auto", description="Solver of eigenvalue problems")
    product: Literal["euclidean", "mass"] = Field(
        default="euclidean", description="Inner product in which the basis is orthonormal"
    )

    @model_validator(mode="before")
    @classmethod
    def _fill_in_flexibility(cls, data: object) -> object:
        """Fill in the defaults of free modes: flexibility, and 6 coordinates if there is flexibility."""
        if not isinstance(data, dict) or data.get("basis", "free_modes") != "free_modes":
            return data
        data = {"flexibility": True} | data
        return {"coordinates": 6} | data if data["flexibility"] is True else data

    @property
    def uses_pod(self) -> bool:
        """Whether the basis is the POD of eigenmodes at several positions."""
        return self.basis in ("eigenmodes", "paper")

    @property
    def is_external(self) -> bool:
        """Whether the basis comes from a file or from a function of an installed package."""
        return self.basis != "free_modes" and not self.uses_pod

    @property
    def extendable(self) -> bool:
        """Whether modes beyond the coordinates (enrichment modes) can be stored with the model.

        This needs free modes with flexibility and without ports.
        """
        return self.basis == "free_modes" and self.flexibility and not self.ports

    @property
    def estimable(self) -> bool:
        """Whether enrichment modes and the inertia of all further modes are stored, for an estimate of the error."""
        return self.extendable and self.estimate


class Simulation(SceneTable):
    """Programs that simulate the models.

    Each of `simulators` simulates the reduced model.  The results are those of the first simulator; for each other one
    the difference from these results is reported.  ``march`` is pmr's own compiled integrator, and ``exudyn-callback``
    is the method of the paper by Weyrer et al.  With residual flexibility ``exudyn`` uses springs that travel, and
    ``exudyn-multiplier`` uses constraints.

    `full` simulates the full model; by default it is chosen by size.  ``petsc``, for large models, uses all MPI ranks.
    """

    simulators: Annotated[tuple[SimulatorName, ...], Once] = Field(
        default=("march",),
        min_length=1,
        description="Simulators of the reduced model; the results are those of the first one",
    )
    repeats: Count = Field(
        default=3, description="Runs of each simulator of the reduced model; the shortest time is reported"
    )
    full: Literal["auto", "march", "exudyn", "petsc"] = Field(default="auto", description="Simulator of the full model")
    newton: dict[str, bool | int | float] = Field(
        default={}, description="Exudyn's settings of Newton's method, by Exudyn's names, such as relativeTolerance"
    )


class Compare(SceneTable):
    """References to compare the reduced model with."""

    against: tuple[Literal["full", "ancf"], ...] = Field(
        default=("full",), description="Models that the reduced one is compared with"
    )
    ancf_elements: Count = Field(default=20, description="Number of elements of the ANCF cable")
    richer: Literal["auto", "none", "next", "beam3d", "shell"] = Field(
        default="auto",
        description="Richer structural model with which the error of the scene's own one is measured; 'auto': by "
        "`pmr run` beside a shell that takes little time",
    )
    model_tolerance: Annotated[float, Field(lt=1.0), Quantity("1", 1e-12, 1.0)] = Field(
        default=0.05,
        description="Allowed error of the structural model, by which body.model = 'auto' chooses; a run warns where "
        "its model or mesh is further off",
    )
    play: Annotated[Distance, Usual(0.0, 0.02)] = Field(
        default=1e-3,
        description="Play of pads from face to face with which `pmr run` simulates a scene once more whose pads only "
        "push and have no clearance, and which error bars of a load chart contain; 0: not",
    )


class _Target(SceneTable):
    """Base of `Accuracy` and `Budget`, with the outputs that have to be accurate."""

    outputs: Annotated[tuple[OutputKind, ...], Once] = Field(
        default=("beam", "tip"), min_length=1, description="Outputs whose errors have to be small enough"
    )
    mesh: Switch = Field(
        default=True, description="Whether the error of the mesh is included, estimated with a second mesh"
    )


class Accuracy(_Target):
    """An allowed error; the number of coordinates and the time step are chosen so that the error is not exceeded.

    `tolerance` is the allowed error of reduction and step together, in each of the `outputs`.  With `mesh` the error of
    the mesh is included; a second mesh measures it.  The search for a step begins at `time.step`.
    """

    tolerance: Annotated[float, Field(lt=1.0), Quantity("1", 1e-12, 1.0), Usual(0.0, 0.3)] = Field(
        description="Allowed error as a fraction"
    )


class Budget(_Target):
    """The allowed cost of the reduced model, by one of three keys; the best model within it is chosen, with its error.

    `coordinates` counts the coordinates of all bodies together.  `microseconds_per_step` and `real_time` (simulated
    over computing time) are measured with `march` on the machine in use.
    """

    coordinates: Count | None = Field(default=None, description="Largest number of coordinates")
    microseconds_per_step: Annotated[float, Quantity("us", 1e-12, 1e9)] | None = Field(
        default=None, description="Longest computing time of a step"
    )
    real_time: Annotated[float, Quantity("1", 1e-12, 1e12)] | None = Field(
        default=None, description="Smallest ratio of simulated to computing time"
    )

    @model_validator(mode="after")
    def _check_one_limit(self) -> Budget:
        """Refuse a budget unless exactly one limit is set."""
        if sum(limit is not None for limit in (self.coordinates, self.microseconds_per_step, self.real_time)) != 1:
            raise ValueError("give coordinates, microseconds_per_step or real_time, one of them")
        return self


class PublishedFrequency(SceneTable):
    """Published first natural frequency of a boom at one reach."""

    reach: Length = Field(description="Distance of the tip from the base's tail")
    first: Frequency = Field(description="Lowest natural frequency")


class Published(SceneTable):
    """Results from a publication, shown next to the results of pmr."""

    source: str = Field(description="The publication")
    errors: dict[Pair, dict[Literal["tip", "beam"], Share]] = Field(
        default={}, description="Published errors, as fractions"
    )
    max_displacement: Distance | None = Field(default=None, description="Published largest displacement")
    max_error: Distance | None = Field(default=None, description="Published largest error")
    frequencies: tuple[PublishedFrequency, ...] = Field(
        default=(), description="Published first natural frequencies of a boom at rest"
    )
    remarks: tuple[str, ...] = Field(default=(), description="Where and why our figures differ, for the report")
