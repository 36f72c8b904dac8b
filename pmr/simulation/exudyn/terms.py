"""Terms that vary in time (`pmr.system.terms`) in Exudyn: an object of their own, whose matrices are set once a step.

Exudyn's generalized-alpha fulfils the equations at the end of the step, whose time the pre-step function is given; the
object's matrices join the Jacobian as those of any other do.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from exudyn.itemInterface import ObjectGenericODE2

from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.inputs import Inputs
from pmr.simulation.exudyn.items import SystemItems, add_pre_step_function, matrix


def with_terms(mbs: Any, items: SystemItems, equations: Equations, inputs: Inputs) -> SystemItems:
    """Add the object of the system's terms, if it has any."""
    if not equations.system.terms:
        return items
    assembly, sparse, known = equations.assembly, equations.sparse, inputs.amplitudes(0.0)

    def matrices(c: tuple[float, ...]) -> dict[str, Any]:
        entries = {
            "stiffnessMatrix": assembly.stiffness(c) - assembly.K,
            "dampingMatrix": assembly.damping(c) - assembly.D,
        }
        return {key: matrix(A if sparse else A.toarray()) for key, A in entries.items()}

    empty = matrix(0.0 * assembly.M if sparse else 0.0 * assembly.M.toarray())
    name = f"{mbs.GetMarker(items.mSystem)['name']}Terms"
    oTerms = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=list(items.nBodies.values()),
            massMatrix=empty,
            **matrices(known),
            jacobianUserFunction=lambda *arguments: empty,  # nothing beyond the matrices
        )
    )

    def vary(mbs: Any, t: float) -> bool:
        nonlocal known
        amplitudes = inputs.amplitudes(t)
        if amplitudes != known:
            known = amplitudes
            for key, value in matrices(amplitudes).items():
                mbs.SetObjectParameter(oTerms, key, value)
        return True

    def update(mbs: Any, t: float) -> bool:
        return items.update(mbs, t) and vary(mbs, t)

    add_pre_step_function(mbs, vary)
    return replace(items, oTerms=oTerms, update=update)
