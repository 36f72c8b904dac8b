from __future__ import annotations

import numpy as np
import pytest
from textbook import CLOSED_FORM, EI, LENGTH, RHO_A, TIP_DEFLECTION, static_tip_deflection

from pmr.compare.frequencies import bending_frequencies


@pytest.mark.parametrize("s", CLOSED_FORM)
def test_the_lowest_frequencies(s: float) -> None:
    assert bending_frequencies(s, LENGTH, EI, RHO_A, 3) == pytest.approx(CLOSED_FORM[s], rel=1e-9)


def test_supported_at_its_end_the_beam_is_the_simply_supported_one() -> None:
    n = np.arange(1, 13)
    assert bending_frequencies(5.0, LENGTH, EI, RHO_A, 12) == pytest.approx(
        (n * np.pi / 5.0) ** 2 * np.sqrt(EI / RHO_A)
    )


def test_a_support_close_to_the_pin_makes_a_cantilever() -> None:
    assert bending_frequencies(1e-6, 1.0, 1.0, 1.0, 2) == pytest.approx(np.array([1.8751041, 4.6940911]) ** 2, rel=1e-4)


def test_many_roots_none_lost() -> None:
    """Root n lies between those of the beam with one support fewer and one more: spacing of beta L about pi."""
    beta = np.sqrt(bending_frequencies(2.2, 5.0, 1.0, 1.0, 40)) * 5.0
    assert np.all(np.diff(beta) < 1.7 * np.pi) and beta[-1] == pytest.approx(40 * np.pi, abs=np.pi)


@pytest.mark.parametrize("s", [0.0, 5.1, -1.0])
def test_a_support_off_the_beam_is_refused(s: float) -> None:
    with pytest.raises(ValueError, match="allowed are 0 < s <= 5 m"):
        bending_frequencies(s, LENGTH, EI, RHO_A, 1)


@pytest.mark.parametrize("s", TIP_DEFLECTION)
def test_static_tip_deflection(s: float) -> None:
    assert static_tip_deflection(-50.0, s, LENGTH, EI) == pytest.approx(TIP_DEFLECTION[s], rel=1e-12)
