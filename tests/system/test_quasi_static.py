"""Modes without inertia: what terms do to the part that a basis leaves out, at rest and in motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from nested import Nested, box, full_section, joined, section
from numpy.typing import NDArray
from terms import geometric_stiffness

from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.attachment import simulated_model, with_quasi_static_modes
from pmr.system.body import SlidingBody
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System
from pmr.system.terms import Term
from pmr.system.truncation import truncate

Array = NDArray[np.float64]
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
