"""Reduction as a scene asks for it: snapshots or the user's vectors, the basis of these, and residual flexibility.

Vectors of the user's own come from a file, an array, or an installed package; they are made orthonormal in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np

from pmr.errors import InputError, environment
from pmr.fem.compat import versions
from pmr.fem.distributed import inner, local_csr, tall, times
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis, modal_basis, pod, reduced_model, with_held_coordinates, with_rigid_modes
from pmr.reduction.cache import ReducedBody
from pmr.reduction.free_body import FreeBody, released_rows, rigid_modes
from pmr.reduction.residual import flexible_model, section_model
from pmr.reduction.snapshots import Snapshots, eigenmode_snapshots, free_modes
from pmr.scene import Reduction, Scene
from pmr.scene.keys import ALONE
from pmr.scene.members import member_at
from pmr.scene.run_settings import OwnBasis
from pmr.system.attachment import QUASI_STATIC
from pmr.system.reduced_model import ReducedModel
from pmr.system.truncation import check_independence

#: Vectors (n, k) on the n coordinates of a full model, or a function of the model that returns this rank's part of
#: them.
Vectors: TypeAlias = Array | Callable[[FullModel], Array]
#: Norm of a vector's part orthogonal to the vectors before it, over the vector's norm, up to which it is dependent.
DEPENDENT = 1e-10


def vectors_from_file(model: FullModel, file: Path) -> Snapshots:
    """Snapshots from a file of the user: the array ``V`` (n, k) in an npz file, for the model's n coordinates.

    Every rank reads the file.  An InputError is raised if the file has no array ``V``.  It is also raised if the array
    has another number of rows than n, no column, or entries that are not finite.  Collective.
    """
    try:
        V = np.asarray(npz.read(file)["V"], dtype=float)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(str(file), "V", None, f"an npz file with an array V is allowed ({error})") from None
    if not _are_vectors(model, V, model.size):
        allowed = f"finite vectors as columns, with a row for each of the model's {model.size} coordinates, are allowed"
        raise InputError(str(file), "V", list(V.shape), allowed)
    return _snapshots(model, V[model.share], f"vectors from {file.name}")


def vectors_from_array(model: FullModel, basis: Vectors) -> Snapshots:
    """Snapshots from `basis`: an array (n, k), or a function that gets the full model and returns vectors; collective.

    An array is whole on every rank; a function returns only this rank's part (n_local, k).

    Raises
    ------
    InputError
        If the array has another number of rows, no column, or entries that are not finite real numbers; also if the
        function changes the model.
    """
    share, is_local = model.share, callable(basis)
    rows, V, changed = share.stop - share.start if is_local else model.size, np.empty((0, 0)), None
    try:
        V = _real_array(_call_on_model(basis, model) if callable(basis) else basis)
    except InputError as error:  # of this rank's part alone: all ranks have to learn of it
        changed = error
    if not _are_vectors(model, V, rows):
        allowed = f"finite vectors of real numbers as columns, with {rows} rows, one for each coordinate, are allowed"
        raise changed or InputError("pmr.reduce", "basis", list(V.shape), allowed)
    return _snapshots(model, V if is_local else V[share], "vectors given as an array")


def vectors_from_package(model: FullModel, choice: Reduction) -> Snapshots:
    """Snapshots from a function of an installed package; collective.

    The package declares the function as an entry point in the group ``pmr.bases``, under the name `choice.basis`.  The
    function gets the model and the scene's `choice` of a reduction, and returns this rank's part (n_local, k) of k
    vectors.  An InputError is raised if there is no such function, if it fails or changes the model, or if it returns
    anything else.
    """
    make = environment.plugin_object("pmr.bases", choice.basis, frozenset(get_args(OwnBasis)))
    if not callable(make):
        raise environment.plugin_error("pmr.bases", choice.basis)
    V, failed, rows = np.empty((0, 0)), "", model.share.stop - model.share.start
    try:
        V = _real_array(_call_on_model(make, model, choice))
    except InputError as error:
        failed = error.allowed
    except Exception as error:  # any error of the package: all ranks have to learn of it
        failed = f"it failed: {error!r}"
    if not _are_vectors(model, V, rows):
        allowed = f"finite vectors (n, k) of real numbers with {rows} rows here are allowed"
        raise environment.plugin_error("pmr.bases", choice.basis, failed or allowed)
    return _snapshots(model, V, f"vectors of {choice.basis}")


def _call_on_model(make: Callable[..., Any], model: FullModel, *arguments: Any) -> Any:
    """Return what a user's function `make` makes of a full model and further `arguments`.

    Raises an InputError if the function changes mass or stiffness of the model, since all later results would have the
    change.  A change is recognised by the norms of this rank's rows of both matrices, so the error may be raised on
    some ranks only.
    """
    before = [np.linalg.norm(local_csr(A).data) for A in (model.M, model.K)]
    returned = make(model, *arguments)
    if [np.linalg.norm(local_csr(A).data) for A in (model.M, model.K)] != before:
        allowed = "a function that leaves mass and stiffness of the model as they are is allowed; it may change copies"
        raise InputError("pmr.reduce", "basis", None, allowed)
    return returned


def _real_array(values: Any) -> Array:
    """Return values as an array of floats; an empty array (0, 0) if they are no real numbers."""
    array = np.asarray(values)
    return array.astype(float) if array.dtype.kind in "biuf" else np.empty((0, 0))


def _are_vectors(model: FullModel, V: Array, rows: int) -> bool:
    """Whether V is, on every rank, an array (`rows`, k) of finite numbers with one column or more; collective."""
    fits = V.ndim == 2 and V.shape[0] == rows and V.shape[1] > 0 and bool(np.isfinite(V).all())
    return all(model.comm.allgather(fits))


def _snapshots(model: FullModel, local: Array, source: str) -> Snapshots:
    """Snapshots from k vectors of a user, `local` (n_local, k), this rank's part; `source` says where they come from.

    Their frequencies, positions and residuals are not known, and set to NaN.  Collective.
    """
    unknown = np.full(local.shape[1], np.nan)
    return Snapshots(tall(np.ascontiguousarray(local), model.M), unknown, unknown, unknown, source)


def basis_of_vectors(model: FullModel, vectors: Snapshots, choice: Reduction, size: int | None) -> Basis:
    """Basis of the first `size` independent vectors, each made orthonormal to those before; collective.

    Vectors that depend on those before are left out.  If `size` is None, all independent vectors are taken.  If
    `choice` adds flexibility, rigid-body modes come first and count among the vectors, because flexibility can't
    replace them.  All singular values are 1: the vectors have no known weight.  An InputError is raised if fewer than
    `size` vectors are independent.
    """
    V = np.array(vectors.S.getDenseArray())
    largest = np.max(model.comm.allgather(np.abs(V).max(axis=0, initial=0.0)), axis=0)
    V /= np.where(largest > 0.0, largest, 1.0)  # scaled, so that squares neither vanish nor overflow
    if choice.flexibility:
        V = np.hstack([rigid_modes(model), V])
    in_mass = choice.product == "mass"
    Q = np.zeros((len(V), 0))
    for v in V.T:
        if Q.shape[1] == size:
            break
        size_before = size_after = _norm(model, v, in_mass)
        for _ in range(2):  # a single pass would leave round-off of the removed part
            if size_after <= DEPENDENT * size_before:
                break
            v = v - Q @ inner(Q, _weigh(model, v, in_mass), model.comm)[:, 0]
            size_after = _norm(model, v, in_mass)
        if size_after > DEPENDENT * size_before:
            Q = np.column_stack([Q, v / size_after])
    if size is not None and Q.shape[1] < size:
        allowed = f"the vectors and rigid-body modes span {Q.shape[1]} dimensions; at most so many are allowed"
        raise InputError("scene", "reduction.coordinates", size, allowed)
    return Basis(tall(np.ascontiguousarray(Q), model.M), np.ones(Q.shape[1]), choice.product)


def _weigh(model: FullModel, v: Array, in_mass: bool) -> Array:
    """Product M v (n_local, 1) of a vector v (n_local,) if `in_mass` is true, else v itself as a column; collective."""
    return times(model.M, v[:, None]) if in_mass else v[:, None]


def _norm(model: FullModel, v: Array, in_mass: bool) -> float:
    """Norm of a vector v (n_local,), in the mass product if `in_mass` is true, else in the Euclidean one.

    Collective.
    """
    return float(np.sqrt(inner(v[:, None], _weigh(model, v, in_mass), model.comm).item()))


#: Value of `reduction.basis` in a scene whose vectors are an array in Python; files can't have it.
ARRAY = "array"
#: Number of modes beyond the coordinates with which the error is estimated; attachment modes have the further ones.
ENRICHMENT_MODES = 4
#: Number of these modes if a tolerance or a budget is given, for a single body and for each of several sections: the
#: search for the smallest model chooses among them.
SEARCHED_MODES, SEARCHED_OF_SECTIONS = 38, 16


def take_snapshots(
    scene: Scene, model: FullModel, body: FreeBody | None = None, vectors: Vectors | None = None
) -> Snapshots:
    """Snapshots of the kind that the scene chooses, or made from the user's `vectors` if these are given; collective.

    The snapshots are eigenmodes with the slider held at several positions (POD), free modes with the sliders released,
    or vectors from a file or an installed package.  A `body` that is not None, of the same model, lends its factor to
    free modes.  An InputError is raised if the mesh can't have such snapshots or the user's vectors do not fit it, and
    a ConvergenceError if a solver fails.
    """
    if vectors is not None:
        return vectors_from_array(model, vectors)
    if scene.reduction.file is not None:
        return vectors_from_file(model, scene.reduction.file)
    if scene.reduction.is_external:
        return vectors_from_package(model, scene.reduction)
    if not scene.reduction.uses_pod:
        choice = scene.reduction
        more, stressed = enrichment_of(scene, choice, model), may_be_stressed(scene)
        return free_modes(model, choice.coordinates, choice.solver, more, body, stressed)
    return eigenmode_snapshots(model, scene)


def build_basis(scene: Scene, model: FullModel, snapshots: Snapshots) -> Basis:
    """Basis of the kind that the scene chooses: POD of the snapshots, free modes unchanged, or the user's vectors.

    If flexibility is added, rigid-body modes are the first vectors of a POD basis and of a basis of the user's vectors.
    An InputError is raised if the snapshots span too little.  Collective.
    """
    choice = scene.reduction
    if choice.is_external:
        return basis_of_vectors(model, snapshots, choice, None if choice.basis == ARRAY else choice.coordinates)
    if not choice.uses_pod:
        return modal_basis(snapshots)
    if choice.flexibility:
        return with_rigid_modes(model, snapshots, rigid_modes(model), choice.coordinates, choice.product, choice.solver)
    return pod(model, snapshots, choice.coordinates, choice.product, choice.solver)


def provenance(scene: Scene, basis: Basis, number: int = 0) -> dict[str, Any]:
    """Return a record of what the reduced model of one body was made from; `number` counts the scene's bodies from 0.

    The keys are those of `Scene.provenance`, and ``basis``, ``versions`` and ``kappa``, the share of the snapshots'
    squared norm that is in the basis.  A section with a joint is recorded as the scene of a single body, which has the
    pads of the section's joints.  If the basis was passed as an array, the recorded scene lacks the table
    ``reduction``.
    """
    member, recorded = member_at(scene, number), scene.provenance
    if member.part.reduction.basis == ARRAY:  # the scene's own reduction does not describe this model
        recorded = recorded | {"scene": {key: value for key, value in recorded["scene"].items() if key != "reduction"}}
    if member.has_joint:  # described like a single body, with the pads of its joints
        described = recorded["scene"]
        section = described.pop("sections")[number] | {"pads": [ring.model_dump(mode="json") for ring in member.pads]}
        section = {key: value for key, value in section.items() if key not in ("name", "joint", "slider")}
        title = {"title": f"{scene.title}: {member.part.name}"}
        recorded = recorded | {"scene": described | section | title, "files": member.part.file_digests}
    return {
        **recorded,
        "basis": description(member.part.reduction, basis),
        "kappa": basis.kappa(),
        "versions": environment.package_versions() | versions(),
    }


def summary(scene: Scene, models: Mapping[str, FullModel], bodies: Mapping[str, ReducedBody]) -> dict[str, Any]:
    """Return a dict of one key, ``basis``, with the entry for summary.json, from full models and bodies by name.

    For sections, the entry has only the key ``kind``, a description in words.  For a single body, it has further keys.
    ``carriers`` is the number of carriers that the rows of sliders and pads touch on the path.  ``largest_residual`` is
    None if the vectors are no eigenmodes.
    """
    if ALONE not in bodies:
        return {"basis": {"kind": "free modes of every section, with residual flexibility"}}
    body = bodies[ALONE]
    basis, largest = body.basis, float(body.snapshots.residuals.max())
    return {
        "basis": {
            "kind": description(scene.reduction, basis),
            "kappa": basis.kappa(),
            "singular_values": basis.sigma.tolist(),
            "largest_residual": None if np.isnan(largest) else largest,
            "rows_left_out": list(body.modal.left_out),
            "carriers": released_rows(models[ALONE]).shared_carriers.carriers.shape[0],
        }
    }


def project(
    scene: Scene, body: FreeBody, basis: Basis, provenance: dict[str, object], motions: Array | None = None
) -> ReducedModel:
    """Reduced model of the body on the given basis, in the form that the scene asks for; collective.

    The model has enrichment modes if an error is estimated (`pmr.compare.estimate`) or terms that vary in time may act.
    For an estimate it has inertia on carriers, too.  If neither is so, it has tables of the residual flexibility if the
    scene asks for these.  The model keeps `provenance`, which says what it was made from.  `motions` (n_local, h) are
    unit motions of rigid supports, None if there are none (`pmr.reduction.free_body.support_motions`).  An InputError
    is raised if rows depend on each other.
    """
    choice = scene.reduction
    if enrichment_of(scene, choice, body.model):
        reduced_body = section_model(body, basis, provenance, choice.coordinates, motions, choice.estimable)
        check_independence(reduced_body)  # dependent rows matter, as all have the same path coordinate
        return reduced_body
    if choice.flexibility:
        return flexible_model(body, basis, provenance)
    reduced = reduced_model(body.model, basis, provenance)
    return with_held_coordinates(reduced) if choice.basis == "paper" else reduced


def enrichment_of(scene: Scene, choice: Reduction, model: FullModel) -> int:
    """Number of enrichment modes, which a body has in addition to the coordinates of `choice`.

    They serve to estimate errors, or as modes without inertia if the body may be stressed.  The number is

    - `SEARCHED_MODES` if errors are estimated for a tolerance or a budget, or `SEARCHED_OF_SECTIONS` for a section of
      a boom.  On a coarse mesh the number is smaller: coordinates and enrichment modes together are at most three
      quarters of all modes.  The flexibility of the remaining modes is needed by attachment modes, rigid sliders and
      pads (`pmr.reduction.snapshots`).  But the number is never smaller than `ENRICHMENT_MODES`.
    - `ENRICHMENT_MODES` if errors are estimated without a tolerance or a budget.
    - `QUASI_STATIC` if no errors are estimated, the body may be stressed and its basis can be extended.
    - 0 in all other cases.
    """
    if choice.estimable and scene.goal is not None:
        searched = SEARCHED_MODES if ALONE in scene.bodies else SEARCHED_OF_SECTIONS
        return max(ENRICHMENT_MODES, min(searched, 3 * model.size // 4 - choice.coordinates))
    if choice.estimable:
        return ENRICHMENT_MODES
    return QUASI_STATIC if may_be_stressed(scene) and choice.extendable else 0


def with_array_basis(scene: Scene) -> Scene:
    """Return the scene of a single body with `reduction.basis` set to `ARRAY`, for a basis that is given in Python.

    Product, flexibility and all other settings of the `reduction` stay, but no error is estimated.  An InputError is
    raised for a boom of sections, because their bases consist of free modes.
    """
    if ALONE not in scene.bodies:
        allowed = "a scene of one body is allowed with a basis: sections are reduced to free modes"
        raise InputError("pmr.reduce", "sections", list(scene.names), allowed)
    choice = scene.reduction.model_copy(update={"basis": ARRAY, "file": None, "estimate": False})
    return scene.model_copy(update={"reduction": choice})


def may_be_stressed(scene: Scene) -> bool:
    """Whether terms of second order may act on a scene's bodies: if `frame.second_order` is true or ``"auto"``."""
    return scene.frame is not None and bool(scene.frame.second_order)


def description(choice: Reduction, basis: Basis) -> str:
    """Description in words of the basis that `choice` names, with the unit of the reduced coordinates."""
    if choice.is_external:
        rigid = "rigid-body modes and " if choice.flexibility else ""
        of = {"file": "from a file", ARRAY: "given as an array"}.get(choice.basis, f"of {choice.basis}")
        kind = f"{rigid}vectors {of}, orthonormal in the {basis.product} product"
    elif not choice.uses_pod:
        kind = "eigenmodes on the fixed supports with the sliders released, M-orthonormal"
    else:
        rigid = "rigid-body modes of the body without its sliders and " if choice.flexibility else ""
        kind = f"{rigid}POD of eigenmodes with the slider held, orthonormal in the {basis.product} product"
    ports = f", attachment modes of {', '.join(map(str, choice.ports))}" if choice.ports else ""
    added = f"{ports}; residual flexibility of what they leave out" if choice.flexibility else ""
    units = "m and rad" + (" times sqrt(kg)" if basis.product == "mass" else "")
    return f"{kind}{added}; coordinates carry {units}"
