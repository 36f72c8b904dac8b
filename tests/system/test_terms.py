"""Terms that vary in time, as data: what they are on other coordinates, in a file, and what is refused.

Modes without inertia: what terms do to the part that a basis leaves out, at rest and in motion.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from nested import Nested, box, full_section, joined, reduced, section
from terms import geometric_stiffness

from pmr import InputError, ReducedModel, Stepper, System
from pmr.export.formats import Options, write
from pmr.files.arrays import Array
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.signals import Constant, Sine
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.attachment import simulated_model, with_quasi_static_modes
from pmr.system.body import SlidingBody
from pmr.system.terms import Term
from pmr.system.truncation import truncate


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


BOOM = Nested(2, elements=4)

#: Of the two sections, which have 8 and 10 coordinates in all: all modes but one, which leaves a flexibility.
KEPT = (7, 9)


@cache
def _modes(number: int) -> tuple[ReducedModel, Array]:
    """A section on nearly all of its modes, and these; as few as possible of them remain coordinates."""
    one, count = box(number, number == 1, BOOM.elements), KEPT[number]
    basis = modal_basis(free_modes(section(one), count))
    found = section_model(FreeBody(section(one)), basis, {}, count)
    return found, np.array(basis.V.getDenseArray())


def _pressed(bodies: list[SlidingBody], modes: list[Array | None]) -> System:
    """Under the same compression, full or on modes that the matrices are projected on."""
    system, terms = joined(BOOM, bodies), []
    for (name, body), V, number in zip(system.bodies.items(), modes, range(2), strict=True):
        x = np.linspace(0.0, box(number, False, 4).length, BOOM.elements + 1)
        G = geometric_stiffness(x, np.full(BOOM.elements, -1e5))
        G = G if V is None else V[:, : body.size].T @ G @ V[:, : body.size]
        terms.append(Term(f"N {name}", (name,), stiffness=G))
    return replace(system, terms=tuple(terms))


def _reduced(size: int, still: int) -> System:
    """On so many elastic modes, with so many without inertia."""
    found = [_modes(number) for number in range(2)]
    models = [truncate(model, size + 2 * number) for number, (model, _) in enumerate(found)]
    return _pressed([with_quasi_static_modes(one, still) if still else one for one in models], [V for _, V in found])


def _tip(system: System, c: float) -> float:
    """Of the boom half drawn out under its weight and a load, by amplitudes c of all terms."""
    assembly, f = Assembly(system), np.array([9.81, 9.81, 1000.0])
    s = {name: 0.5 * sum(ends) for name, ends in system.ranges.items()}
    rows = assembly.contact_rows(x := system.side_coordinates(s))
    found = equilibrium(assembly, x, f, np.full(len(system.terms), c))
    y = assembly.outputs @ found.q + assembly.direct @ f - rows.X @ found.forces
    return float(y[-1])


def test_with_all_modes_kept_statics_under_terms_are_those_of_full_order() -> None:
    """But for the one mode that is left to residual flexibility; without any kept they are off by O(c)."""
    full = _pressed([full_section(box(k, k == 1, 4)) for k in range(2)], [None, None])
    exact = {c: _tip(full, c) for c in (0.0, 0.5, 1.0)}
    assert abs(exact[1.0] / exact[0.0] - 1.0) > 0.02  # there is something to miss
    complete, two, none = (_reduced(2, still) for still in (5, 2, 0))
    assert _tip(none, 0.0) == pytest.approx(exact[0.0], rel=1e-9)
    off = {c: [abs(_tip(one, c) / exact[c] - 1.0) for one in (complete, two, none)] for c in (0.5, 1.0)}
    assert off[1.0][2] / off[0.5][2] == pytest.approx(2.0, rel=0.2)
    assert off[1.0][0] < off[1.0][1] < 0.1 * off[1.0][2]
    assert off[1.0][0] < 1e-2 * off[1.0][2]  # which is the last mode's


def test_they_are_enrichment_modes_behind_the_model_s_own() -> None:
    model = truncate(_modes(1)[0], 4)
    found = simulated_model(model, True)
    assert found.quasi_static.tolist() == [4, 5] and found.size == 6
    assert simulated_model(model, False).size == 4
    stiff = replace(model, enrichment=None)
    assert simulated_model(stiff, True).size == 4  # nothing is known beyond its own


@pytest.mark.parametrize("wrong", [[6], [-1], [4, 4]])
def test_a_file_that_names_others_is_refused(wrong: list[int]) -> None:
    found = simulated_model(truncate(_modes(1)[0], 4), True)
    assert found.contradiction() is None
    assert "quasi_static" in str(replace(found, quasi_static=np.array(wrong)).contradiction())


def test_they_keep_their_place_in_a_file(tmp_path: object) -> None:
    found = simulated_model(truncate(_modes(1)[0], 4), True)
    read = ReducedModel.load(found.save(f"{tmp_path}/reduced.npz"))
    np.testing.assert_array_equal(read.quasi_static, found.quasi_static)
