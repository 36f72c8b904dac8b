r"""Outputs of a system as inputs without load: what such an input moves is what is observed.

.. math:: y = O q + O R B f - O R C^T \lambda

has the form of what loads move, :math:`B^T q + B^T R B f - H^T \lambda`, which the compiled steps of a system know for
their balance of energy; so a step that is to be observed needs no tables of its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmr.reduced.model import ReducedModel
from pmr.scene.names import named
from pmr.system.system import System


def output_names(system: System) -> tuple[str, ...]:
    """Of all bodies' outputs, in their order."""
    return tuple(
        named(name, one)
        for name, body in system.bodies.items()
        for one in body.output_names or tuple(f"output {k}" for k in range(len(body.output_positions)))
    )


def with_outputs_as_inputs(system: System) -> System:
    """The system of reduced bodies with an input for each output, behind those of its body."""
    return replace(system, bodies={name: _with_inputs(body) for name, body in system.reduced.items()})


def _with_inputs(body: ReducedModel) -> ReducedModel:
    carriers, outputs = body.carriers, body.outputs
    if carriers is not None and (known := carriers.flexibility) is not None:
        o = len(outputs)
        flexibility = replace(
            known,
            inputs=np.hstack([known.inputs, known.outputs.T]),
            outputs=known.outputs,
            direct=np.hstack([known.direct, np.zeros((o, o))]),
            energy=np.block([[known.energy, known.direct.T], [known.direct, np.zeros((o, o))]]),
        )
        carriers = replace(carriers, flexibility=flexibility)
    names = tuple(f"output {k}" for k in range(len(outputs)))
    return replace(body, B=np.hstack([body.B, outputs.T]), input_names=(*body.input_names, *names), carriers=carriers)
