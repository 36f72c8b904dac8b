"""Signals by frequency: how far up they go, and what is left of a difference below that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from pmr.compare.errors import relative_error
from pmr.results import Response

Array = NDArray[np.float64]


def band(y: Array, step: float) -> float:
    """Frequency in Hz above which 1 % of signals (T, o) lies, by its RMS, at steps of so many s; 0 if all are zero."""
    window, count = np.hanning(len(y))[:, None], next_fast_len(len(y), real=True)
    power = np.sum(np.abs(np.fft.rfft((y - y.mean(axis=0)) * window, n=count, axis=0)) ** 2, axis=1)
    above = np.cumsum(power[::-1])[::-1]  # from each frequency on
    if above[0] <= 0.0:
        return 0.0
    return float(np.flatnonzero(above > 1e-4 * above[0])[-1] / (count * step))


def band_of(response: Response) -> float:
    """Band of a motion in Hz: the tip's, or that of all displacements where the tip rests on a support."""
    tip, step = response.displacement[:, -1:], float(response.t[1] - response.t[0])
    return band(tip if np.ptp(tip) > response.round_off else response.displacement, step)


def error_below(signal: Array, reference: Array, step: float, highest: float) -> float:
    """`pmr.compare.errors.relative_error` of what two signals (T, o) have up to a frequency in Hz."""
    too_high = np.fft.rfftfreq(len(signal), step) > highest
    spectra = [np.fft.rfft(values, axis=0) for values in (signal, reference)]
    for spectrum in spectra:
        spectrum[too_high] = 0.0
    slow, slow_reference = (np.fft.irfft(spectrum, n=len(signal), axis=0) for spectrum in spectra)
    return relative_error(slow, slow_reference)
