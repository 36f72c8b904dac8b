import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from pmr.scene.signals import Chirp, Constant, Ramp, Signal, Sine, SmoothRamp, Step, Sum, Table

signal = TypeAdapter(Signal)

SMOOTH_BETWEEN_BREAKS = [
    Ramp(times=(1.0, 2.0, 4.0), values=(0.5, 3.0, -1.0)),
    SmoothRamp(times=(1.0, 2.0, 4.0), values=(0.5, 3.0, -1.0)),
    Step(time=2.0, before=1.0, after=-3.0),
    Sine(amplitude=2.0, frequency=1.7, phase=0.3, offset=-0.4),
    Chirp(amplitude=5.0, times=(0.5, 2.0, 4.5), frequencies=(1.0, 4.0, 2.0), phase=0.1),
    Table(times=(0.0, 1.0, 1.5, 3.0, 4.0), values=(0.0, 1.0, -1.0, 2.0, 0.5)),
    Table(times=(0.0, 1.0, 1.5, 3.0), values=(0.0, 1.0, -1.0, 2.0), interpolation="linear"),
    Sum(terms=(Sine(amplitude=1.0, frequency=2.0), Ramp(times=(0.0, 3.0), values=(0.0, 6.0)))),
    signal.validate_python(-50),
]


@pytest.mark.parametrize("s", SMOOTH_BETWEEN_BREAKS, ids=lambda s: s.kind)
def test_rate_is_the_derivative_of_the_value_between_breaks(s: Signal) -> None:
    h = 1e-6
    t = np.linspace(-0.5, 5.0, 1001)
    away = np.all(np.abs(t[:, None] - np.array([*s.breaks, 1e9])) > 2.0 * h, axis=1)
    central = (s.value(t + h) - s.value(t - h)) / (2.0 * h)
    assert np.abs(central - s.rate(t))[away].max() < 1e-5
    assert s.value(t).shape == s.rate(t).shape == t.shape


@pytest.mark.parametrize("s", SMOOTH_BETWEEN_BREAKS, ids=lambda s: s.kind)
def test_a_scalar_time_gives_the_same_as_an_array(s: Signal) -> None:
    t = np.array([0.0, 1.0, 2.0, 2.5, 4.0])
    assert np.array_equal([float(s.value(x)) for x in t], s.value(t))
    assert np.array_equal([float(s.rate(x)) for x in t], s.rate(t))


def test_smooth_ramp_starts_and_ends_at_rest_with_no_acceleration() -> None:
    s = SmoothRamp(times=(1.0, 3.0), values=(2.0, 5.0))
    assert np.allclose(s.value([0.0, 1.0, 2.0, 3.0, 9.0]), [2.0, 2.0, 3.5, 5.0, 5.0])
    assert np.abs(s.rate([1.0, 1.0 + 1e-9, 3.0 - 1e-9, 3.0])).max() < 1e-6
    h = 1e-4
    assert abs(s.rate(1.0 + h)) / h < 0.1  # an acceleration of 3 m / (2 s)^2 would show as 0.75


def test_chirp_keeps_its_phase_where_the_sweep_turns() -> None:
    s = Chirp(amplitude=50.0, times=(0.0, 7.5, 15.0), frequencies=(1.0, 10.0, 1.0))
    assert abs(s.value(7.5 - 1e-9) - s.value(7.5 + 1e-9)) < 1e-4
    assert s.frequency(3.75) == pytest.approx(5.5)
    # 41.25 cycles by the turn (the mean of 1 and 10 Hz over 7.5 s), hence a crest there
    assert float(s.value(7.5)) == pytest.approx(50.0, rel=1e-12)
    ascending = 50.0 * np.sin(2.0 * np.pi * (3.0 + 9.0 / 15.0 * 3.0**2))
    assert float(s.value(3.0)) == pytest.approx(ascending, rel=1e-12)


def test_step_takes_its_new_value_at_its_time() -> None:
    s = Step(time=1.0, before=2.0, after=3.0)
    assert s.value([0.999, 1.0, 1.001]).tolist() == [2.0, 3.0, 3.0]


def test_table_from_a_file_equals_the_inline_one(tmp_path) -> None:
    file = tmp_path / "path.csv"
    file.write_text("# t, s\n0, 1\n1, 2\n3, 1.5\n", encoding="utf-8-sig")  # as spreadsheets write it
    assert signal.validate_python({"kind": "table", "file": str(file)}) == Table(
        times=(0.0, 1.0, 3.0), values=(1.0, 2.0, 1.5)
    )


def test_an_evaluated_table_still_equals_another() -> None:
    one, other = (Table(times=(0.0, 1.0, 3.0), values=(1.0, 2.0, 1.5)) for _ in range(2))
    assert one.value(0.5) == one.value([0.5, 2.0])[0]
    assert one == other and hash(one) == hash(other)
    assert one.model_dump() == other.model_dump()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "at least two lines"),
        ("0, 1\n", "at least two lines"),
        ("0\n1\n", "two columns"),
        ("t, s\n0, 1\n1, 2\n", "other lines begin with #"),
        ("# t, s\n\n0, 1\n1, nan\n", "line 4 is not finite"),
        ("0, 1\n0, 2\n", "times must increase"),
        ("0, 1\n1e-300, 4\n1, 1\n", "times must increase, by at least 1e-12 s"),
    ],
)
def test_a_file_that_is_no_table_is_refused_by_name(tmp_path, text: str, says: str) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(ValidationError) as caught:
        signal.validate_python({"kind": "table", "file": str(file)})
    assert says in str(caught.value) and "path.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({"kind": "table", "file": "nowhere.csv"}, "no such file"),
        ({"kind": "ramp", "times": [0, 0], "values": [1, 2]}, "increase"),
        ({"kind": "table", "times": [0, 1e-300, 1], "values": [1, 4, 1]}, "increase, by at least 1e-12 s"),
        ({"kind": "smooth_ramp", "times": [0, 5e-324, 1], "values": [1, 4, 1]}, "increase, by at least 1e-12 s"),
        ({"kind": "ramp", "times": [0, 1], "values": [1, 2, 3]}, "2 times but 3 values"),
        ({"kind": "ramp", "times": [0, 1], "values": [1, float("nan")]}, "finite"),
        ({"kind": "chirp", "amplitude": 1, "times": [0, 1], "frequencies": [-1, 2]}, "negative"),
        ({"kind": "sine", "amplitude": 1, "frequency": 1, "phse": 0}, "Extra"),
        ({"kind": "spline"}, "spline"),
    ],
)
def test_what_is_no_signal_is_refused(data: dict, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        signal.validate_python(data)


@pytest.mark.parametrize("s", SMOOTH_BETWEEN_BREAKS, ids=lambda s: s.kind)
@pytest.mark.parametrize(("start", "end"), [(0.0, 5.0), (1.2, 1.3), (2.0, 2.0), (3.9, 9.0)])
def test_bounds_hold_everywhere_and_are_met(s: Signal, start: float, end: float) -> None:
    low, high = s.bounds(start, end)
    fine = s.value(np.linspace(start, end, 100_001))
    assert low <= fine.min() + 1e-6 and high >= fine.max() - 1e-6  # a sum is sampled, too
    breaks = [b for b in s.breaks if start <= b <= end]  # what comes before a break counts
    met = np.concatenate([fine, s.value(np.nextafter(breaks, -np.inf))]) if breaks else fine
    assert low >= met.min() - 1e-6 and high <= met.max() + 1e-6


@pytest.mark.parametrize("frequency", [1e3, 1e5, 1e9])
def test_bounds_see_what_no_grid_of_samples_does(frequency: float) -> None:
    """10 m at 100 kHz is nothing at any whole number of 10 microseconds."""
    fast = Sine(amplitude=10.0, frequency=frequency, offset=2.5)
    assert fast.bounds(0.0, 15.0) == (-7.5, 12.5)
    chirp = Chirp(amplitude=10.0, times=(0.0, 15.0), frequencies=(0.0, frequency))
    assert chirp.bounds(0.0, 15.0) == (-10.0, 10.0)
    low, high = Sum(terms=(fast, Ramp(times=(0.0, 15.0), values=(0.0, 1.0)))).bounds(0.0, 15.0)
    assert low == pytest.approx(-7.5, abs=0.01) and high == pytest.approx(13.5, abs=0.01)


def test_bounds_see_a_peak_between_the_samples() -> None:
    s = Ramp(times=(0.0, 1.0 / 3.0, 1.0), values=(0.0, 1.0, 0.0))
    assert s.bounds(0.0, 1.0) == (0.0, 1.0)
    pulse = Sum(terms=(Step(time=0.5, after=3.0), Step(time=0.5 + 1e-9, after=-3.0)))
    assert pulse.bounds(0.0, 1.0) == (0.0, 3.0)
    overshooting = Table(times=(0.0, 1.0, 1.5, 3.0), values=(0.0, 1.0, 1.0, 0.0))
    assert overshooting.bounds(0.0, 3.0)[1] > 1.01


@pytest.mark.parametrize("frequency", [0.05, 0.713, 40.0])
def test_bounds_of_a_sum_are_met_between_its_samples(frequency: float) -> None:
    """Two tones of one frequency are one, sqrt(a^2 + b^2), but for round-off of their angles of 2 pi f t at most."""
    a, b = 0.7, 0.4
    tones = Sine(amplitude=a, frequency=frequency), Sine(amplitude=b, frequency=frequency, phase=np.pi / 2.0)
    found = Sum(terms=(Constant(amount=3.0), *tones)).bounds(0.0, 60.0)
    atol = np.finfo(float).eps * (2.0 * np.pi * frequency * 60.0 + 16.0)
    np.testing.assert_allclose(found, [3.0 - np.hypot(a, b), 3.0 + np.hypot(a, b)], rtol=0.0, atol=atol)


def test_the_fastest_tone_within_a_time() -> None:
    chirp = Chirp(amplitude=5.0, times=(1.0, 2.0, 4.0), frequencies=(1.0, 9.0, 2.0))
    assert chirp.highest_frequency(0.0, 10.0) == 9.0 and chirp.highest_frequency(0.0, 1.5) == 5.0
    both = Sum(terms=(chirp, Sine(amplitude=1.0, frequency=3.0)))
    assert both.highest_frequency(4.0, 5.0) == 3.0 and len(both.parts) == 2
    assert Sine(amplitude=0.0, frequency=3.0).highest_frequency(0.0, 1.0) == 0.0
    assert Ramp(times=(0.0, 1.0), values=(0.0, 1.0)).highest_frequency(0.0, 1.0) == 0.0


def test_kinks_are_jumps_of_the_rate_that_a_smooth_ramp_has_none_of() -> None:
    """Not at the start, where what moves has moved before; a sum has those of its terms."""
    ramp = Ramp(times=(0.0, 1.0, 3.0), values=(1.0, 3.0, 2.0))
    assert ramp.kinks(4.0) == {1.0: pytest.approx(-2.5), 3.0: pytest.approx(0.5)}
    assert ramp.kinks(1.0) == {1.0: pytest.approx(-2.5)}
    assert SmoothRamp(times=(0.4166772, 0.8166772, 1.3), values=(1.9, 0.8, 0.9)).kinks(2.0) == {}
    assert Sum(terms=(Sine(amplitude=1.0, frequency=2.0), ramp)).kinks(2.0).keys() == {1.0}
    assert Sine(amplitude=1.0, frequency=2.0).kinks(2.0) == {}
