"""FMUs of booms whose pads rub, compiled here and called through their interface, against the stepper."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from export.fmi.libraries import CallError, Instance, Library, loaded
from export.fmi.test_systems import BOTH_WAYS, WORKFLOWS
from numpy.typing import NDArray

from pmr.export.fmi.fmu import fmu_contents
from pmr.pipeline import reduce
from pmr.reduction.bodies import Reduction
from pmr.scene import load_any
from pmr.simulation.moving import read_scene
from pmr.simulation.native.stepper import Stepper
from pmr.system.contacts import Friction
from pmr.system.system import System

Array = NDArray[np.float64]
STEP, STEPS, RHO = 1e-3, 200, 0.8
TIP = 2.0e4  # N: turns the forces of pads that only push
#: Out and back within `STEPS` steps: friction turns, and pads stick there.
EXTENSION = "section.joint.extension={kind='sine',amplitude=0.05,frequency=8.0,offset=1.0}"
ROUGH = (
    "section.mesh.elements=12",
    EXTENSION,
    *(f"section.joint.{ring}.0.friction=0.2" for ring in ("tail", "mouth")),
    "section.joint.tail.0.static_friction=0.25",  # falls by 0.01 m/s: sections move by up to some 0.5
    f"time.end={STEP * STEPS}",
    f"time.step={STEP}",
    f"time.rho_inf={RHO}",
)
KINDS = {
    "both ways": ("boom_two", (*BOTH_WAYS, "section.joint.cylinder.stiffness=1e7"), "3"),
    "rigid cylinder": ("boom_two", BOTH_WAYS, "2"),
    "pushing": ("boom_two", ("section.joint.cylinder.stiffness=1e7",), "2"),
    "three, pushing": ("boom_three", ("section.joint.cylinder.stiffness=1e7",), "3"),
}
SLOW = ("rigid cylinder", "pushing", "three, pushing")


class Made:
    """A boom that rubs, its FMU, and how both are driven: cubics of paths and loads from step to step."""

    def __init__(self, kind: str, folder: Path) -> None:
        scene, changes, version = KINDS[kind]
        found = reduce(load_any(WORKFLOWS / f"{scene}.toml", (*ROUGH, *changes)))
        assert isinstance(found, Reduction)
        self.system = System.load(found.system.save(folder / "system.npz"))
        self.library: Library = loaded(
            fmu_contents(self.system, read_scene(self.system, "system.npz"), "boom", version), folder, version
        )
        self.pushes = not np.isnan(self.system.clearance).all()
        t = STEP * np.arange(STEPS + 1)
        w = 2.0 * np.pi * 8.0
        path = np.array([1.0 + 0.05 * np.sin(w * t), 0.05 * w * np.cos(w * t)])
        load = np.array([TIP * np.sin(0.5 * w * t), TIP * 0.5 * w * np.cos(0.5 * w * t)])
        names, paths = self.system.input_names, self.system.paths
        constant = np.array([np.broadcast_to(one, t.shape) for one in (1.0, 0.0)])
        gravity = read_scene(self.system, "system.npz").first_loads
        #: Value and rate (2, T) of each input of the FMU, paths before loads
        self.given = np.array(
            [path if k == 0 else constant for k in range(len(paths))]
            + [
                load if "tip_force" in name.replace(" ", "_") else constant * g
                for name, g in zip(names, gravity, strict=True)
            ]
        )

    @property
    def inputs(self) -> list[str]:
        return [name for name in self.library.named("input") if "_rate" not in name]

    @property
    def outputs(self) -> list[str]:
        """Displacements, then forces of contacts."""
        found = [name for name in self.library.named("output") if not name.startswith("reaction")]
        return [name for name in found if not name.endswith("_rate")]

    def started(self) -> Instance:
        instance = Instance(self.library)
        instance.set(["rho_inf"], [RHO])
        instance.initialise(self.inputs, self.given[:, 0, 0])
        return instance

    def advance(self, instance: Instance, k: int) -> None:
        """From step k on to the next one."""
        (u0, v0), (u1, v1), h = self.given[:, :, k].T, self.given[:, :, k + 1].T, STEP
        a = (6.0 * (u1 - u0) / h - 4.0 * v0 - 2.0 * v1) / h
        b = (6.0 * (v0 + v1) - 12.0 * (u1 - u0) / h) / h**2
        for suffix, values in (("", u0), ("_rate", v0), ("_rate_2", a), ("_rate_3", b)):
            instance.set([name + suffix for name in self.inputs], values)
        instance.step(k * h, h)

    def outputs_of(self, instance: Instance, first: int, last: int) -> Array:
        """Outputs after each of these steps."""
        found = []
        for k in range(first, last):
            self.advance(instance, k)
            found.append(instance.get(self.outputs))
        return np.array(found)

    def stepped(self) -> tuple[Array, Array]:
        """The stepper's outputs after each step, and the friction of each joint."""
        system, count = self.system, len(self.system.paths)
        (paths, loads), n = np.split(self.given, [count]), len(self.system.input_names)
        stepper = Stepper(
            system, STEP, dict(zip(system.paths, map(tuple, paths[:, :, 0]), strict=True)),
            {name: tuple(loads[k, :, 0]) for name, k in zip(system.input_names, range(n), strict=True)},
            RHO, parts=0 if self.pushes else 1,
        )  # fmt: skip
        found, friction = [], []
        for k in range(1, STEPS + 1):
            stepper.step(
                dict(zip(system.paths, map(tuple, paths[:, :, k]), strict=True)),
                {name: tuple(loads[j, :, k]) for j, name in enumerate(system.input_names)},
            )
            found.append(stepper.outputs)
            friction.append(list(stepper.friction.values()))
        return np.array(found), np.array(friction)


@pytest.fixture(scope="module", params=[*(pytest.param(k, marks=pytest.mark.slow if k in SLOW else ()) for k in KINDS)])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    yield Made(request.param, tmp_path_factory.mktemp("rough"))


def test_pads_rub_as_in_the_stepper(made: Made) -> None:
    """Displacements and forces of all contacts, cylinders with their friction among them, which turns twice."""
    expected, friction = made.stepped()
    assert friction[:, 0].min() < -100.0 and friction[:, 0].max() > 100.0
    found = made.outputs_of(made.started(), 0, STEPS)
    forces = np.array([name.startswith("force_of") for name in made.outputs])
    for some in (forces, ~forces):
        size = np.abs(expected[:, some]).max()
        np.testing.assert_allclose(found[:, some], expected[:, some], rtol=0.0, atol=1e-9 * size)


def test_a_state_that_is_taken_up_again_rubs_on(made: Made) -> None:
    """Saved within a stick, and as bytes in another instance; two instances do not mix; a reset forgets friction."""
    instance, other = made.started(), made.started()
    first = made.outputs_of(instance, 0, 30)
    state = instance.saved()
    content, on = instance.serialised(state), made.outputs_of(instance, 30, 40)
    instance.restore(state)
    np.testing.assert_array_equal(made.outputs_of(instance, 30, 40), on)
    np.testing.assert_array_equal(made.outputs_of(other, 0, 30), first)
    third = Instance(made.library)
    third.restore(third.deserialised(content))
    np.testing.assert_array_equal(made.outputs_of(third, 30, 40), on)
    instance.call("Reset")
    instance.set(["rho_inf"], [RHO])
    instance.initialise(made.inputs, made.given[:, 0, 0])
    np.testing.assert_array_equal(made.outputs_of(instance, 0, 30), first)


def test_derivatives_leave_friction_as_it_is(made: Made) -> None:
    """Along the load at the tip against differences of outputs, while friction acts; no pad opens or closes."""
    instance = made.started()
    made.outputs_of(instance, 0, 30)
    load = next(name for name in made.inputs if "tip_force" in name)
    at, h = instance.get([load])[0], 1.0
    seen = list[Array]()
    for value in (at + h, at - h, at):
        instance.set([load], [value])
        seen.append(instance.get(made.outputs))
    found, expected = instance.directional(made.outputs, load), (seen[0] - seen[1]) / (2.0 * h)
    forces = np.array([name.startswith("force_of") for name in made.outputs])
    for some in (forces, ~forces):
        atol = 1e-7 * np.abs(expected[some]).max() + 1e-14 * np.abs(seen[2][some]).max() / h
        np.testing.assert_allclose(found[some], expected[some], rtol=0.0, atol=atol)
    assert np.abs(expected[forces]).max() > 1e-3


def test_model_exchange_refuses_friction(made: Made) -> None:
    """Its state is no integral of a rate."""
    assert Friction.from_contacts(made.system.contacts) is not None
    with pytest.raises(CallError, match="leave no differential equation: Co-Simulation is allowed"):
        Instance(made.library, model_exchange=True)
