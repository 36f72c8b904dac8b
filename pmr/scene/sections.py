"""The sections of a scene: each knows what it allows by itself."""

from __future__ import annotations

import hashlib
import json
import math
from abc import abstractmethod
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from pmr.scene.signals import Constant, Real, Signal, SignalBase, bounds
from pmr.scene.tomlfiles import is_file

Positive = Annotated[float, Field(gt=0.0, strict=True)]
NotNegative = Annotated[float, Field(ge=0.0, strict=True)]
Pair = Literal["reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf"]
OutputKind = Literal["beam", "tip", "pad_force", "velocity"]
Count = Annotated[int, Field(ge=1, strict=True)]
SUPPORT_ROWS = {"pinned": ("x", "y"), "clamped": ("x", "y", "rotation"), "roller": ("y",)}


def _exists(file: Path) -> Path:
    if not is_file(file):
        raise ValueError(f"no such file: {file}")
    try:
        with file.open("rb") as stream:
            stream.read(1)  # a file may open and still not be read
    except OSError as error:
        raise ValueError(f"can't be read: {error.strerror}") from None
    return file


ExistingFile = Annotated[Path, AfterValidator(_exists)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Body(_Section):
    """Planar Euler-Bernoulli beam along x, from 0 to `length`."""

    model: Literal["beam2d"] = "beam2d"
    length: Positive  # m
    bending_stiffness: Positive  # EI, N m^2
    mass_per_length: Positive  # rho A, kg/m
    axial_stiffness: Positive | None = None  # EA, N
    axial: bool = False  # axial coordinates only where the scene asks for them

    @model_validator(mode="after")
    def _axial_needs_stiffness(self) -> Body:
        if self.axial and self.axial_stiffness is None:
            raise ValueError("axial = true needs axial_stiffness in N")
        return self

    @property
    def directions(self) -> tuple[str, ...]:
        """Nodal coordinates, in order."""
        return ("x", "y", "rotation") if self.axial else ("y", "rotation")


class MeshChoice(_Section):
    """Elements of equal length, graded, or read from a file (anything meshio reads).

    A file, where given, goes first, so that a scene may replace the elements of the one it extends.
    """

    elements: Count | None = None
    grading: float = Field(default=1.0, ge=1e-3, le=1e3, strict=True)  # last element's length over the first's
    file: ExistingFile | None = None

    @model_validator(mode="after")
    def _one_source(self) -> MeshChoice:
        if self.elements is None and self.file is None:
            raise ValueError("give elements or file")
        return self


class Support(_Section):
    """A fixed point: pinned (x, y), clamped (x, y, rotation) or roller (y)."""

    at: NotNegative  # m
    kind: Literal["pinned", "clamped", "roller"] = "pinned"


class Slider(_Section):
    """One path s(t) and the sliders that travel with it, each at s + offset."""

    path: Signal  # m
    offsets: tuple[Real, ...] = Field(default=(0.0,), min_length=1)  # m


class Load(_Section):
    """A force in N along `direction` (a moment in N m for rotation) at the beam coordinate `at`."""

    name: str = "F"
    at: NotNegative  # m
    direction: Literal["x", "y", "rotation"] = "y"
    signal: Signal


class Damping(_Section):
    """Rayleigh damping D = mass M + stiffness K; or given as a `ratio` at two `frequencies` in Hz.

    Less in between, more outside: zeta = (a / omega + b omega) / 2 at both gives a = 2 zeta omega_1 omega_2 /
    (omega_1 + omega_2) and b = 2 zeta / (omega_1 + omega_2).  Bathe: Finite Element Procedures, 1996, section 9.3.3.
    A scene that extends another one may say it in either way: keys of the other way are not taken over.
    """

    mass: NotNegative = 0.0  # 1/s
    stiffness: NotNegative = 0.0  # s

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


class TimeChoice(_Section):
    """Generalized-alpha, index 3, constant step."""

    end: Positive  # s
    step: Positive  # s
    rho_inf: float = Field(default=0.9, ge=0.0, le=1.0, strict=True)  # spectral radius at infinite frequency

    @property
    def steps(self) -> int:
        return round(self.end / self.step)


class Reduction(_Section):
    """What the reduced model's `coordinates` multiply.

    `basis`: ``eigenmodes`` takes `modes` of them with the slider held at each of several `positions`, compressed by
    POD; ``free_modes`` the lowest ones with the sliders released (free-interface modes), which need neither.
    `flexibility` adds what the basis leaves out, quasi-static, as tables in s: far fewer coordinates do then, 6 being
    the default for free modes.

    For free modes with flexibility, `estimate` adds an error estimate that needs no full model but a second simulation
    with four modes more, and `residual_inertia` keeps the inertia of what the modes leave out: the same coordinates, an
    order more accurate for smooth motions, at two to three times the cost of a step.

    `support_rows` says what becomes of a support's row that the basis satisfies already: ``drop`` leaves it out;
    ``hold`` lets it take one coordinate, the weakest of the basis, as it does in the paper (`pmr.reduce.galerkin`).
    """

    basis: Literal["eigenmodes", "free_modes"] = "eigenmodes"
    flexibility: bool = Field(default=False, strict=True)
    residual_inertia: bool = Field(default=False, strict=True)
    estimate: bool = Field(default=True, strict=True)
    snapshots: Count = 5
    modes: Count = 6
    coordinates: Count = 20
    positions: Literal["nodes", "path"] | Annotated[tuple[NotNegative, ...], Field(min_length=1)] = "nodes"
    solver: Literal["auto", "dense", "slepc"] = "auto"
    product: Literal["euclidean", "mass"] = "euclidean"
    support_rows: Literal["drop", "hold"] = "drop"

    @model_validator(mode="before")
    @classmethod
    def _fewer_do_with_flexibility(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("basis") == "free_modes" and data.get("flexibility") is True:
            return {"coordinates": 6} | data
        return data

    @property
    def needs_inertia(self) -> bool:
        """Whether tables of the residual part's inertia are needed: to keep it, or to estimate what it would do."""
        return self.basis == "free_modes" and self.flexibility and (self.estimate or self.residual_inertia)


SimulatorName = Literal["march", "exudyn", "exudyn-multiplier", "exudyn-callback"]


class Simulation(_Section):
    """Who simulates.

    The reduced model goes through every one of `simulators`: the first one's motion is compared and drawn, the others
    say how far they agree with it.  ``march`` is the compiled engine, ``exudyn-callback`` the paper's way.  With
    residual flexibility ``exudyn`` has springs that travel in place of constraints, ``exudyn-multiplier`` keeps these.
    The full model goes through one that fits its size; ``petsc``, for large ones, works on all ranks.
    """

    simulators: tuple[SimulatorName, ...] = Field(default=("march", "exudyn"), min_length=1)
    repeats: Count = 3  # of each simulator of the reduced model; seconds are their median
    full: Literal["auto", "march", "exudyn", "petsc"] = "auto"

    @field_validator("simulators")
    @classmethod
    def _different(cls, simulators: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(simulators)) < len(simulators):
            raise ValueError("each simulator once is allowed")
        return simulators


class Compare(_Section):
    """References to compare the reduced beam with."""

    against: tuple[Literal["full", "ancf"], ...] = ("full",)
    ancf_elements: Count = 20


class Published(_Section):
    """Figures from a publication, shown beside ours; fractions and m."""

    source: str
    errors: dict[Pair, dict[Literal["tip", "beam"], NotNegative]] = {}
    max_displacement: Positive | None = None
    max_error: Positive | None = None
    remarks: tuple[str, ...] = ()  # where and why our figures differ, for the report


class Accuracy(_Section):
    """An error that is allowed, instead of coordinates, residual inertia and step, which are chosen to hold it.

    `tolerance` is that of the reduction and the step together, in each of the `outputs`; the search for a step begins
    at `time.step`.  With `mesh` the part of the mesh is found out, too, by a second one with shorter cells.
    """

    tolerance: Annotated[float, Field(gt=0.0, lt=1.0, strict=True)]  # a fraction
    outputs: tuple[OutputKind, ...] = Field(default=("beam", "tip"), min_length=1)
    mesh: bool = Field(default=True, strict=True)


class SceneBase(_Section):
    """What scenes of every kind have; two of them with equal `hash` give equal results."""

    title: str
    slider: Slider
    damping: Damping = Damping()
    time: TimeChoice
    reduction: Reduction = Reduction()
    simulation: Simulation = Simulation()
    compare: Compare = Compare()
    accuracy: Accuracy | None = None
    published: Published | None = None

    @model_validator(mode="before")
    @classmethod
    def _march_keeps_inertia(cls, data: Any) -> Any:
        """Only ``march`` simulates with residual inertia, so it is the default there."""
        if isinstance(data, dict) and isinstance(data.get("reduction"), dict):
            chosen = data.get("simulation", {})
            if data["reduction"].get("residual_inertia") is True and isinstance(chosen, dict):
                return data | {"simulation": {"simulators": ("march",)} | chosen}
        return data

    @property
    @abstractmethod
    def signals(self) -> dict[str, SignalBase]:
        """What drives each input of the model, by its name."""

    @abstractmethod
    def without_loads(self) -> Self:
        """The scene with nothing but zeros for loads: what its modes depend on."""

    @property
    @abstractmethod
    def mesh_file(self) -> Path | None:
        """The file that the mesh is read from, if it is."""

    @property
    def hash(self) -> str:
        """Digest of what decides the result: all but title, published figures and who simulates."""
        content = self.model_dump(mode="json", exclude={"title", "published", "simulation"})
        if self.accuracy is None:
            del content["accuracy"]
        if self.mesh_file is not None:
            content["mesh"]["file"] = hashlib.sha256(self.mesh_file.read_bytes()).hexdigest()
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def path_bounds(self) -> tuple[float, float]:
        """Smallest and largest s(t) in m over the simulated time."""
        return bounds(self.slider.path, 0.0, self.time.end)


class Scene(SceneBase):
    """A planar beam on supports, with a slider: everything that a run is made from."""

    body: Body
    mesh: MeshChoice
    supports: tuple[Support, ...] = Field(default=(Support(at=0.0),), min_length=1)
    loads: tuple[Load, ...] = Field(min_length=1)

    @property
    def signals(self) -> dict[str, SignalBase]:
        return {load.name: load.signal for load in self.loads}

    def without_loads(self) -> Scene:
        loads = tuple(load.model_copy(update={"signal": Constant(amount=0.0)}) for load in self.loads)
        return self.model_copy(update={"loads": loads})

    @property
    def mesh_file(self) -> Path | None:
        return self.mesh.file

    @property
    def row_count(self) -> int:
        """Constraint rows of the full model: supports and sliders."""
        fixed = sum(1 for s in self.supports for d in SUPPORT_ROWS[s.kind] if d in self.body.directions)
        return fixed + len(self.slider.offsets)
