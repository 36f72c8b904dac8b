"""FMUs of bodies alone, of booms and of booms in frames, each with the system and the scene that it was made from."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import plain_machines
from export.fmi.libraries import Instance, Library, loaded
from on_pads import beam_on_pads, flexible_on_pads
from oracle import flexible, project, rich_body

import pmr
from pmr import ReducedModel, System
from pmr.export.fmi import fmu_contents
from pmr.export.fmi.variables import Drivers
from pmr.files.arrays import Array
from pmr.scene.signals import Chirp, Ramp, SignalBase, Sine, SmoothRamp
from pmr.simulation.moving import StoredScene, read_scene

END, STEP = 0.2, 1e-3
PATH = SmoothRamp(times=(0.0, 0.2), values=(2.0, 2.6))
ON_PADS = Ramp(times=(0.0, 0.2), values=(2.0, 2.2))
LOADS: tuple[SignalBase, ...] = (
    Chirp(amplitude=50.0, times=(0.0, 0.2), frequencies=(2.0, 20.0), phase=1.0),
    Sine(amplitude=30.0, frequency=4.0, phase=0.3),
)
WEIGHT_AND_LIFT: tuple[SignalBase, ...] = (
    SmoothRamp(times=(0.0, 0.02), values=(0.0, 9.81)),
    Sine(amplitude=2e3, frequency=10.0),
)
RINGS = ("tail", "mouth")
BOTH_WAYS = tuple(f"section.joint.{ring}.0.unilateral=false" for ring in RINGS)
GIVES_WAY = "section.joint.cylinder.stiffness=1e7"
BOOM = (
    "section.mesh.elements=16",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.3],values=[0.6,1.6]}",
    "sections.fly.loads.0.signal={kind='sine',amplitude=2e3,frequency=6.0}",
    "time.end=0.3",
    f"time.step={STEP}",
    "time.rho_inf=0.8",
)
#: Pads that rub; a section goes out and back, so that friction turns and pads stick, under a load that turns forces.
ROUGH = (
    "section.mesh.elements=12",
    "section.joint.extension={kind='sine',amplitude=0.05,frequency=8.0,offset=1.0}",
    "sections.fly.loads.0.signal={kind='sine',amplitude=2e4,frequency=4.0}",
    *(f"section.joint.{ring}.0.friction=0.2" for ring in RINGS),
    "section.joint.tail.0.static_friction=0.25",  # falls by 0.01 m/s: sections move by up to some 0.5
    "time.end=0.2",
    f"time.step={STEP}",
    "time.rho_inf=0.8",
)
CRANE = (
    # pads three times as long as in the scene, with a third of its stretches, which are loads to answer
    *(f"section.joint.{ring}.0.{key}" for ring in RINGS for key in ("length=0.9", "at=0.45")),
    "compare.against=[]",
    "section.mesh.elements=6",
    "frame.second_order=true",
    "frame.luffing.times=[0.0,1.4]",
    "frame.slewing.times=[-0.2,1.6]",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.9],values=[0.6,2.5]}",
    "sections.fly.loads.0.axes=ground",
    "time.end=0.1",
    "time.rho_inf=0.9",
    "time.step=2e-3",
)
SHIP = (
    "frame.base.x={kind='sine',amplitude=0.02,frequency=2.0}",
    "frame.base.rx={kind='sine',amplitude=2.0,frequency=1.5}",
    "frame.base.ry={kind='sine',amplitude=1.0,frequency=1.1}",
    "frame.base.rz={kind='sine',amplitude=3.0,frequency=0.7}",
)
SPRINGS = "section.joint.cylinder.stiffness=5e7"
BODIES = {"flexible 2": "2", "flexible": "3", "rigid": "3", "coupled": "3", "on pads": "3"}
#: Scene, its changes and the version of the interface.
BOOMS: dict[str, tuple[str | Path, tuple[str, ...], str]] = {
    "two": ("boom_two", (*BOOM, *BOTH_WAYS), "2"),
    "three": ("boom_three", (*BOOM, *BOTH_WAYS), "3"),
    "three, elastic": ("boom_three", (*BOOM, *BOTH_WAYS, GIVES_WAY), "3"),
    "three, pushing": ("boom_three", (*BOOM, "sections.fly.loads.0.signal.amplitude=2e4"), "2"),
    "rubbing": ("boom_two", (*ROUGH, *BOTH_WAYS, GIVES_WAY), "3"),
    "rubbing, rigid": ("boom_two", (*ROUGH, *BOTH_WAYS), "2"),
    "rubbing, pushing": ("boom_two", (*ROUGH, GIVES_WAY), "2"),
    "three, rubbing": ("boom_three", (*ROUGH, GIVES_WAY), "3"),
    "ship": (plain_machines.CRANE, (*CRANE, *SHIP), "3"),
    "crane on springs": (plain_machines.CRANE, (*CRANE, SPRINGS), "2"),
    "crane, rubbing": (plain_machines.CRANE, (*CRANE, SPRINGS,
     *(f"section.joint.{ring}.0.friction=0.2" for ring in RINGS)), "3"),
}  # fmt: skip
KINDS = (*BODIES, *BOOMS)


def provided(model: ReducedModel, path: SignalBase, loads: tuple[SignalBase, ...]) -> ReducedModel:
    """Model with the scene that a run would leave in it."""
    listed = [{"name": "F", "signal": load.model_dump(mode="json")} for load in loads]
    time = {"end": END, "step": STEP, "rho_inf": 0.8}
    scene: dict[str, Any] = {"slider": {"path": path.model_dump(mode="json")}, "loads": listed, "time": time}
    return replace(model, provenance={"scene": scene})


def body_alone(kind: str) -> ReducedModel:
    """One of `BODIES`; dampers couple the modes of the coupled one, whose rows give way."""
    rich = rich_body()
    if kind == "on pads":
        return provided(flexible_on_pads(beam_on_pads(1e-4), 6), ON_PADS, WEIGHT_AND_LIFT)
    if kind == "rigid":
        return provided(project(rich, np.eye(rich.size)[:, 2:]), PATH, LOADS)
    model = provided(flexible(rich, 6), PATH, LOADS)
    if kind == "coupled":
        couples = np.diag(np.arange(1.0, 7.0)) + 0.5
        model = replace(model, D=model.M @ couples @ model.M, rayleigh=None, pads=np.array([2e-6, 3e-6]))
    return model


@dataclass(frozen=True)
class Unit:
    """An FMU that is loaded, with texts of its archive, and what it was made from."""

    system: System
    scene: StoredScene
    drivers: Drivers
    library: Library
    texts: dict[str, str]

    @property
    def step(self) -> float:
        return self.scene.excitation.stepping.step

    @property
    def pushes(self) -> bool:
        return not np.isnan(self.system.clearance).all()

    @property
    def rubs(self) -> bool:
        return any(contact.friction for contact in self.system.contacts)

    @property
    def inputs(self) -> list[str]:
        """Paths, loads and motions, then their rates, second and third rates."""
        return self.library.named("input")

    @property
    def values(self) -> list[str]:
        return [name for name in self.inputs if "_rate" not in name]

    @property
    def rates(self) -> list[str]:
        return [name for name in self.inputs if name.endswith("_rate")]

    @property
    def displacements(self) -> list[str]:
        """Outputs of the bodies, but for reactions and the tip's place in space."""
        outputs = [name for name in self.library.named("output") if not name.endswith("_rate")]
        return [name for name in outputs if not name.startswith(("reaction", "tip_in")) and name not in self.forces]

    @property
    def forces(self) -> list[str]:
        """Forces of contacts, which are the last outputs."""
        return self.library.named("output")[-len(self.system.contacts) :]

    @property
    def states(self) -> list[str]:
        return [name for name in self.library.named("local") if "mode_" in name and not name.startswith("der_")]

    @cached_property
    def reference_in(self) -> tuple[list[str], Array]:
        """Names of the inputs (n,), and the time in s before their values (T, 1 + n), at all steps of the reference."""
        return self._reference("in")

    @cached_property
    def reference_out(self) -> tuple[list[str], Array]:
        """Names of the outputs (o,), and the time in s before their values (S, 1 + o), at some steps."""
        return self._reference("out")

    def begin(self) -> Instance:
        """Instance at the start of the unit's own reference."""
        names, table = self.reference_in
        instance = Instance(self.library)
        instance.set(["internal_step"], [self.step])
        instance.initialise(names, table[0, 1:])
        return instance

    def advance(self, instance: Instance, k: int) -> None:
        """Make step k of the unit's own reference."""
        names, table = self.reference_in
        instance.set(names, table[k, 1:])
        instance.step(k * self.step, self.step)

    def arguments(self, instance: Instance) -> dict[str, Any]:
        """Arguments of a stepper's step, as the unit's inputs are now."""
        at = dict(zip(self.drivers.names, instance.get(self.inputs).reshape(4, -1)[:3].T, strict=True))
        if self.drivers.frame is None:
            given = {"s": self.drivers.paths, "F": self.drivers.loads}
            return {key: {name: tuple(at[name][:2]) for name in names} for key, names in given.items()}
        s, F = {name: at[name] for name in self.drivers.paths}, {name: at[name][0] for name in self.drivers.loads}
        return {"s": s, "F": F, "frame": {name: at[name] for name in self.drivers.motions}}

    def _reference(self, which: str) -> tuple[list[str], Array]:
        """Names without that of the time, and all columns."""
        head, *rows = self.texts[f"resources/reference_{which}.csv"].splitlines()
        return [name.strip('"') for name in head.split(",")[1:]], np.array([row.split(",") for row in rows], float)


def unit_of(kind: str, folder: Path) -> Unit:
    """FMU of one of `KINDS`, whose system has been saved and read again."""
    if kind in BODIES:
        version, name = BODIES[kind], "model"
        system = System.of(body_alone(kind))
    else:
        scene, changes, version = BOOMS[kind]
        name = "system"
        system = System.load(pmr.reduce(pmr.load_scene(scene, [*changes])).system.save(folder / "system.npz"))
    stored = read_scene(system, name)
    contents = fmu_contents(system, stored, "boom", version)
    return Unit(system, stored, Drivers.of(system), loaded(contents, folder, version), contents.texts)
