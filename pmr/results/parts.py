"""Parts of a result: paths, loads, frequencies, and what is known of each body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmr.fields.series import Fields
from pmr.fields.stress import Envelope

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Paths:
    """Path coordinates and their rates over time: of a body alone that of its slider, else extensions of sections."""

    names: tuple[str, ...]  # (P,)
    values: Array  # (T, P) m
    rates: Array  # (T, P) m/s


@dataclass(frozen=True)
class Loads:
    """Loads on each input over time."""

    names: tuple[str, ...]  # (i,)
    units: tuple[str, ...]  # (i,)
    values: Array  # (T, i)


@dataclass(frozen=True)
class Shapes:
    """The basis as seen on the beam: singular values (k,) and the transverse shapes (o, r) at x (o,) m."""

    singular_values: Array
    x: Array
    shapes: Array


@dataclass(frozen=True)
class FrequencyMap:
    """First natural frequency (A, B) in Hz of a reduced boom over the extensions (A,) and (B,) in m of two joints."""

    joints: tuple[str, ...]
    first: Array
    second: Array
    lowest: Array


@dataclass(frozen=True)
class Frequencies:
    """Lowest natural frequencies in Hz with everything at rest, (S, f) by model.

    Models are ``reduced``, ``full`` and ``closed_form``, that of a uniform beam pinned at 0 with one slider; every
    contact is closed.  `along` is what `RunResult.along` is, `paths` the coordinates of all paths; `over_joints` is
    there where two joints move each on a path of its own.
    With second order the system is stressed as it is at the times `t`, (S,) s, when a run is there first.
    """

    along: Array  # (S,) m
    paths: Array  # (S, P) m
    models: Mapping[str, Array]
    over_joints: FrequencyMap | None = None
    t: Array | None = None


@dataclass(frozen=True)
class FrequencyResponse:
    """How far the tip moves under a sinusoidal load of unit size, with the sliders at rest.

    Attributes
    ----------
    s : (S,) array, m
    f : (W,) array, Hz
    gain : (S, W, i) array
        In `units`; `static` (S, i) with its sign at f = 0.
    damped : bool
        Whether anything damps it: otherwise peaks are as high as the frequencies happen to lie.
    outputs : tuple of str
        Of each input the direction in which it moves the tip most.
    inputs, units : tuples of str
    """

    s: Array
    f: Array
    gain: Array
    static: Array
    damped: bool
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class BodyResult:
    """Results of one body.

    `fields` are some of what a scene's recovery asks for, in the body's own frame; `peak_stress` the largest von Mises
    stress (F,) in Pa by model over all of its times; `envelopes` have forces along a beam, likewise.
    """

    shapes: Shapes | None = None
    fields: Fields | None = None
    peak_stress: Mapping[str, Array] = field(default_factory=dict)
    envelopes: Mapping[str, Envelope] = field(default_factory=dict)
