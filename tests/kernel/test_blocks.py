"""Systems and states as bytes: what is damaged or not theirs is refused, what is saved goes on bit for bit.

Signals as the kernel evaluates them, beside themselves.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from kernels import kernel_of, unpack
from nested import Nested, reduced

from pmr import InputError, SimulationError
from pmr.kernel.blocks import LINE, pack, seal
from pmr.kernel.data import SystemData, system_data
from pmr.kernel.kernel import Kernel, Signals, checksum
from pmr.kernel.state import Record, Settings, State
from pmr.scene.signals import Chirp, Constant, Ramp, SignalBase, Sine, SmoothRamp, Step, Sum, Table
from pmr.simulation.frame_motion import Acceleration
from pmr.simulation.modal import modal_form

#: Of steps in parts, as forces of pads that push ask for.
SETTINGS = Settings(1e-3, 0.8, parts=(1, 2, 4, 8, 16), contact_omega=1e3)

STEPS = 60


@cache
def kernel() -> Kernel:
    return kernel_of(reduced(Nested(2, elements=8, clearance=2e-4, compliance=1e-7), 3))[0]


def signals(of: Kernel) -> Signals:
    """Out of the boom, lifted off its pads and let fall."""
    force = SmoothRamp(times=(0.0, 0.02, 0.04), values=(0.0, 2e4, 0.0))
    driven: list[SignalBase] = [Ramp(times=(0.0, 0.1), values=(2.0, 2.05))]
    driven += [force if name.endswith(".F") else Constant(amount=9.81) for name in of.names("drivers")[1:]]
    return Signals(driven)


def begun(of: Kernel) -> State:
    state = State(of, SETTINGS)
    state.start("equilibrium", signals(of).at(0.0)[0])
    return state


def advanced(state: State, steps: int) -> Record:
    record = Record(state.kernel, steps)
    state.advance(signals(state.kernel), steps, record)
    return record


def equal(one: Record, other: Record, first: int = 0) -> bool:
    """Whether all rows from one on are the same to the last bit."""
    arrays = [(one[name][first:], other[name]) for name in Record.FIELDS] + [(one.parts[first:], other.parts)]
    return all(a.tobytes() == b.tobytes() for a, b in arrays)


def test_a_state_that_is_restored_goes_on_bit_for_bit() -> None:
    """In another state of the same system, whatever that has been through."""
    whole = advanced(begun(kernel()), STEPS)
    assert len(set(whole.parts.tolist())) > 1 and np.any(whole["multipliers"] == 0.0)
    for at in (0, 17, 31):
        first, second = begun(kernel()), begun(kernel())
        if at:
            advanced(first, at)
        content = first.save()
        advanced(second, 5)
        second.restore(content)
        assert second.step_number == at
        assert equal(whole, advanced(second, STEPS - at), at)


def test_threads_share_a_system() -> None:
    """Each with a state of its own; all trajectories are the same to the last bit."""
    with ThreadPoolExecutor(4) as pool:
        records = list(pool.map(lambda _: advanced(begun(kernel()), STEPS), range(8)))
    assert all(equal(records[0], other) for other in records[1:])


def test_a_system_from_a_file_is_the_same(tmp_path: Path) -> None:
    (tmp_path / "system.pmr").write_bytes(kernel().block)
    assert equal(
        advanced(begun(kernel()), STEPS), advanced(begun(Kernel((tmp_path / "system.pmr").read_bytes())), STEPS)
    )


def damaged(content: bytes, rng: np.random.Generator, kind: int) -> bytes:
    """With some bits turned, cut short, longer, or with a stretch of other bytes."""
    changed = bytearray(content)
    at = int(rng.integers(len(content)))
    if kind == 0:
        changed[at] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        return bytes(changed[:at])
    elif kind == 2:
        return bytes(changed) + rng.bytes(int(rng.integers(1, 100)))
    else:
        stretch = rng.bytes(int(rng.integers(8, 64)))
        changed[at : at + len(stretch)] = stretch
        del changed[len(content) :]
    return bytes(changed)


def refused(read: Callable[[bytes], object], content: bytes, count: int) -> None:
    rng = np.random.default_rng(8)
    for k in range(count):
        wrong = damaged(content, rng, k % 4)
        if wrong != content:
            with pytest.raises(InputError):
                read(wrong)


def test_damaged_systems_are_refused() -> None:
    refused(Kernel, kernel().block, 300)


def test_damaged_states_are_refused_and_leave_the_state_as_it_is() -> None:
    state = begun(kernel())
    advanced(state, 20)
    content = state.save()
    refused(state.restore, content, 300)
    assert state.save() == content


def test_states_of_other_systems_and_settings_are_refused() -> None:
    content = begun(kernel()).save()
    other, _ = kernel_of(reduced(Nested(2, elements=10, clearance=2e-4, compliance=1e-7), 3))
    with pytest.raises(InputError, match="another system"):
        State(other, SETTINGS).restore(content)
    with pytest.raises(InputError, match="other settings"):
        State(kernel(), Settings(2e-3)).restore(content)


@cache
def data() -> SystemData:
    """Of three sections, the middle one of which two paths travel on."""
    system = reduced(Nested(3, elements=8), 3)
    return system_data(system, {name: modal_form(body) for name, body in system.bodies.items()})


def resealed(change: Callable[[dict[str, np.ndarray]], None]) -> bytearray:
    """The system's block with arrays changed, and a checksum that fits."""
    arrays = data().arrays
    copies = {name: array.copy() for name, array in arrays.items() if not isinstance(array, str)}
    change(copies)
    block = pack(arrays | copies)
    seal(block, checksum(block[LINE:]))
    return block


INTEGERS = ("sizes", "blocks", "pairs", "block_rows", "touched", "row_modes", "pushes", "first_entry", "first_pad")


@pytest.mark.parametrize("name", INTEGERS)
def test_numbers_that_lead_beyond_an_array_are_refused(name: str) -> None:
    """Although the checksum fits."""
    sound = unpack(bytes(resealed(lambda arrays: None)))
    assert Kernel(resealed(lambda arrays: None)).modes
    for value in (-1, 2**30):
        for at in range(min(12, len(sound[name]))):

            def change(arrays: dict[str, np.ndarray], value: int = value, at: int = at) -> None:
                arrays[name] = arrays[name].astype(np.int64)
                arrays[name].flat[at] = value

            with pytest.raises(InputError):
                Kernel(resealed(change))


def test_arrays_with_entries_are_needed_but_for_names() -> None:
    arrays = data().arrays
    for name in (name for name, array in arrays.items() if np.size(array) and not name.startswith("names_")):
        block = pack({other: array for other, array in arrays.items() if other != name})
        seal(block, checksum(block[LINE:]))
        with pytest.raises(InputError):
            Kernel(block)


def test_a_block_of_an_earlier_layout_is_refused() -> None:
    block = resealed(lambda arrays: None)
    block[:8] = b"PMRSYS2\n"
    with pytest.raises(InputError, match="no system that this kernel can read"):
        Kernel(block)


def test_what_is_no_number_is_refused() -> None:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays["omega2"] = np.full_like(arrays["omega2"], np.nan)

    with pytest.raises(InputError, match="omega2"):
        Kernel(resealed(change))


@pytest.mark.parametrize(
    "settings",
    [
        Settings(0.0), Settings(np.nan), Settings(1e-3, rho_inf=1.5), Settings(1e-3, parts=(2, 1)),
        Settings(1e-3, parts=(0,)), Settings(1e-3, parts=(1, 2), contact_omega=-1.0),
        Settings(1e-3, contact_omega=1.0, tolerance=0.0), Settings(1e-3, parts=tuple(range(1, 70))),
    ],
)  # fmt: skip
def test_settings_that_make_no_step_are_refused(settings: Settings) -> None:
    with pytest.raises(InputError):
        State(kernel(), settings)


def test_drivers_of_a_wrong_size_are_refused() -> None:
    state = begun(kernel())
    before = state.save()
    with pytest.raises(InputError, match="u"):
        state.step(np.zeros(2))
    with pytest.raises(SimulationError, match="finite"):
        state.step(np.full(kernel().drivers, np.nan))
    assert state.save() == before


def test_what_the_forces_asked_for_can_be_made_again_by_a_schedule() -> None:
    """Steps that begin anew are those in other parts than the one before, so the numbers of parts say all."""
    asked, again = advanced(begun(kernel()), STEPS), Record(kernel(), STEPS)
    state = State(kernel(), Settings(1e-3, 0.8, parts=SETTINGS.parts))
    state.start("equilibrium", signals(kernel()).at(0.0)[0])
    state.advance(signals(kernel()), STEPS, again, parts=asked.parts)
    assert equal(asked, again)
    with pytest.raises(SimulationError, match="parts"):
        state.advance(signals(kernel()), 1, again, parts=np.full(1, 3, np.int32))


def test_samples_and_signals_are_the_same_and_samples_say_when_they_are_too_few() -> None:
    expected, state = advanced(begun(kernel()), STEPS), begun(kernel())
    found, at, per = Record(kernel(), STEPS), 0, 1
    while at < STEPS:
        t = np.arange(at * per, STEPS * per + 1) * (1e-3 / per)
        taken, needed = state.advance_sampled(
            np.array([signals(kernel()).at(x)[0] for x in t.tolist()]), per, found, at
        )
        assert taken == STEPS - at or needed > per
        at, per = at + taken, needed
    np.testing.assert_array_equal(found.parts, expected.parts)
    for name in ("z", "multipliers", "outputs"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-10 * np.abs(expected[name]).max())


def test_parts_of_a_step_follow_rates_at_both_ends() -> None:
    """Hermite's cubics with rates, straight lines without, beside four steps to what stands between."""
    for led in (True, False):
        whole, fine = State(kernel(), Settings(1e-3, 0.8, parts=(4,))), State(kernel(), Settings(2.5e-4, 0.8))
        begun_at = np.array([2.0, *np.full(kernel().inputs, 9.81)])
        ended = begun_at + np.array([1e-3, *np.full(kernel().inputs, 3.0)])
        rates = np.array([np.full(kernel().drivers, 0.5), np.full(kernel().drivers, 4.0)])
        for state in (whole, fine):
            state.start("equilibrium", begun_at)
        whole.step(ended, rates if led else None)
        for k in range(1, 5):
            x = k / 4.0
            cubic = (3.0 * x**2 - 2.0 * x**3, (x - 2.0 * x**2 + x**3) * 1e-3, (x**3 - x**2) * 1e-3)
            along = cubic[0] * (ended - begun_at) + cubic[1] * rates[0] + cubic[2] * rates[1]
            fine.step(begun_at + (along if led else x * (ended - begun_at)))
        np.testing.assert_allclose(whole.z, fine.z, atol=1e-12 * np.abs(fine.z).max())


KNOTS = {"times": (0.5, 1.0, 2.5, 3.0), "values": (1.0, 4.0, -2.0, 0.5)}

SIGNALS = {
    "constant": Constant(amount=3.5),
    "ramp": Ramp(**KNOTS),
    "smooth": SmoothRamp(**KNOTS),
    "smoother": SmoothRamp(**KNOTS, degree=9),
    "akima": Table(**KNOTS),
    "linear": Table(**KNOTS, interpolation="linear"),
    "step": Step(time=1.25, before=-1.0, after=2.0),
    "sine": Sine(amplitude=2.0, frequency=1.5, phase=0.3, offset=-1.0),
    "chirp": Chirp(amplitude=50.0, times=(0.5, 1.5, 3.0), frequencies=(1.0, 10.0, 2.0), phase=0.2),
    "acceleration": Acceleration(paths=(Ramp(**KNOTS), SmoothRamp(**KNOTS)), step=1e-2),
    "sum": Sum(terms=(Ramp(**KNOTS), Sine(amplitude=2.0, frequency=1.5), Constant(amount=1.0))),
}

TIMES = np.concatenate([np.linspace(0.0, 4.0, 81), [0.5, 1.0, 1.25, 1.5, 2.5, 3.0]])


def test_values_and_rates_are_those_of_the_signals() -> None:
    """All at once, at breaks too, where the piece that begins there counts."""
    signals = Signals(list(SIGNALS.values()))
    found = [signals.at(t) for t in TIMES.tolist()]
    for k, (name, signal) in enumerate(SIGNALS.items()):
        second = np.zeros(len(TIMES)) if name == "acceleration" else signal.second_rate(TIMES)
        expected = np.array([signal.value(TIMES), signal.rate(TIMES), second])
        seen = np.array([signals_at_time[:, k] for signals_at_time in found]).T
        for one, other in zip(seen, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * np.abs(other).max() + 1e-14, err_msg=name)


def test_a_signal_that_is_no_sum_of_pieces_is_refused() -> None:
    class Other(Constant):
        kind: str = "other"  # type: ignore[assignment]

        @property
        def strands(self):  # type: ignore[no-untyped-def]
            return super(Constant, self).strands

    with pytest.raises(NotImplementedError, match="Other"):
        Signals([Constant(amount=1.0), Other(amount=2.0)])


@pytest.mark.parametrize("name", ["blocks", "pairs"])
def test_blocks_and_pairs_come_out_even(name: str) -> None:
    arrays = dict(data().arrays)
    arrays[name] = np.append(np.ravel(arrays[name]), np.int32(0)).astype(np.asarray(arrays[name]).dtype)
    block = pack(arrays)
    seal(block, checksum(block[LINE:]))
    with pytest.raises(InputError, match="damaged: blocks or pairs"):
        Kernel(block)
