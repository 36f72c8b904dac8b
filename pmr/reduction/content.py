"""What a reduction depends on, as digests and text: operators, structure and the code."""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import environment, plugins
from pmr.fullmodel.model import FullModel
from pmr.scene import Scene

#: Sections of a scene that no reduction depends on.
ASKED = ("title", "start", "time", "recovery", "simulation", "compare", "accuracy", "budget", "published")


def content_of(model: FullModel) -> str:
    """Digest of all that a full model is made of, and of the code; collective.  It depends on the number of ranks."""
    digest = hashlib.blake2b(digest_size=16)
    matrices = [model.M, model.K, model.inputs, model.outputs, *model.matrices.values()]
    for A in matrices if model.rayleigh is not None else [*matrices, model.D]:
        for part in A.getValuesCSR():
            digest.update(part.tobytes())
    for row in model.rows.rows:
        parts = (row.breaks, row.coefficients, row.touched, *_csr(row.carriers))
        for part in parts:
            digest.update(part.tobytes())
        digest.update(repr((row.name, row.compliance, row.clearance)).encode())
    for name, row in model.ports.items():
        digest.update(repr((name, row.indices.tolist(), row.data.tolist())).encode())
    if model.rigid is not None:
        for part in (model.rigid.coordinates, model.rigid.held, model.output_positions):
            digest.update(part.tobytes())
    names = (model.input_names, model.output_names, model.output_units, tuple(model.matrices))
    digest.update(repr((names, model.rayleigh, model.reference_frequency, _code(), plugins.code_digest())).encode())
    return hashlib.blake2b(repr(model.comm.allgather(digest.hexdigest())).encode(), digest_size=16).hexdigest()


def structure_in(scene: Scene) -> str:
    """Content of a scene that decides its reduction, beside the stretch of its path: neither signals nor comparisons.

    The content of files that it names is not in it.
    """
    exclude: dict[str, Any] = dict.fromkeys(ASKED, True)
    exclude |= {"sections": {"__all__": {"slider": {"path"}, "loads": {"__all__": {"signal"}}}}}
    return scene.model_dump_json(exclude=exclude)


def _csr(A: Any) -> tuple[NDArray[Any], ...]:
    return A.indptr.astype(np.int64), A.indices.astype(np.int64), A.data


@cache
def _code() -> str:
    return environment.code_digest(environment.sources(), NOT_COMPUTING)


#: What no reduction depends on.
NOT_COMPUTING = ("report/", "studies/", "cli/", "export/", "simulation/", "compare/")
