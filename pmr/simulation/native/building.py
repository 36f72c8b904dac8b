"""From a system and the lengths of its steps to the arrays of the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.model import ReducedModel
from pmr.simulation import contact_step
from pmr.simulation.native.arrays import Z_NEXT, Divided, Scheme, State, Tables, V
from pmr.simulation.native.contact import contact, without
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import words_of
from pmr.simulation.native.levels import Control, Levels
from pmr.simulation.native.linking import link
from pmr.simulation.native.part import Loop
from pmr.simulation.native.quasi_static import quasi_static
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.side_arrays import bodies, sides
from pmr.simulation.native.simd import aligned
from pmr.simulation.native.tables import shares, tables
from pmr.simulation.native.term_arrays import Matrices, terms

Array = NDArray[np.float64]


def loop_of(
    form: SystemForm,
    methods: Sequence[GeneralizedAlpha],
    parts: Sequence[int],
    omega: float,
    paths: Sequence[str],
    of_terms: Sequence[Matrices],
) -> Loop:
    """A loop at rest, whose steps are made in so many `parts`, by the `methods` of each, on `paths` by their names.

    `omega` in rad/s is that of contacts that only push (`pmr.simulation.contact_step`), `of_terms` the matrices of
    the terms' signals (`pmr.simulation.native.term_arrays.signals`).
    """
    system, schemes = form.modal, [method.scheme() for method in methods]
    body = form.on_tables
    of_levels = [] if body is None else _tables(form, body, schemes)
    constants = bodies(form, paths) if body is None else None
    memory = methods[0].memory()
    pushing = contact(system.clearance, memory)
    found, still = terms(form, of_terms, paths), quasi_static(form)
    lean = body is not None and pushing is None and not len(found.force) and not len(still.numbers)
    state = form.state(schemes[0], None if lean else pushing or without(memory), shares(body))
    loop = Loop(
        modes=form.modes,
        divided=form.divided(schemes[0]),
        scheme=schemes[0],
        tables=None if body is None else of_levels[0]._replace(constant_rows=min(t.constant_rows for t in of_levels)),
        bodies=constants,
        sides=None if constants is None else sides(constants, len(paths)),
        state=state,
        levels=None,
        control=None,
        terms=found,
        quasi_static=still,
    )
    if lean:
        return loop._replace(terms=None, quasi_static=None)
    linked = _on_levels(loop._replace(control=_control(state, omega)), form, methods, parts, of_levels)
    link(linked)
    return linked


def _tables(form: SystemForm, body: ReducedModel, schemes: Sequence[Scheme]) -> list[Tables]:
    """Made once: those of a full model take longer than its steps."""
    new = [scheme for scheme in schemes if scheme not in form.tables]
    if new:
        form.tables.update(zip(new, tables(form, body, new), strict=True))
    return [form.tables[scheme] for scheme in schemes]


def _on_levels(
    loop: Loop,
    form: SystemForm,
    methods: Sequence[GeneralizedAlpha],
    parts: Sequence[int],
    of_levels: Sequence[Tables],
) -> Loop:
    """With levels, each of which has a loop of its own that differs in constants alone."""
    schemes = [method.scheme() for method in methods]
    divided = [form.divided(scheme) for scheme in schemes]
    couplings = np.array([one.couplings for one in of_levels]) if of_levels else np.zeros((len(schemes), 0, 0, 0, 0))
    levels = Levels(
        parts=np.array(parts, np.int64),
        loops=np.zeros((len(parts), 0), np.int64),
        modes=aligned(np.array([form.constant_modes(scheme) for scheme in schemes])),
        B=aligned(np.array([one.B for one in divided])),
        damped=aligned(np.array([one.damped for one in divided])),
        couplings=aligned(couplings),
        calls=np.zeros(3, np.int64),
    )
    size = len(words_of(loop._replace(levels=levels)))
    levels = levels._replace(loops=np.zeros((len(parts), size), np.int64))
    loop, contact = loop._replace(levels=levels), loop.state.contact
    assert contact is not None
    for k, (method, scheme) in enumerate(zip(methods, schemes, strict=True)):
        own = loop._replace(
            divided=Divided(levels.B[k], levels.damped[k]),
            scheme=scheme,
            tables=None if loop.tables is None else loop.tables._replace(couplings=levels.couplings[k]),
            state=loop.state._replace(contact=contact._replace(memory=method.memory())),
        )
        levels.loops[k] = words_of(own)
    return loop


def _control(state: State, omega: float) -> Control:
    """Before the first step, which begins on the first level."""
    m, r = len(state.multipliers), state.modes.shape[1]
    return Control(
        level=np.zeros(1, np.int64),
        active=np.zeros(1, np.int64),
        came=np.full(1, -1),
        bounds=np.array([contact_step.TOLERANCE, omega, 0.0]),
        acceleration=aligned(np.zeros((2, r))),
        began=aligned(np.zeros((V + 1 - Z_NEXT, r))),
        began_forces=np.zeros((3, m)),
        began_closed=np.zeros(m, np.bool_),
        began_energy=np.zeros(3),
        closed=np.zeros(m, np.bool_),
        force=np.zeros(m),
    )
