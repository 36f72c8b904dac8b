r"""How far a structural model is off, beside a richer one of the same bodies, pads and loads: a part of the budget.

Both are asked for what decides a slow motion, at the ends and in the middle of the path: static answers :math:`y_{oi}`
of outputs o to each load i by itself, all contacts closed, and the two lowest frequencies.  With a_i the largest
amplitude that load i has during the run, a kind of output (displacements, forces of pads) is off by

.. math::
    e = \frac{\lVert (y^{richer}_{oi} - y_{oi})\, a_i \rVert}{\lVert y^{richer}_{oi}\, a_i \rVert}

over all its outputs, all loads and all three places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.names import named
from pmr.simulation import Excitation
from pmr.simulation.excitation import places
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: Frequencies that are compared, and kinds of outputs, as numbers say.
FREQUENCIES, KINDS = 2, ("beam", "tip", "pad_force", "cylinder_force", "support_force")
#: Of the largest answer: a kind that is less is nothing.
NOTHING = 1e-12
#: What is not compared.
NOT_COVERED = (
    "stress, which pads, loads and corners decide where walls bend",
    "modes beyond the second one",
    "pads that open",
)


@dataclass(frozen=True)
class Answers:
    """Of one model at P places."""

    frequencies: Array  # (P, 2) Hz
    values: Mapping[tuple[int, str], Array]  # by kind and name: (P, i) for a unit of each load


def steps_of(excitation: Excitation) -> list[int]:
    """Those at which all paths together are shortest, longest, and nearest to the middle of both."""
    reach = excitation.s.reshape(len(excitation.times), -1).sum(axis=1)
    low, high = int(np.argmin(reach)), int(np.argmax(reach))
    middle = int(np.argmin(np.abs(reach - (reach[low] + reach[high]) / 2.0)))
    return sorted({low, middle, high}, key=lambda step: float(reach[step]))


def answers(system: System, excitation: Excitation) -> Answers:
    """Raises an `InputError` where contacts do not hold the bodies."""
    assembly, x = Assembly(system), places(system, excitation)[steps_of(excitation)]
    rows, known = assembly.along(x), list[tuple[int, str]]()
    for name, body in system.bodies.items():
        for output, kind in zip(body.output_names, body.output_kinds, strict=True):
            known.append((_kind(kind), named(name, output)))
    known += [(_kind(one.kind), one.name) for one in system.contacts]
    try:
        found = np.array([assembly.answers(rows.at(k), np.zeros(1))[0].real for k in range(len(x))])
    except np.linalg.LinAlgError:
        raise InputError("system", "contacts", None, "contacts that hold all bodies are allowed") from None
    values = {key: found[:, k] for k, key in enumerate(known) if key[0] >= 0}
    return Answers(assembly.frequencies(x, FREQUENCIES), values)


def compared(own: Answers, richer: Answers) -> Array:
    """What both have, as one array (own or richer, P, numbers): frequencies, then kind by kind each output's answers.

    Its first row of numbers says of what kind each is: -1 a frequency.
    """
    both = [key for key in own.values if key in richer.values]
    kinds = [-1.0] * FREQUENCIES + [float(kind) for kind, name in both for _ in own.values[kind, name][0]]
    rows = [np.hstack([one.frequencies, *(one.values[key] for key in both)]) for one in (own, richer)]
    return np.stack([np.tile(kinds, (len(rows[0]), 1)), *rows])


def model_part(scene: Scene, found: Array, richer: str, inputs: Sequence[str], amplitudes: Array) -> dict[str, Any]:
    """``budget.model`` of summary.json from what `compared` says, and the largest amplitude of each of the `inputs`."""
    kinds, own, other = found[0, 0], found[1], found[2]
    shares: dict[str, float | None] = {}
    for number, kind in enumerate(KINDS):
        of_kind = kinds == number
        if of_kind.any():
            a = np.tile(amplitudes, int(of_kind.sum()) // len(inputs))
            size = float(np.linalg.norm(other[:, of_kind] * a))
            off = float(np.linalg.norm((other - own)[:, of_kind] * a))
            shares[kind] = off / size if size > NOTHING else None
    f = {name: values[:, kinds < 0.0] for name, values in (("own", own), ("richer", other))}
    return {
        "beside": richer,
        **shares,
        "frequency": float(np.abs(f["own"] / f["richer"] - 1.0).max()),
        "frequencies": {name: values.tolist() for name, values in f.items()},
        "not_covered": [*NOT_COVERED, *["the terms of a moving frame"] * (scene.frame is not None)],
    }


def amplitudes_of(excitation: Excitation, inputs: Sequence[str]) -> Array:
    """The largest amplitude of each input during the run."""
    return np.asarray(np.abs(excitation.forces(tuple(inputs))).max(axis=0))


def _kind(kind: str) -> int:
    """Its number; -1 of what is not compared."""
    called = kind.split(" ")[0]
    called = called if called in KINDS else f"{called}_force"
    return KINDS.index(called) if called in KINDS else -1
