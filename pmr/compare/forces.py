r"""How far the forces of two runs are apart, kind by kind.

.. math::
    e = \frac{\lVert f - r \rVert}{\max(\lVert r \rVert,\; 10^{-3} \max_k \lVert r_k \rVert)}

over all forces of a kind and all times; r_k are the forces of the other kinds in the same unit.  A kind that bears next
to nothing, such as a cylinder that holds still, is measured by what the others bear.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response

Array = NDArray[np.float64]

#: Forces, or moments, (T,) by kind and unit, such as ``("pad_force", "N")``, and by their names.
Histories = dict[tuple[str, str], dict[str, Array]]

#: Share of the largest kind's norm below which a kind of forces is measured by that share.
LITTLE = 1e-3
#: Units of forces and moments.
UNITS = ("N", "N m")


def histories(response: Response) -> Histories:
    """All forces of a response by kind, such as ``("pad_force", "N")`` or ``("reaction", "N m")``, and by name.

    Forces at the ends of steps; of pads that only push those are smaller than the peaks within steps.
    """
    forces = Histories()
    first = len(response.output_names)
    for number, output in enumerate(response.outputs):
        if output.is_force:
            values = response.slider_force[:, number - first]
            forces.setdefault((f"{output.kind}_force", "N"), {})[output.name] = values
        elif output.kind == "reaction" and output.unit in UNITS:
            forces.setdefault((output.kind, output.unit), {})[output.name] = response.column(number)
    return forces


def differences(
    forces: Mapping[tuple[str, str], Mapping[str, Array]], reference: Mapping[tuple[str, str], Mapping[str, Array]]
) -> dict[str, float]:
    """Errors by kind, fractions, of the forces that both have; the larger one where a kind has forces and moments.

    Kinds of which all forces of the reference are zero are left out.
    """
    pairs = dict[tuple[str, str], tuple[float, float]]()
    for key in (key for key in forces if key in reference):
        names = [name for name in forces[key] if name in reference[key]]
        if names:
            y, r = (np.array([of[key][name] for name in names]) for of in (forces, reference))
            scale = float(np.abs(r).max(initial=0.0)) or 1.0  # squares neither vanish nor overflow
            pairs[key] = scale * float(np.linalg.norm((y - r) / scale)), scale * float(np.linalg.norm(r / scale))
    errors = dict[str, float]()
    for (kind, unit), (apart, size) in pairs.items():
        largest = max(other for (_, of), (_, other) in pairs.items() if of == unit)
        if largest > 0.0:
            errors[kind] = max(errors.get(kind, 0.0), apart / max(size, LITTLE * largest))
    return errors
