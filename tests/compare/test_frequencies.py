from __future__ import annotations

import numpy as np
import pytest
from alone import frequencies
from oracle import flexible, full_body
from scipy.interpolate import PPoly
from textbook import CLOSED_FORM, EI, LENGTH, RHO_A, TIP_DEFLECTION, static_tip_deflection

from pmr.compare.frequencies import bending_frequencies, closed_form_frequencies
from pmr.system.reduced_model import ReducedModel


def test_reduced_frequencies_are_those_of_the_held_system() -> None:
    """Three masses of 1 kg on springs of 1, 4 and 9 N/m; the row holds one after the other."""
    I, c = np.eye(3), np.zeros((2, 2, 1, 3))
    c[0, :, 0], c[1, :, 0] = np.diff(I, axis=0), I[:2]
    rows = PPoly(c, [0.5, 1.5, 2.5])
    model = ReducedModel(I, 0 * I, np.diag([1.0, 4.0, 9.0]), I[:, :1], I, rows, ("F",), ("slider",), np.arange(3.0))
    found = 2.0 * np.pi * frequencies(model, np.array([0.5, 1.5, 2.5]), 3)
    assert found[:, :2] == pytest.approx(np.array([[2.0, 3.0], [1.0, 3.0], [1.0, 2.0]]))
    assert np.all(np.isnan(found[:, 2]))


def test_rows_that_give_way_are_springs() -> None:
    """Two free masses of 1 kg, one on a pad of 25 N/m, the other held."""
    c = np.zeros((1, 1, 2, 2))
    c[0, 0] = np.eye(2)
    I = np.eye(2)
    model = ReducedModel(
        I, 0 * I, 0 * I, I[:, :1], I, PPoly(c, [0.0, 1.0]), ("F",), ("pad", "pin"), np.arange(2.0),
        pads=np.array([1.0 / 25.0, 0.0]),
    )  # fmt: skip
    assert 2.0 * np.pi * frequencies(model, np.array([0.5]), 1) == pytest.approx(np.array([[5.0]]))


def test_frequencies_of_a_model_with_residual_flexibility_are_those_of_the_full_one() -> None:
    s = np.array([1.25, 2.45, 3.7])
    model = flexible(full_body(elements=40), 10)
    omega = 2.0 * np.pi * frequencies(model, s, 2)
    assert omega[0] == pytest.approx(CLOSED_FORM[1.25][:2], rel=1e-5)
    assert np.isfinite(omega).all()


def test_closed_form_where_there_is_one(load_scene) -> None:
    s = np.array([1.25, 2.5])
    bar = np.pi / 10.0 * np.sqrt(2e7 / 78.0)  # between the third and the fourth of bending
    assert closed_form_frequencies(load_scene(), s, 4)[0, 3] == pytest.approx(bar)
    assert closed_form_frequencies(load_scene(), s, 3) == pytest.approx(np.array([CLOSED_FORM[1.25], CLOSED_FORM[2.5]]))
    for change in ("supports=[{on=0.0,kind='clamped'}]", "slider.offsets=[0.0,0.1]"):
        scene = load_scene("paper_simple", [change, "compare.against=[]", "reduction.coordinates=25"])
        assert closed_form_frequencies(scene, s, 3).shape == (2, 0)


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
