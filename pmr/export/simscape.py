"""A flexible body for Simscape Multibody: what its block Reduced Order Flexible Solid asks for, as a file of MATLAB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io

from pmr.fields.framed import FramedBody
from pmr.files.whole import replaced


def write_simscape(body: FramedBody, target: Path) -> Path:
    """Write origins P (F, 3) of the frames, and K, M, C: of each frame x, y, z, rx, ry, rz, then the modes."""
    names = np.array(body.places.names, dtype=object)
    content = {"P": body.places.points, "K": body.K, "M": body.M, "C": body.C, "frames": names, "s": body.s}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replaced(target) as part, part.open("wb") as stream:
        scipy.io.savemat(stream, content)
    return target
