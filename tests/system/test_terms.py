"""Terms that vary in time, as data: what they are on other coordinates, in a file, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from nested import Nested, reduced

from pmr.errors import InputError
from pmr.export.formats import Options, write
from pmr.scene.signals import Constant, Sine
from pmr.simulation.excitation import Excitation
from pmr.simulation.native.stepper import Stepper
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System
from pmr.system.terms import Term


@pytest.fixture(scope="module")
def system() -> System:
    return reduced(Nested(2, elements=10), 2)


def matrix(*bodies: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).normal(size=(sum(bodies), sum(bodies)))


def of(system: System, *names: str) -> tuple[int, ...]:
    return tuple(system.bodies[name].size for name in names)


def test_a_term_moves_to_other_coordinates_and_among_others() -> None:
    """V^T G V of two bodies, with rows and columns where the coordinates stand; what is left out is zero."""
    term = Term("cylinder", ("b", "a"), stiffness=sp.csr_matrix(matrix(2, 3)), damping=matrix(2, 3, seed=1))
    V = {"b": matrix(2)[:, :1], "a": matrix(3)[:, :2]}
    both = np.block([[V["b"], np.zeros((2, 2))], [np.zeros((3, 1)), V["a"]]])
    np.testing.assert_allclose(term.project(V).stiffness, both.T @ matrix(2, 3) @ both, atol=1e-13)
    found = term.scatter({"a": [0, -1, 2], "b": [4, 3]}, 6).damping.toarray()
    at = [4, 3, 0, 2]
    expected = np.zeros((6, 6))
    expected[np.ix_(at, at)] = matrix(2, 3, seed=1)[np.ix_([0, 1, 2, 4], [0, 1, 2, 4])]
    np.testing.assert_array_equal(found, expected)


def test_a_file_keeps_terms(system: System, tmp_path: Path) -> None:
    one = Term("N", ("1",), stiffness=matrix(*of(system, "1")))
    two = Term("turning", ("0", "1"), damping=matrix(*of(system, "0", "1")))
    sparse = replace(one, stiffness=sp.csr_matrix(one.stiffness))  # as those of a cylinder are
    found = System.load(replace(system, terms=(sparse, two)).save(tmp_path / "system.npz")).terms
    assert [(term.name, term.bodies) for term in found] == [("N", ("1",)), ("turning", ("0", "1"))]
    np.testing.assert_array_equal(found[0].stiffness, one.stiffness)
    np.testing.assert_array_equal(found[1].damping, two.damping)
    assert found[0].damping is None and found[1].stiffness is None


def test_amplitudes_follow_the_names_of_terms() -> None:
    """At the steps and at parts of them; one without a signal, or a signal without a term, is refused."""
    terms = {"b": Constant(amount=2.0), "a": Sine(amplitude=3.0, frequency=0.5)}
    excitation = Excitation({}, {}, TimeStepping(1.0, 0.25), terms=terms)
    np.testing.assert_allclose(excitation.amplitudes(("a", "b"))[:, 1], 2.0)
    fine = excitation.with_stepping(excitation.stepping.divide(2))
    np.testing.assert_allclose(fine.amplitudes(("a", "b"))[::2], excitation.amplitudes(("a", "b")), atol=1e-15)
    for names in (("a",), ("a", "b", "c")):
        with pytest.raises(InputError, match="terms.*b, a given, one for each term is allowed"):
            excitation.amplitudes(names)


def test_what_knows_no_terms_refuses_them(system: System, tmp_path: Path) -> None:
    """From one place: a step from outside, and files for other programs."""
    varying = replace(system, terms=(Term("N", ("1",), stiffness=np.eye(*of(system, "1"))),))
    file = varying.save(tmp_path / "system.npz")
    with pytest.raises(InputError, match="stepper: terms = 'N'.*without terms that vary in time"):
        Stepper(varying, 1e-3, 1.0)
    for to in ("exudyn", "matlab"):
        with pytest.raises(InputError, match="system.npz: terms = 'N'.*without terms that vary in time"):
            write(to, file, None, Options())
    with pytest.raises(InputError, match="a file that contains its scene is allowed"):  # which says what drives them
        write("fmu", file, None, Options())


def test_terms_that_make_no_sense_are_refused(system: System) -> None:
    n = of(system, "0")[0]
    with pytest.raises(InputError, match="terms.N.bodies = '2'.*0, 1 are allowed"):
        replace(system, terms=(Term("N", ("2",), np.eye(n)),))
    with pytest.raises(InputError, match=f"terms.N.stiffness.*{n}, {n}"):
        replace(system, terms=(Term("N", ("0",), np.eye(n + 1)),))
    with pytest.raises(InputError, match=r"terms.N.damping.*finite"):
        replace(system, terms=(Term("N", ("0",), damping=np.full((n, n), np.nan)),))
    with pytest.raises(InputError, match=r"terms.N.name.*differ"):
        replace(system, terms=(Term("N", ("0",), np.eye(n)),) * 2)
    with pytest.raises(InputError, match="one body or two that differ"):
        Term("N", ("0", "0"), np.eye(2 * n))
    with pytest.raises(InputError, match="a stiffness, a damping or both"):
        Term("N", ("0",))
