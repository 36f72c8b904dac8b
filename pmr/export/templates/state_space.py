"""A reduced model with its sliders held at places, as state spaces of python-control.

    from state_space import PATHS, S, nearest, system

S (m, a luffing angle in rad) are the places, on each of several PATHS; `system(k)` is the state space at S[k],
`nearest(s)` that next to s.
INTERPOLATION has the largest shares by which matrices interpolated halfway between two places are off: in a static gain
and in a frequency.
Needs numpy, scipy and control, and the file state_space.mat in this folder.
"""

from pathlib import Path

import control
import numpy as np
from scipy.io import loadmat

_DATA = loadmat(Path(__file__).with_name("state_space.mat"))
S = _DATA["s"] if _DATA["paths"].size > 1 else _DATA["s"].ravel()
PATHS = [str(cell[0]) for cell in _DATA["paths"].ravel()]
INTERPOLATION = {key: float(_DATA["interpolation"][key][0, 0].item()) for key in ("static_gain", "frequency")}


def _names(key):
    return [str(cell[0]).replace(".", "_") for cell in _DATA[key].ravel()]  # control allows no dots


def system(k):
    """X' = A x + B f, y = C x + D f at S[k]."""
    parts = [_DATA[name][:, :, k] for name in "ABCD"]
    return control.ss(*parts, inputs=_names("inputs"), outputs=_names("outputs"), states=_names("states"))


def nearest(s):
    """The state space at the place next to s, in the units of S."""
    return system(int(np.argmin(np.linalg.norm(np.reshape(S, (len(S), -1)) - np.reshape(s, (1, -1)), axis=1))))


if __name__ == "__main__":
    for k, s in enumerate(S):
        poles = system(k).poles()
        hertz = np.sort(np.abs(poles[poles.imag > 0.0])) / (2.0 * np.pi)
        along = zip(PATHS, np.atleast_1d(s), strict=False)  # nothing travels: no paths
        place = ", ".join(f"{path} = {x:g} {'rad' if path == 'luffing' else 'm'}" for path, x in along)
        print(f"{place or 'at rest'}: {', '.join(f'{f:.4g}' for f in hertz[:4])} Hz")
