"""A boom of several sections in an Exudyn user's own mbs, beside what else is in it, against the compiled simulator."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from exudyn.itemInterface import (
    MarkerNodeCoordinates,
    NodeGenericODE2,
    ObjectConnectorCoordinateVector,
    ObjectGenericODE2,
)
from nested import Nested, reduced
from own_mbs import OwnSystem

from pmr import InputError, System
from pmr.files.arrays import Array
from pmr.scene.signals import Chirp, Constant, SmoothRamp
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.exudyn import Formulation, add_pre_step_function, add_sensors, add_system, simulate_system
from pmr.simulation.native import systems
from pmr.system.states import SystemTrajectory

STEPPING = TimeStepping(0.1, 1e-3, 0.8)
#: What the test of a body alone in a user's own mbs asks for, too.
TOLERANCE = 1e-7
MASS = 40.0  # kg


@pytest.fixture(scope="module")
def system() -> System:
    return reduced(Nested(2, elements=12), 3)


@pytest.fixture(scope="module")
def excitation(system: System) -> Excitation:
    """Out by 0.15 m within 0.1 s, under weight and a chirp at the tip."""
    chirp = Chirp(amplitude=2e3, times=(0.0, 0.1), frequencies=(5.0, 30.0), phase=1.0)
    loads = {name: chirp if name.endswith("F") else Constant(amount=9.81) for name in system.input_names}
    return Excitation({"1": SmoothRamp(times=(0.0, 0.1), values=(1.2, 1.35))}, loads, STEPPING)


def marched(system: System, excitation: Excitation, start: Any = None) -> SystemTrajectory:
    return systems.simulate(system, excitation, start)


def assert_close(found: Array, expected: Array) -> None:
    assert np.abs(expected).max() > 0.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["springs", "multipliers"])
def test_a_boom_in_a_users_own_system(system: System, excitation: Excitation, formulation: Formulation) -> None:
    """Coordinates, and sensors of outputs and contact forces, from equilibrium."""
    start, own = systems.static_start(system, excitation), OwnSystem(STEPPING)
    items = add_system(own.mbs, system, excitation.paths, excitation.loads, start, formulation)
    sensors = add_sensors(own.mbs, items)
    nodes = [own.coordinates(node) for node in items.nBodies.values()]
    *q, y, forces = own.solve(*nodes, sensors.sOutputs, sensors.sForces)
    expected = marched(system, excitation, start)
    for name, found in zip(items.nBodies, q, strict=True):
        assert_close(found, expected.bodies[name].q)
    assert_close(forces, expected.forces)
    assert_close(y, np.hstack(list(systems.displacements(system, expected).values())))
    assert sensors.contact_names == system.contact_names and len(sensors.output_names) == y.shape[1]
    assert sensors.output_names[0] == "0: output 0"


def test_extensions_and_loads_are_functions_of_the_users_variables(system: System, excitation: Excitation) -> None:
    own, paths, loads = OwnSystem(STEPPING), excitation.paths, excitation.loads

    def control(mbs: Any, t: float) -> bool:
        mbs.variables["extension"] = float(paths["1"].value(t))
        mbs.variables["lift"] = float(loads["1.F"].value(t))
        return True

    control(own.mbs, 0.0)
    add_pre_step_function(own.mbs, control)
    items = add_system(
        own.mbs,
        system,
        {"1": lambda mbs, t: mbs.variables["extension"]},
        {**loads, "1.F": lambda mbs, t: mbs.variables["lift"]},
    )
    (q,) = own.solve(own.coordinates(items.nBodies["1"]))
    assert_close(q, marched(system, excitation).bodies["1"].q)


def test_a_mass_that_hangs_on_a_port_of_a_section(system: System, excitation: Excitation) -> None:
    """As one that is part of the section's own mass; on a single node it moves as the port does."""
    tip = system.bodies["1"].outputs[-1]
    inner: Any = replace(system.bodies["1"], ports={"tip z": tip})
    system = System({**system.bodies, "1": inner}, system.contacts)
    own = OwnSystem(STEPPING)
    items = add_system(own.mbs, system, excitation.paths, excitation.loads)
    zero: dict[str, Any] = dict.fromkeys(("referenceCoordinates", "initialCoordinates", "initialCoordinates_t"), [0.0])
    node = own.mbs.AddNode(NodeGenericODE2(numberOfODE2Coordinates=1, **zero))
    own.mbs.AddObject(ObjectGenericODE2(nodeNumbers=[node], massMatrix=np.array([[MASS]])))
    hook = own.mbs.AddMarker(MarkerNodeCoordinates(nodeNumber=node))
    joined = {"scalingMarker0": inner.ports["tip z"][None], "scalingMarker1": np.eye(1)}
    own.mbs.AddObject(ObjectConnectorCoordinateVector(markerNumbers=[items.mBodies["1"], hook], **joined))
    q, z = own.solve(own.coordinates(items.nBodies["1"]), own.coordinates(node))
    heavy = replace(inner, M=inner.M + MASS * np.outer(tip, tip))
    expected = marched(System({**system.bodies, "1": heavy}, system.contacts), excitation).bodies["1"].q
    assert_close(q, expected)
    assert_close(z[:, 0], expected @ tip)
    assert np.abs(q - marched(system, excitation).bodies["1"].q).max() > 0.01 * np.abs(q).max()


@pytest.mark.slow
def test_pads_that_only_push_lift_off_there_too() -> None:
    """In steps that resolve them, as `simulate_system` has it; Exudyn's letting go is of first order."""
    system = reduced(Nested(2, elements=12, clearance=2e-4, compliance=1e-6), 3)
    chirp = Chirp(amplitude=4e4, times=(0.0, 0.1), frequencies=(5.0, 30.0), phase=1.0)
    loads = {name: chirp if name.endswith("F") else Constant(amount=9.81) for name in system.input_names}
    excitation = Excitation({"1": SmoothRamp(times=(0.0, 0.1), values=(1.2, 1.35))}, loads, replace(STEPPING, parts=1))
    own, start = OwnSystem(STEPPING), systems.static_start(system, excitation)
    items = add_system(own.mbs, system, excitation.paths, loads, start)
    sensors = add_sensors(own.mbs, items)
    q, forces = own.solve(own.coordinates(items.nBodies["1"]), sensors.sForces)
    alone = simulate_system(system, excitation, start)
    assert_close(q, alone.bodies["1"].q)
    assert_close(forces, alone.forces)
    assert (forces.min(axis=0) == 0.0).any() and forces.min() >= 0.0


def test_what_is_refused(system: System, excitation: Excitation) -> None:
    paths, loads = excitation.paths, excitation.loads
    for given, driving, says in (
        ({}, loads, "paths: none given, one for each path is allowed: 1"),
        (paths, {"1.F": loads["1.F"]}, "one for each input is allowed"),
        ({"1": Constant(amount=99.0)}, loads, "place = 99"),
    ):
        with pytest.raises(InputError, match=says):
            add_system(OwnSystem(STEPPING).mbs, system, given, driving)
    with pytest.raises(InputError, match="knows no rows that give way"):
        add_system(OwnSystem(STEPPING).mbs, system, paths, loads, formulation="callbacks")
