"""Banks of Kalman filters of the compiled kernel, over the places of a path (src/bank.c)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import pointer


class BankRecord(NamedTuple):
    """Results of a bank at T steps: probabilities of S places, mean of n states, level of the innovations."""

    probability: Array  # (T, S)
    states: Array  # (T, n)
    level: Array  # (T,)


@dataclass(frozen=True)
class Bank:
    """S places, D speeds and n states; arrays and probabilities of a step, as `pmr_bank` (src/pmr_kernel.h).

    `up` and `down` are, for each speed, the chances to move to the next place and to the one before.  `rest` and
    `active` are the transition matrices between speeds where nothing moves, and in motion; `activity` in
    `advance_bank` is the share of the second.  The other numbers are as in `pmr.observe.position.PositionSettings`.
    """

    F: Array  # (S, n, n)
    H: Array  # (S, n)
    gain: Array  # (S, n)
    variance: Array  # (S,): of innovations, over the level
    up: Array  # (D,)
    down: Array  # (D,)
    rest: Array  # (D, D)
    active: Array  # (D, D)
    temper: float
    attack: float
    decay: float
    floor: float


def advance_bank(bank: Bank, y: Array, activity: Array, least_level: Array) -> BankRecord:
    """Take T steps from equally likely places, with measurements y (T,), NaN where there is none.

    `activity` (T,), 0 to 1, is how much the slider is in motion.  The level of the innovations, a running mean of their
    squares over their variance, scales all variances; it never falls below `least_level` (T,) and ``bank.floor``.
    """
    S, n = bank.H.shape
    arrays = {
        name: np.ascontiguousarray(getattr(bank, name), float)
        for name in ("F", "H", "gain", "variance", "up", "down", "rest", "active")
    }
    numbers = {name: getattr(bank, name) for name in ("temper", "attack", "decay", "floor")}
    sizes = {"places": S, "speeds": len(bank.up), "states": n}
    data = ffi.new("pmr_bank *", sizes | numbers | {name: pointer(array) for name, array in arrays.items()})
    memory = np.zeros(lib.pmr_bank_memory(data))
    lib.pmr_bank_start(data, pointer(memory))
    record = BankRecord(np.zeros((len(y), S)), np.zeros((len(y), n)), np.zeros(len(y)))
    out = ffi.new("pmr_bank_record *", {name: pointer(array) for name, array in record._asdict().items()})
    signals = [np.ascontiguousarray(x, float) for x in (y, activity, least_level)]
    lib.pmr_bank_advance(data, pointer(memory), len(y), *map(pointer, signals), out)
    return record
