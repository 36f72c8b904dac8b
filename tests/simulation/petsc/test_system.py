"""Several full models over time: against bodies that are diagonalised, Newton's law, ranks and interruptions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from complementarity import by_least_squares
from distributed import distributed
from nested import Nested, full, reduced

from pmr import InputError, System
from pmr.fem.compat import MPI
from pmr.fem.factor import Factor
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.scene.signals import Chirp, Constant, SmoothRamp
from pmr.simulation import Excitation, TimeStepping, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.native import systems
from pmr.simulation.petsc import Checkpoint, History, integrate, observe, static_start
from pmr.simulation.petsc.rows import BlockFactor

#: Rigid pads hold both ways; soft ones too, or only push.
BOOMS = {
    "yielding": Nested(3, elements=8),
    "rigid": Nested(3, elements=8, compliance=0.0),
    "pushing": Nested(3, elements=8, compliance=1e-6, clearance=2e-4),
}


def of(system: System, comm: MPI.Comm = MPI.COMM_WORLD) -> FullSystem:
    """The same bodies, spread over ranks."""
    return FullSystem({name: distributed(body, comm) for name, body in system.bodies.items()}, system.contacts)


def driven(system: System, end: float = 0.1, rho_inf: float = 0.8, parts: int = 0) -> Excitation:
    """Every section out by 0.15 m within 0.1 s, under weight and a chirp that lifts the tip."""
    chirp = Chirp(amplitude=4e4, times=(0.0, 0.1), frequencies=(5.0, 30.0), phase=1.0)
    loads = {name: chirp if name.endswith("F") else Constant(amount=9.81) for name in system.input_names}
    paths = {
        name: SmoothRamp(times=(0.0, 0.1), values=(1.0 + 0.2 * int(name), 1.15 + 0.2 * int(name)))
        for name in system.paths
    }
    return Excitation(paths, loads, TimeStepping(end, 1e-3, rho_inf, parts))


def assert_close(found: Array, expected: Array, tolerance: float) -> None:
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def simulated(system: System, excitation: Excitation, comm: MPI.Comm = MPI.COMM_WORLD) -> History:
    spread = of(system, comm)
    return observe(spread, excitation, (), static_start(spread, excitation))


def test_without_initial_states_it_starts_as_the_excitation_says() -> None:
    system = full(Nested(2, elements=4))
    given = driven(system, end=0.01)
    found, expected = observe(of(system), replace(given, start="equilibrium")), simulated(system, given)
    for name, y in expected.y.items():
        assert_close(found.y[name], y, 1e-14)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
@pytest.mark.parametrize("pads", BOOMS)
def test_as_bodies_that_are_diagonalised(pads: str) -> None:
    """Outputs of every section, forces, their peaks and the balance of energy, from a static start.

    All steps in as many parts as resolve the contacts, which PETSc finds out by itself.
    """
    system = full(BOOMS[pads])
    excitation = driven(system)
    found, omega = simulated(system, excitation), contact_frequency(system, excitation)
    same = driven(system, parts=contact_step.count_parts(omega, excitation.stepping))
    expected = systems.simulate(system, same, systems.static_start(system, same))
    lines = systems.displacements(system, expected)
    for name, line in lines.items():
        assert_close(found.y[name], line, 1e-7)
    assert_close(found.contacts.forces, expected.forces, 1e-6)
    assert_close(found.contacts.peaks, expected.peaks, 1e-6)
    assert_close(found.energy.kinetic + found.energy.strain, expected.energy, 1e-6)
    assert found.errors.surplus == pytest.approx(expected.surplus, abs=1e-6)
    assert found.errors.position.max() < 1e-12
    np.testing.assert_array_equal(found.s, excitation.s)
    if pads == "pushing":  # some let go, some land
        changes = np.diff((expected.forces > 0.0).astype(int), axis=0)
        assert (changes > 0).any() and (changes < 0).any()


@pytest.mark.slow
@pytest.mark.mpi
def test_steps_in_the_parts_that_another_simulation_took() -> None:
    """Those that the same bodies take by modal coordinates; PETSc follows them through each change."""
    system = full(BOOMS["pushing"])
    excitation = driven(system)
    expected = systems.simulate(system, excitation, systems.static_start(system, excitation))
    assert expected.parts is not None and len(set(expected.parts[1:])) > 3
    found = simulated(system, scheduled(excitation, expected.parts[1:].tolist()))
    assert_close(found.contacts.forces, expected.forces, 1e-6)
    assert_close(found.contacts.peaks, expected.peaks, 1e-6)
    assert_close(found.energy.kinetic + found.energy.strain, expected.energy, 1e-6)
    lines = systems.displacements(system, expected)
    for name, line in lines.items():
        assert_close(found.y[name], line, 1e-7)


def scheduled(excitation: Excitation, parts: list[int]) -> Excitation:
    """With so many parts of each step."""
    return replace(excitation, stepping=replace(excitation.stepping, schedule=tuple(parts)))


@pytest.mark.mpi
def test_pads_that_only_push_start_as_a_complementarity_problem_has_them() -> None:
    """Static forces in full order, against non-negative least squares; then nothing moves."""
    system = full(Nested(3, elements=10, compliance=1e-7, clearance=1e-3))
    rest = {name: Constant(amount=9e4 if name.endswith("F") else 9.81) for name in system.input_names}
    excitation = Excitation(
        {name: Constant(amount=2.4) for name in system.paths}, rest, TimeStepping(0.01, 1e-3, 0.8, 1)
    )
    found = simulated(system, excitation)
    f = np.array([rest[name].amount for name in system.input_names])
    expected = by_least_squares(system, system.side_coordinates(dict.fromkeys(system.paths, 2.4)), f)
    largest = np.abs(expected).max()
    assert 0 < np.count_nonzero(found.contacts.forces[0]) < len(expected)
    assert np.abs(found.contacts.forces[0] - expected).max() < 1e-9 * largest
    assert np.abs(found.contacts.forces - expected).max() < 1e-6 * largest


@pytest.mark.parametrize("pads", ["yielding", pytest.param("pushing", marks=pytest.mark.slow)])
def test_reduced_sections_follow_it(pads: str) -> None:
    """With residual flexibility and four elastic modes each: tip and forces within 1 %."""
    boom = replace(BOOMS[pads], elements=20)
    whole, few = full(boom), reduced(boom, 4)
    found, excitation = simulated(whole, driven(whole, rho_inf=1.0), MPI.COMM_SELF), driven(few, rho_inf=1.0)
    small = systems.simulate(few, excitation, systems.static_start(few, excitation))
    line = systems.displacements(few, small)["2"]
    assert rms(line - found.y["2"]) < 0.01 * rms(found.y["2"])
    assert rms(small.forces - found.contacts.forces) < 0.01 * rms(found.contacts.forces)


def rms(y: Array) -> float:
    return float(np.sqrt(np.mean(y**2)))


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="compares two ranks with one")
@pytest.mark.parametrize("memory", [2**30, 0], ids=["answers stored", "two solves"])
def test_ranks_agree_with_one(memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrate, "STORED_BYTES", memory)
    for pads in ("rigid", "pushing"):
        system = full(BOOMS[pads])
        given = scheduled(driven(system, end=0.05), [1, 4, 4, 2, 16] * 10)
        alone, together = (simulated(system, given, comm) for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
        for name in system.bodies:
            assert_close(together.y[name], alone.y[name], 1e-8)
        assert_close(together.contacts.forces, alone.contacts.forces, 1e-8)
        assert_close(together.supports, alone.supports, 1e-8)


@pytest.mark.mpi
def test_newtons_law_of_every_section_at_every_step() -> None:
    """Change of momentum over a step against pads, support, weight and tip force, by the trapezoidal rule."""
    system = full(BOOMS["yielding"])
    excitation, spread = driven(system, rho_inf=1.0), of(system)
    found = observe(spread, excitation, excitation.times.tolist(), static_start(spread, excitation))
    loads = dict(zip(system.input_names, excitation.forces(system.input_names).T, strict=True))
    supports = {"0": -found.supports[:, 0]}  # the clamp's deflection
    for name, body in system.bodies.items():
        up = np.zeros(body.size)
        up[0::2] = 1.0
        v = np.concatenate(MPI.COMM_WORLD.allgather(found.states[name].v), axis=1)
        force = supports.get(name, 0.0) - v @ (body.D @ up)
        for one, column in zip(body.input_names, body.B.T, strict=True):
            force = force + (up @ column) * loads[f"{name}.{one}"]
        for side in system.sides:
            if side.place.body == name:
                force = force - side.sign * found.contacts.forces[:, side.contact]
        momentum = v @ (body.M @ up)
        left = np.diff(momentum) / excitation.stepping.step - (force[1:] + force[:-1]) / 2.0
        assert np.abs(left).max() < 1e-9 * np.abs(found.contacts.forces).max()


def test_equal_sections_share_a_factor() -> None:
    """The same model twice is factorised once, and the result is that of two models."""
    system = full(Nested(2, elements=8))
    inner = distributed(system.bodies["1"], MPI.COMM_SELF)
    contacts = tuple(replace(contact, outer=None) for contact in system.contacts)
    both = [replace(one, name=f"{one.name} of {name}", inner=replace(one.inner, body=name))
            for name in ("a", "b") for one in contacts]  # fmt: skip
    given = driven(system)
    loads = {f"{name}.{load}": given.loads[f"1.{load}"] for name in "ab" for load in inner.input_names}
    given, found = replace(given, loads=loads), []
    for other in (inner, distributed(system.bodies["1"], MPI.COMM_SELF)):
        twice = FullSystem({"a": inner, "b": other}, tuple(both))
        made = factors(twice)
        found.append((made, observe(twice, given)))
    assert [made for made, _ in found] == [1, 2]
    for _, history in found:
        np.testing.assert_array_equal(history.y["a"], history.y["b"])
    np.testing.assert_array_equal(found[0][1].y["a"], found[1][1].y["a"])


def factors(system: FullSystem) -> int:
    """How many are made."""
    made = []

    def factorised(model: FullModel) -> Factor:
        made.append(Factor(model.M, "M"))
        return made[-1]

    BlockFactor(system, factorised).destroy()
    return len(made)


class InterruptionError(Exception):
    pass


def half_way(share: float) -> None:
    if share >= 0.5:
        raise InterruptionError


@pytest.mark.slow
@pytest.mark.parametrize("pads", ["yielding", "pushing", "pushing and rubbing"])
def test_cut_off_it_goes_on_to_the_same_digits(pads: str, tmp_path: Path) -> None:
    system = full(BOOMS[pads.removesuffix(" and rubbing")])
    if pads == "pushing and rubbing":
        rough = [replace(one, friction=0.2, arm=0.18, shear_stiffness=1e7) for one in system.contacts]
        system = replace(system, contacts=tuple(rough))
    spread, excitation = of(system, MPI.COMM_SELF), scheduled(driven(system, end=0.04), [1, 6, 3, 3] * 10)
    start, states = static_start(spread, excitation), [0.01, 0.03]
    checkpoint = Checkpoint(tmp_path / "checkpoint", seconds=0.0)
    with pytest.raises(InterruptionError):
        observe(spread, excitation, states, start, half_way, checkpoint)
    other = scheduled(excitation, [1, 6, 3, 2] * 10)  # a reduced model made again: the parts begun with stay
    resumed = observe(spread, other, states, start, checkpoint=checkpoint)
    whole = observe(spread, excitation, states, start)
    for name in system.bodies:
        np.testing.assert_array_equal(resumed.y[name], whole.y[name])
        np.testing.assert_array_equal(resumed.states[name].v, whole.states[name].v)
    np.testing.assert_array_equal(resumed.contacts.forces, whole.contacts.forces)
    np.testing.assert_array_equal(resumed.contacts.peaks, whole.contacts.peaks)
    assert resumed.errors.surplus == whole.errors.surplus
    if whole.contacts.friction is not None:
        np.testing.assert_array_equal(resumed.contacts.friction, whole.contacts.friction)
        assert np.abs(whole.contacts.friction).max() > 0.0
    stiffer = replace(spread, contacts=tuple(replace(one, compliance=2e-6) for one in spread.contacts))
    with pytest.raises(InputError, match="contacts differs"):
        observe(stiffer, excitation, states, start, checkpoint=checkpoint)


@pytest.mark.mpi
def test_a_path_that_is_missing() -> None:
    system = full(BOOMS["yielding"])
    with pytest.raises(InputError, match="a path for it is needed"):
        observe(of(system), replace(driven(system), paths={}))
