"""Flexible bodies for Exudyn, a file of its FEMinterface, and for Simscape Multibody, a file of MATLAB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io

from pmr.errors import environment
from pmr.fields.held import FramedBody, NodalBody
from pmr.files.whole import replacement


def write_ffrf(body: NodalBody, target: Path) -> Path:
    """Write what makes an ObjectFFRFreducedOrder, with Exudyn's own writer; raises InputError if Exudyn is missing."""
    environment.needed("exudyn")
    from exudyn.FEM import FEMinterface

    fem = FEMinterface()
    fem.nodes = {"Position": body.points}
    fem.massMatrix, fem.stiffnessMatrix = body.M, body.K
    fem.modeBasis = {"matrix": body.modes, "type": "NormalModes"}
    fem.eigenValues = body.omega**2
    fem.metaData = {"sliders at s in m": body.s}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacement(target) as part:
        named = part.with_name(f"{part.name}.npz")  # the writer wants its own ending
        fem.SaveToFile(str(named))
        named.replace(part)
    return target


def write_simscape(body: FramedBody, target: Path) -> Path:
    """Write what the block Reduced Order Flexible Solid asks for: origins P (F, 3) of the frames, and K, M, C.

    Their rows are of each frame x, y, z, rx, ry, rz, then the modes.
    """
    names = np.array(body.places.names, dtype=object)
    content = {"P": body.places.points, "K": body.K, "M": body.M, "C": body.C, "frames": names, "s": body.s}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacement(target) as part, part.open("wb") as stream:
        scipy.io.savemat(stream, content)
    return target
