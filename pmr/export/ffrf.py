"""A flexible body for Exudyn: a file of its FEMinterface, from which it makes an ObjectFFRFreducedOrder."""

from __future__ import annotations

from pathlib import Path

from pmr import environment
from pmr.fields.nodal import NodalBody
from pmr.files.whole import replaced


def write_ffrf(body: NodalBody, target: Path) -> Path:
    """Write nodes, mass, stiffness and modes with Exudyn's own writer; `FEMinterface.LoadFromFile` reads them.

    Raises InputError if Exudyn is missing.
    """
    environment.needed("exudyn")
    from exudyn.FEM import FEMinterface

    fem = FEMinterface()
    fem.nodes = {"Position": body.points}
    fem.massMatrix, fem.stiffnessMatrix = body.M, body.K
    fem.modeBasis = {"matrix": body.modes, "type": "NormalModes"}
    fem.eigenValues = body.omega**2
    fem.metaData = {"sliders at s in m": body.s}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replaced(target) as part:
        named = part.with_name(f"{part.name}.npz")  # the writer wants its own ending
        fem.SaveToFile(str(named))
        named.replace(part)
    return target
