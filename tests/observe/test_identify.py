"""Identified parameters beside those that the frequencies were made of, and beside linear regression."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from pmr import InputError
from pmr.files.arrays import Array
from pmr.observe.identify import MeasuredFrequencies, identify

PLACES = (0.0, 0.2, 0.4, 0.6)


def strings(values: Mapping[str, float], places: Sequence[float]) -> Array:
    """Frequencies of a stretched string of which s is cut off: k / (2 (L - s)) sqrt(T / mu)."""
    length = values["length"] - np.asarray(places)[:, None]
    return np.asarray(np.arange(1, 4) / (2.0 * length) * np.sqrt(values["tension"] / 0.1))


def test_the_parameters_are_those_of_the_frequencies() -> None:
    exact = strings({"length": 1.3, "tension": 80.0}, PLACES)
    measured = [
        MeasuredFrequencies(s, tuple(f[: 3 if k else 2]), held_out=k == 3)
        for k, (s, f) in enumerate(zip(PLACES, exact, strict=True))
    ]
    found = identify(strings, {"length": 1.2, "tension": 100.0}, measured)
    np.testing.assert_allclose(found.values, [1.3, 80.0], rtol=1e-8)
    assert np.abs(found.held_out).max() < 1e-8 and np.abs(found.start[:, 0]).min() > 0.05
    assert np.isnan(found.fitted[0, 2]) and found.overrides()[0].startswith("length=1.")


def test_a_fit_that_ends_at_a_bound_is_named() -> None:
    exact = strings({"length": 1.3, "tension": 80.0}, PLACES)
    measured = [MeasuredFrequencies(s, tuple(f)) for s, f in zip(PLACES, exact, strict=True)]
    for start, value in ((2.0, 40.0), (3000.0, 150.0)):  # 80 is more than 20 times, or less than a twentieth, of these
        fit = identify(strings, {"length": 1.3, "tension": start}, measured)
        assert fit.bounded == ("tension",) and fit.values[1] == pytest.approx(value, rel=1e-3)
    assert identify(strings, {"length": 1.3, "tension": 4.1}, measured).bounded == ()


def test_standard_errors_are_those_of_regression() -> None:
    """ln f is linear in ln T and, with one length, nothing else: its deviation is that of a mean."""
    rng, sigma = np.random.default_rng(1), 0.004

    def scaled(values: Mapping[str, float], places: Sequence[float]) -> Array:
        return strings({"length": 1.3, "tension": values["tension"]}, places)

    exact = scaled({"tension": 80.0}, PLACES)
    off = exact * np.exp(sigma * rng.standard_normal(exact.shape))
    measured = [MeasuredFrequencies(s, tuple(f), deviation=sigma) for s, f in zip(PLACES, off, strict=True)]
    found = identify(scaled, {"tension": 90.0}, measured)
    mean = np.mean(np.log(off / exact))
    spread = max(1.0, np.std(np.log(off / exact), ddof=1) / sigma)
    np.testing.assert_allclose(np.log(found.values[0] / 80.0), 2.0 * mean, rtol=0.02)
    np.testing.assert_allclose(found.errors[0], 80.0 * 2.0 * sigma * spread / np.sqrt(exact.size), rtol=0.02)


def test_what_frequencies_do_not_tell_has_an_infinite_error() -> None:
    def blind(values: Mapping[str, float], places: Sequence[float]) -> Array:
        return strings({"length": 1.3, "tension": values["tension"]}, places)

    measured = [MeasuredFrequencies(0.0, (10.0, 20.0, 30.0))]
    found = identify(blind, {"tension": 90.0, "colour": 1.0}, measured)
    assert np.isinf(found.errors).tolist() == [False, True]


def test_wrong_measurements_are_refused() -> None:
    good = MeasuredFrequencies(0.0, (10.0, 20.0))
    for start, measured in (
        ({"length": 0.0, "tension": 1.0}, [good]),
        ({"length": 1.3, "tension": 1.0}, []),
        ({"length": 1.3, "tension": 1.0}, [MeasuredFrequencies(0.0, (10.0, 20.0), held_out=True)]),
        ({"length": 1.3, "tension": 1.0}, [MeasuredFrequencies(0.0, (-10.0, 20.0))]),
        ({}, [good]),
    ):
        with pytest.raises(InputError, match="identify"):
            identify(strings, start, measured)
    with pytest.raises(InputError, match=r"identify: deviation = 0\.0: more than 0 is allowed"):
        MeasuredFrequencies(0.0, (10.0, 20.0), deviation=0.0)
