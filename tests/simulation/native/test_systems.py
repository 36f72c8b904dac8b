"""Systems of bodies over time: against a dense integrator, one body, Newton's law, and full order."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import one_body
import pytest
import scipy.sparse as sp
from generalized_alpha import GeneralizedAlpha
from impulses import impulses
from nested import LENGTH, Nested, full, full_section, plain, reduced, section
from one_body import displacement
from oracle import carried_rows, flexible, full_body, rich_body

from pmr import InputError, SimulationError, System
from pmr.scene.signals import Chirp, Constant, Ramp, SignalBase, SmoothRamp
from pmr.simulation import Excitation, InitialState, TimeStepping
from pmr.simulation.native import systems
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact, Place
from pmr.system.rows import Rows
from pmr.system.states import SystemTrajectory

RETRACTED, EXTENDED = 0.6, 4.5  # m of extension


def excitation(
    system: System, paths: Callable[[int], SignalBase], force: SignalBase, stepping: TimeStepping
) -> Excitation:
    """Weight, a tip force, and every path by its number."""
    loads = {name: force if name.endswith(".F") else Constant(amount=9.81) for name in system.input_names}
    return Excitation({name: paths(int(name)) for name in system.paths}, loads, stepping)


def quickly(system: System, step: float = 1e-3, rho_inf: float = 1.0, end: float = 0.4) -> Excitation:
    """Out by 0.6 m a joint within 0.4 s, under a chirp."""
    force = Chirp(amplitude=2e3, times=(0.0, 0.4), frequencies=(1.0, 30.0))
    return excitation(
        system,
        lambda k: SmoothRamp(times=(0.0, 0.4), values=(1.0 + 0.2 * k, 1.6 + 0.2 * k)),
        force,
        TimeStepping(end, step, rho_inf),
    )


def from_statics(system: System, given: Excitation) -> SystemTrajectory:
    return systems.simulate(system, given, systems.static_start(system, given))


def integrated(system: System, given: Excitation, start: dict[str, InitialState]) -> tuple[np.ndarray, np.ndarray]:
    """q (T, n) and forces (T, m) by generalized-alpha on one sparse saddle point a step; contacts hold both ways."""
    a, method = Assembly(system), GeneralizedAlpha(given.stepping.step, given.stepping.rho_inf)
    x = system.side_coordinates(dict(zip(given.paths, given.s.T, strict=True)))
    f, h = given.forces(system.input_names), given.stepping.step
    gain = (1.0 - method.alpha_f) / (1.0 - method.alpha_m)
    to_v, to_q = method.gamma * h * gain, method.beta * h**2 * gain
    q, v = (
        np.concatenate([getattr(start[name], part)[a.free_coordinates[name]] for name in system.bodies])
        for part in "qv"
    )
    rows = a.contact_rows(x[0])
    firm = np.all(rows.F == 0.0, axis=1)
    force = np.zeros(len(firm))
    if not firm.all():
        given_way = (rows.C @ q + rows.H @ f[0])[~firm]
        force[~firm] = np.linalg.solve(rows.F[np.ix_(~firm, ~firm)], given_way)
    right = a.B @ f[0] - a.K @ q - a.D @ v - rows.C.T @ force
    C = sp.csr_matrix(rows.C[firm])
    zero = sp.csr_matrix((firm.sum(), firm.sum()))
    found = sp.linalg.spsolve(sp.bmat([[a.M, C.T], [C, zero]], "csc"), np.concatenate([right, np.zeros(firm.sum())]))
    acceleration, force[firm] = found[: a.size], found[a.size :]
    alike, kept = acceleration, [(q, force)]
    for x_k, f_k in zip(x[1:], f[1:], strict=True):
        rows = a.contact_rows(x_k)
        predicted = (method.alpha_f * acceleration - method.alpha_m * alike) / (1.0 - method.alpha_m)
        q = q + h * v + h**2 * ((0.5 - method.beta) * alike + method.beta * predicted)
        v = v + h * ((1.0 - method.gamma) * alike + method.gamma * predicted)
        S = a.M + to_v * a.D + to_q * a.K
        C = sp.csr_matrix(rows.C)
        matrix = sp.bmat([[S, C.T], [C, -sp.csr_matrix(rows.F / to_q)]], "csc")
        right = np.concatenate([a.B @ f_k - a.K @ q - a.D @ v, -(rows.C @ q + rows.H @ f_k) / to_q])
        found = sp.linalg.spsolve(matrix, right)
        acceleration, force = found[: a.size], found[a.size :]
        q, v, alike = q + to_q * acceleration, v + to_v * acceleration, predicted + gain * acceleration
        kept.append((q, force))
    return tuple(np.array(values) for values in zip(*kept, strict=True))  # type: ignore[return-value]


def assert_integrated(system: System, given: Excitation, tolerance: float) -> None:
    start = systems.static_start(system, given)
    found, (q, forces) = systems.simulate(system, given, start), integrated(system, given, start)
    a = Assembly(system)
    for name, motion in found.bodies.items():
        expected = q[:, a.coordinate_slices[name]]
        assert np.abs(motion.q[:, a.free_coordinates[name]] - expected).max() < tolerance * np.abs(expected).max()
    assert np.abs(found.forces - forces).max() < tolerance * np.abs(forces).max()


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("count", [2, 4])
def test_reduced_sections_against_a_sparse_saddle_point_each_step(count: int) -> None:
    system = reduced(Nested(count, elements=20), 3)
    assert_integrated(system, quickly(system, end=0.15), 1e-8)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("clearance", [None, 1e-4])
def test_contacts_numbered_along_a_chain_or_against_it_move_it_alike(clearance: float | None) -> None:
    system = reduced(Nested(4, elements=8, clearance=clearance), 3)
    against = replace(system, contacts=system.contacts[::-1])
    along, turned = (from_statics(one, quickly(one, end=0.1)) for one in (system, against))
    np.testing.assert_allclose(turned.forces[:, ::-1], along.forces, rtol=0.0, atol=1e-9 * np.abs(along.forces).max())
    for name, body in along.bodies.items():
        np.testing.assert_allclose(turned.bodies[name].q, body.q, rtol=0.0, atol=1e-9 * np.abs(body.q).max())


@pytest.mark.slow
@pytest.mark.numerical
def test_full_sections_against_a_sparse_saddle_point_each_step() -> None:
    system = full(Nested(3, elements=8))
    assert_integrated(system, quickly(system, end=0.15), 1e-7)


@pytest.mark.slow
@pytest.mark.numerical
def test_rigid_contacts_against_a_sparse_saddle_point_each_step() -> None:
    system = full(Nested(3, elements=8, compliance=0.0))
    assert_integrated(system, quickly(system, rho_inf=0.8), 1e-6)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_damper_between_modes() -> None:
    boom = Nested(2, elements=8)
    tip = full_section(boom.boxes[1])
    D = tip.D.tolil()
    D[-2, -2] += 2e3
    system = System({"0": full(boom).bodies["0"], "1": replace(tip, D=D.tocsr())}, full(boom).contacts)
    assert_integrated(system, quickly(system, end=0.15), 1e-7)


@pytest.mark.slow
@pytest.mark.numerical
def test_mixed_orders_in_one_system() -> None:
    """A section in full order in a reduced one."""
    boom = Nested(2, elements=12)
    system = System({"0": reduced(boom, 4).bodies["0"], "1": full(boom).bodies["1"]}, full(boom).contacts)
    assert_integrated(system, quickly(system, end=0.15), 1e-7)


def test_one_body_on_the_ground_is_the_simulator_of_one_body() -> None:
    """Two sliders 0.8 m apart on one path, with residual flexibility, clearances and loads; outputs too."""
    rich = rich_body()
    rows = Rows(
        tuple(replace(row, compliance=1e-6) if row.held_coordinate is None else row for row in rich.rows.rows),
        rich.size,
    )
    rich = replace(rich, rows=rows)
    body = replace(flexible(rich, 5), carriers=carried_rows(rich, 5))
    stepping, path = TimeStepping(0.6, 1e-3, 0.9), Ramp(times=(0.0, 0.6), values=(1.2, 3.1))
    loads = {"F": Chirp(amplitude=50.0, times=(0.0, 0.6), frequencies=(1.0, 20.0)), "T": Constant(amount=3.0)}
    contacts = [Contact(name, Place("beam", name, path="s"), compliance=1e-6) for name in body.row_names]
    system = System({"beam": body}, tuple(contacts))
    one = one_body.simulate(body, Excitation({"slider": path}, loads, stepping))
    several = Excitation({"s": path}, {f"beam.{name}": load for name, load in loads.items()}, stepping)
    found = systems.simulate(system, several)
    motion = found.bodies["beam"]
    assert np.abs(motion.q - one.q).max() < 1e-11 * np.abs(one.q).max()
    assert np.abs(found.forces - one.multipliers).max() < 1e-9 * np.abs(one.multipliers).max()
    y = displacement(body, one.q, one.s, one.multipliers, found.loads)
    assert np.abs(systems.displacements(system, found)["beam"] - y).max() < 1e-11 * np.abs(y).max()


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("rho_inf", [1.0, 0.8])
def test_newton_and_euler_hold_for_every_section_at_every_step(rho_inf: float) -> None:
    """Change of momentum and of moment of momentum over a step, against what pads and loads give in it.

    The pads' forces at their places, the weight and the tip force; momenta from the full mass of each section.
    """
    boom = Nested(3, elements=20)
    system = reduced(boom, 2)
    given = quickly(system, rho_inf=rho_inf)
    found = from_statics(system, given)
    for name in ("1", "2"):
        motion = found.bodies[name]
        momentum, force = momenta(system, found, name), loading(boom, system, found.loads, name)
        force -= np.einsum("dts,ts->td", np.stack([np.ones_like(motion.s), motion.s]), motion.multipliers)
        left = np.diff(momentum, axis=0) - impulses(given.stepping, np.ones(len(force), int), force)[1:]
        largest = np.abs(motion.multipliers).max() * given.stepping.step
        assert np.all(np.abs(left) < 1e-9 * largest * np.array([1.0, LENGTH]))


@pytest.mark.parametrize("rho_inf", [1.0, 0.8])
def test_newtons_law_where_pads_let_go_in_parts_of_steps(rho_inf: float) -> None:
    """Change of momentum over a step against the impulses of pads that only push, of weight and tip force."""
    boom = Nested(3, elements=20, clearance=0.0)
    system = reduced(boom, 2)
    given = quickly(system, rho_inf=rho_inf)
    found = from_statics(system, given)
    assert found.parts is not None and found.impulses is not None and len(set(found.parts)) > 3
    assert np.count_nonzero(np.diff((found.forces > 0.0).astype(int), axis=0) < 0) > 3
    fine = given.with_stepping(given.stepping.divide(int(found.parts.max()))).forces(system.input_names)
    for name in ("1", "2"):
        momentum, force = momenta(system, found, name)[:, 0], loading(boom, system, fine, name)[:, :1]
        gave = impulses(given.stepping, found.parts, force)[:, 0]
        gave -= system.side_multipliers(name, found.impulses).sum(axis=1)
        largest = found.peaks.max() * given.stepping.step
        assert np.abs(np.diff(momentum) - gave[1:]).max() < 1e-9 * largest


def momenta(system: System, found: SystemTrajectory, name: str) -> np.ndarray:
    """Momentum and moment of momentum about the tail, (T, 2); rigid motions are modes, so those of two coordinates."""
    body = system.bodies[name]
    to_rigid = np.linalg.lstsq(body.outputs[:, :2], shapes_at_outputs(body.output_positions), rcond=None)[0]
    return np.asarray(found.bodies[name].v[:, :2] @ to_rigid)


def loading(boom: Nested, system: System, loads: np.ndarray, name: str) -> np.ndarray:
    """Force and moment (T, 2) of weight and tip force on a section, of its full mass."""
    f, whole = dict(zip(system.input_names, loads.T, strict=True)), section(boom.boxes[int(name)]).gather()
    assert whole is not None
    shapes = np.zeros((whole.size, 2))  # a translation, and a rotation about the tail
    shapes[0::2, 0] = 1.0
    shapes[0::2, 1], shapes[1::2, 1] = np.linspace(0.0, LENGTH, 21), 1.0
    force = -f[f"{name}.gravity"][:, None] * (shapes.T @ (whole.M @ shapes[:, 0]))
    return np.asarray(force + f["2.F"][:, None] * np.array([1.0, LENGTH]) * (name == "2"))


def shapes_at_outputs(positions: np.ndarray) -> np.ndarray:
    """Deflections of a translation and of a rotation about the tail, (o, 2)."""
    return np.stack([np.ones_like(positions), positions], axis=1)


@pytest.mark.slow
@pytest.mark.numerical
def test_energy_less_work_is_second_order_in_the_step() -> None:
    """Without damping what loads and travelling pads put in is what is stored; reduced, with residual flexibility."""
    system = reduced(Nested(3, elements=20), 3)
    bodies = {name: replace(body, D=0.0 * body.D) for name, body in system.bodies.items()}
    system = System(bodies, system.contacts)
    off = []
    for step in (1e-3, 5e-4, 2.5e-4):
        found = from_statics(system, quickly(system, step))
        off.append(np.abs(found.energy - found.energy[0] - found.work).max() / found.energy.max())
    assert off[0] < 1e-3
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.3) and off[1] / off[2] == pytest.approx(4.0, rel=0.3)


@pytest.mark.slow
@pytest.mark.numerical
def test_pads_that_only_push_lift_off_and_create_no_energy() -> None:
    """The tip force lifts the boom off its pads and lets it fall; the same pads in full order, within 1 %."""
    boom, tip, lines, forces = Nested(2, elements=20, clearance=2e-4, compliance=1e-6), [], [], []
    force = SmoothRamp(times=(0.0, 0.1, 0.2, 0.3), values=(0.0, 2.5e4, 2.5e4, 0.0))
    for system in (full(boom), reduced(boom, 4)):
        given = excitation(
            system, lambda k: SmoothRamp(times=(0.0, 0.5), values=(2.0, 2.4)), force, TimeStepping(0.5, 1e-3, 1.0)
        )
        found = from_statics(system, given)
        assert found.forces.min() >= 0.0 and np.all(found.peaks >= found.forces)
        pushing = found.forces > 0.0
        assert pushing.any(axis=0).sum() == 4 and not pushing.all(axis=0).any()  # each lands and lifts off
        assert found.surplus < 1e-3
        line = systems.displacements(system, found)["1"]
        lines.append(line)
        tip.append(line[:, -1])
        forces.append(found.forces)
    assert rms(tip[1] - tip[0]) < 0.01 * rms(tip[0]) and rms(lines[1] - lines[0]) < 0.01 * rms(lines[0])
    assert rms(forces[1] - forces[0]) < 0.01 * rms(forces[0])


def test_pads_that_only_push_converge_with_the_step() -> None:
    """In the mean; a force that sets in within a step is known to first order."""
    system, last = reduced(Nested(2, elements=10, clearance=0.0, compliance=1e-6), 3), []
    force = SmoothRamp(times=(0.0, 0.1, 0.2), values=(0.0, 2e4, 0.0))
    for parts in (4, 8, 16, 64):
        given = excitation(system, lambda k: Constant(amount=2.0), force, TimeStepping(0.3, 1e-3, 1.0, parts))
        found = from_statics(system, given)
        last.append(systems.displacements(system, found)["1"][:, -1])
    error = [rms(y - last[-1]) for y in last[:-1]]
    assert error[0] > 1.7 * error[1] > 1.7 * 1.7 * error[2] and error[2] < 0.01 * rms(last[-1])


def rms(y: np.ndarray) -> float:
    return float(np.sqrt(np.mean(y**2)))


def test_static_start_stays_at_rest() -> None:
    for clearance in (None, 0.0):
        system = reduced(Nested(3, elements=20, clearance=clearance), 2)
        given = excitation(
            system, lambda k: Constant(amount=2.0), Constant(amount=-1e3), TimeStepping(0.05, 1e-3, 1.0, 1)
        )
        found = from_statics(system, given)
        assert np.abs(found.forces - found.forces[0]).max() < 1e-6 * np.abs(found.forces).max()
        for motion in found.bodies.values():
            assert np.abs(motion.q - motion.q[0]).max() < 1e-8 * np.abs(motion.q).max()


def test_a_start_at_rest_sags() -> None:
    system = reduced(Nested(2, elements=20), 2)
    given = excitation(system, lambda k: Constant(amount=2.0), Constant(amount=0.0), TimeStepping(0.5, 1e-3, 1.0))
    found = systems.simulate(system, given)
    tip = systems.displacements(system, found)["1"][:, -1]
    static = systems.displacements(system, from_statics(system, given))["1"][0, -1]
    assert tip.min() == pytest.approx(2.0 * static, rel=0.1)


def test_a_body_that_nothing_drives_but_weight_falls() -> None:
    """No contact at all: s = g t^2 / 2, to the digit with the trapezoidal rule."""
    system = System({"1": reduced(Nested(2, elements=20), 3).bodies["1"]}, ())
    loads = {name: Constant(amount=0.0 if name.endswith("F") else 9.81) for name in system.input_names}
    found = systems.simulate(system, Excitation({}, loads, TimeStepping(1.0, 1e-2, 1.0)))
    y = systems.displacements(system, found)["1"]
    assert y[-1] == pytest.approx(-9.81 / 2.0, rel=1e-9)


def test_what_is_refused() -> None:
    rigid = full(Nested(2, elements=8, compliance=0.0, clearance=0.0))
    with pytest.raises(InputError, match="mouth 0 top, mouth 0 bottom only push and are rigid"):
        systems.simulate(rigid, quickly(rigid))
    travelling = full(Nested(2, elements=8, compliance=0.0))
    with pytest.raises(InputError, match="rho_inf"):
        systems.simulate(travelling, quickly(travelling))
    system = reduced(Nested(2, elements=20), 2)
    given = quickly(system)
    with pytest.raises(InputError, match="a path for it is needed"):
        systems.simulate(system, replace(given, paths={}))
    with pytest.raises(InputError, match="one for each input is allowed"):
        systems.simulate(system, replace(given, loads={}))
    with pytest.raises(InputError, match="4 finite values"):
        systems.simulate(system, given, {"1": InitialState(np.zeros(3), np.zeros(3))})
    far = replace(given, paths={"1": Constant(amount=7.0)})
    with pytest.raises(InputError, match="contacts.tail 1.place = 7.15: 0 to 6 m are allowed on 0"):
        systems.simulate(system, far)
    twice = System(travelling.bodies, (*travelling.contacts, replace(travelling.contacts[0], name="again")))
    with pytest.raises(SimulationError, match="the rows tail 1, again depend on each other"):
        systems.simulate(twice, quickly(twice, rho_inf=0.8))
    violated = full_body(8)
    held = System({"b": violated}, (Contact("slider", Place("b", violated.row_names[2], 2.0)),))
    q = np.ones(violated.size)
    q[list(violated.held.values())] = 0.0
    start = {"b": InitialState(q, np.zeros(violated.size))}
    with pytest.raises(InputError, match="row 'slider' is violated"):
        systems.simulate(held, Excitation({}, {"b.F": Constant(amount=0.0)}, TimeStepping(0.1, 1e-3, 0.9)), start)


#: Sections, elastic modes of each, coordinates in all, highest frequency of the tip force in Hz, bound of the errors.
BOOMS = [(2, 3, 8, 3.0, 1e-4), (3, 2, 10, 3.0, 2e-4), (4, 2, 14, 2.0, 2e-4)]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "elastic", "coordinates", "top", "bound"), BOOMS)
def test_booms_against_full_order(count: int, elastic: int, coordinates: int, top: float, bound: float) -> None:
    """Out and in within 7 s under weight and a chirp; errors in NRMS of tip, lines and pad forces."""
    boom, found = Nested(count), []
    cases = (full(boom), reduced(boom, elastic), plain(boom, elastic))
    for system in cases:
        given = excitation(
            system,
            lambda k: sequence(k, count) if count == 4 else SmoothRamp(times=(0.0, 3.5, 7.0), values=OUT_AND_IN),
            Chirp(amplitude=2e3, times=(0.0, 8.0), frequencies=(0.2, top)),
            TimeStepping(8.0, 2e-3, 1.0),
        )
        trajectory = from_statics(system, given)
        assert trajectory.surplus < 1e-3
        found.append((systems.displacements(system, trajectory), trajectory.forces))
    assert sum(body.size for body in cases[1].bodies.values()) == coordinates
    small, without = (errors(one, found[0]) for one in found[1:])
    assert small.max() < bound
    assert np.all(without > 100.0 * small)


OUT_AND_IN = (RETRACTED, EXTENDED, RETRACTED)


def sequence(k: int, count: int) -> SignalBase:
    """Section k of 1 to `count` - 1: the first one out first, and in last."""
    part = 7.0 / (2 * count - 2)
    out, back = (k - 1) * part, 7.0 - k * part
    if k == count - 1:
        return SmoothRamp(times=(out, out + part, back + part), values=OUT_AND_IN)
    return SmoothRamp(times=(out, out + part, back, back + part), values=(RETRACTED, EXTENDED, EXTENDED, RETRACTED))


def errors(found: tuple, reference: tuple) -> np.ndarray:
    """NRMS of the tip, of all lines and of all pad forces."""
    (lines, forces), (full_lines, full_forces) = found, reference
    last = list(lines)[-1]
    pairs = [(lines[last][:, -1], full_lines[last][:, -1])]
    pairs += [(np.hstack(list(lines.values())), np.hstack(list(full_lines.values()))), (forces, full_forces)]
    return np.array([rms(a - b) / rms(b) for a, b in pairs])
