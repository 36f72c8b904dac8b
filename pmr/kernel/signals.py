"""Signals over time as the kernel evaluates them: sums of pieces of polynomials and sines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib


class Signal(Protocol):
    """Signal of a scene (`pmr.scene.signals`)."""

    @property
    def strands(self) -> tuple[Any, ...]:
        """Pieces of polynomials and sines whose sum is the signal; a NotImplementedError if it is not such a sum."""


class Signals:
    """N signals, one for each driver and in the order of the drivers, as the kernel's `pmr_signals`.

    A NotImplementedError is raised if a signal is not a sum of such pieces; then the drivers have to be sampled
    (`State.advance_sampled`).
    """

    def __init__(self, signals: Sequence[Signal]) -> None:
        strands = [signal.strands for signal in signals]
        every = [strand for of_signal in strands for strand in of_signal]
        powers = max([1, *(strand.polynomials.shape[1] for strand in every)])
        pieces = [
            np.column_stack(
                [
                    np.pad(strand.polynomials, ((0, 0), (powers - strand.polynomials.shape[1], 0))),
                    np.full(len(strand.breaks), strand.amplitude),
                    np.broadcast_to(strand.angles, (len(strand.breaks), 3)),
                ]
            )
            for strand in every
        ]
        self.first_strand = np.cumsum([0, *map(len, strands)]).astype(np.int32)
        self.first_piece = np.cumsum([0, *(len(strand.breaks) for strand in every)]).astype(np.int32)
        self.spread = np.array([strand.spread for strand in every], float)
        self.breaks = np.concatenate([np.zeros(0), *(strand.breaks for strand in every)])
        self.pieces = np.concatenate([np.zeros((0, powers + 4)), *pieces])
        self.pointer = ffi.new(
            "pmr_signals *",
            {
                "drivers": len(signals),
                "powers": powers,
                "first_strand": ffi.cast("int32_t *", self.first_strand.ctypes.data),
                "first_piece": ffi.cast("int32_t *", self.first_piece.ctypes.data),
                "spread": ffi.cast("double *", self.spread.ctypes.data),
                "breaks": ffi.cast("double *", self.breaks.ctypes.data),
                "pieces": ffi.cast("double *", self.pieces.ctypes.data),
            },
        )

    def at(self, t: float) -> tuple[Array, Array]:
        """Values (N,) of the signals at t in s, and their first and second rates (2, N)."""
        count = len(self.first_strand) - 1
        u, rates = np.zeros(count), np.zeros((2, count))
        lib.pmr_signals_at(
            self.pointer, t, ffi.cast("double *", u.ctypes.data), ffi.cast("double *", rates.ctypes.data)
        )
        return u, rates
