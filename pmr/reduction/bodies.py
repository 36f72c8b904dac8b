r"""Reduced models of a scene's bodies: of a single body with its path, or of sections with rows on carriers.

Ports are points where a user attaches something to a reduced body; they have attachment modes.

A force b at a port causes, besides a motion in the basis V, the motion X = R b, with the residual flexibility R that V
leaves out (`pmr.reduction.residual`).  If X is among the coordinates, what remains of R has R b = 0, so the
coordinates alone respond exactly to a static force at the port, wherever the sliders are.  Since R K R = R

.. math:: X^T K X = b^T R b, \qquad X^T M V = X^T K V = 0

These vectors are combined to M-orthonormal ones with a diagonal stiffness.  Craig and Chang: On the use of attachment
modes in substructure coupling for dynamic analysis, AIAA paper 77-405, 1977.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.errors.environment import Clock
from pmr.fem.distributed import free_dropped, inner, tall, times
from pmr.files.arrays import Array
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis, modal_basis
from pmr.reduction.cache import Cache, ReducedBody
from pmr.reduction.free_body import FreeBody, ResidualFlexibility, support_motions, with_reactions
from pmr.reduction.from_scene import (
    Vectors,
    build_basis,
    enrichment_of,
    may_be_stressed,
    project,
    provenance,
    take_snapshots,
)
from pmr.reduction.recovery import Recovery
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene import Reduction as Choice
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import frame_terms
from pmr.scene.members import Member, members
from pmr.system.body_matrices import symmetric_part
from pmr.system.from_scene import system_of
from pmr.system.reduced_model import ReducedModel, SectionOf
from pmr.system.states import BodyStates
from pmr.system.system import System

#: Energy of the response to a force at a port, over the largest such energy, up to which a support holds the port.
HELD = 1e-12
#: Eigenvalue of the products of responses, scaled to unit energy, below which the responses depend on each other.
INDEPENDENT = 1e-9


def with_ports(body: FreeBody, modes: Basis) -> Basis:
    """Return the basis of free modes, followed by the attachment modes of the model's ports; collective.

    The attachment modes are M-orthonormal, with ascending frequencies.  `Basis.sigma` has the value 1 for each of them.
    Ports that supports hold, or that depend on other ports, add no mode.
    """
    model = body.model
    V = np.array(modes.V.getDenseArray())
    loads = sp.vstack(list(model.ports.values()), format="csr")[:, model.share].T.toarray()
    X = ResidualFlexibility(body, V).apply(loads.copy(order="F"))
    K = symmetric_part(inner(X, loads, model.comm))
    turns = np.array([name.split(" ")[-1].startswith("r") for name in model.ports])
    scale = np.sqrt(np.maximum(np.diagonal(K), 0.0))
    largest = np.where(turns, scale.max(where=turns, initial=0.0), scale.max(where=~turns, initial=0.0))
    moving = np.flatnonzero(scale > np.sqrt(HELD) * largest)
    energy, Q = np.linalg.eigh(K[np.ix_(moving, moving)] / np.outer(scale[moving], scale[moving]))
    Y = Q[:, energy > INDEPENDENT] / np.sqrt(energy[energy > INDEPENDENT]) / scale[moving, None]
    X = X[:, moving] @ Y
    theta, Q = scipy.linalg.eigh(symmetric_part(inner(X, times(model.M, X), model.comm)))  # 1/omega^2
    X = X @ (Q / np.sqrt(theta))[:, ::-1]
    sigma = np.append(modes.sigma, np.ones(X.shape[1]))
    return Basis(tall(np.ascontiguousarray(np.hstack([V, X])), model.M), sigma, modes.product)


@dataclass(frozen=True)
class Reduction:
    """Full models and reduced models of a scene's bodies, by the bodies' names; the same on every rank."""

    scene: Scene
    built: Mapping[str, AssembledBody]
    bodies: Mapping[str, ReducedBody]

    @property
    def basis(self) -> Array | Mapping[str, Array]:
        """Basis V (n, r) of a single body, or a dict of the basis of each section by its name; collective.

        The columns of V are the vectors that the coordinates multiply.  The vectors of a section's cylinder modes come
        last; modes without inertia (`pmr.system.attachment`) have none.  Under MPI every rank has the whole array.
        """
        bases = {name: self._gather_rows(name, self._recovery(name).V) for name in self.bodies}
        return bases.get(ALONE, bases)

    @property
    def snapshots(self) -> Array | Mapping[str, Array]:
        """Snapshots (n, k) from which the basis of a single body is made; for a boom, a dict of them by section names.

        Every rank has the whole arrays.  Collective.
        """
        pools = {
            name: self._gather_rows(name, np.array(body.snapshots.S.getDenseArray()))
            for name, body in self.bodies.items()
        }
        return pools.get(ALONE, pools)

    def reconstruct(self, states: Mapping[str, BodyStates]) -> Array | Mapping[str, Array]:
        r"""Full coordinates q (S, n) of a single body at S times; for a boom, a dict of such arrays by section names.

        .. math:: q = V p + R\, (B f - C(s)^T \lambda)

        with reduced coordinates p, loads f and multipliers lambda.  The second term is the motion of the part that the
        basis V leaves out, if the model has the flexibility R of this part.  `states` are those that
        `pmr.simulate_with_states(scene, reduction.system, steps)` returns.  Collective.
        """
        coordinates = {
            name: self._gather_rows(name, self._recovery(name).positions(at).T).T for name, at in states.items()
        }
        return coordinates.get(ALONE, coordinates)

    def project(self, q: Array, body: str = ALONE) -> Array:
        r"""Reduced coordinates p (r, ...) for which V p is nearest to q (n, ...) in the product of the basis V.

        .. math:: p = (V^T X V)^{-1} V^T X q, \qquad X = M \text{ or } I

        `q` has all n coordinates, the same on every rank.  If q has more axes than the first, the result has them, too.
        `body` is the name of a section of a boom; without it, the scene's single body is meant.  Collective.
        """
        V, model = self._recovery(body).V, self.built[body].model
        XV = times(model.M, V) if self.bodies[body].basis.product == "mass" else V
        gram, right = inner(V, XV, model.comm), inner(XV, np.atleast_2d(q.T).T[model.share], model.comm)
        return np.linalg.solve(gram, right).reshape(len(gram), *q.shape[1:])

    def _recovery(self, body: str) -> Recovery:
        """Object that recovers the full coordinates of the body called `body`."""
        return Recovery(self.built[body].model, self.bodies[body].V, self.bodies[body].model)

    def _gather_rows(self, body: str, local: Array) -> Array:
        """Gather an array (n, ...) on every rank from the part `local` (n_local, ...) of its rows that each rank has.

        The ranks are those of the full model of the body called `body`.  Collective.
        """
        return np.concatenate(self.built[body].model.comm.allgather(local))

    @property
    def reduced(self) -> Any:
        """The `pmr.ReducedModel` of a single body; for a boom, a dict of such models by section names."""
        models = self.system.reduced
        return models.get(ALONE, models)

    @cached_property
    def system(self) -> System:
        """System of the reduced bodies, for `pmr.simulate(scene, ...)` and for saving to a file."""
        return join_bodies(self.scene, self.bodies)


def with_stress_flags(scene: Scene, bodies: Mapping[str, ReducedBody]) -> dict[str, ReducedBody]:
    """Bodies by name, all with `stressed` true if the scene has terms of second order (`frame_terms`), otherwise false.

    Bodies that have this value already are returned themselves.
    """
    stressed = any(frame_terms(scene))  # a body that is not changed keeps its simulated model
    return {n: body if body.stressed == stressed else replace(body, stressed=stressed) for n, body in bodies.items()}


def join_bodies(scene: Scene, bodies: Mapping[str, ReducedBody]) -> System:
    """System of a scene's reduced bodies as simulations need it.

    Simulations extend some bodies by cylinder modes or by modes without inertia.  The models of these bodies before the
    extension are in `on_modes`, if errors can be estimated with them.  The system has the provenance of the scene.  If
    it has a single body and no `terms`, it has the body's own provenance instead.  Then the kernel moves the body with
    a frame, both in the run and after saving and loading.
    """
    bodies = with_stress_flags(scene, bodies)
    joined_system = system_of(scene, {name: body.model for name, body in bodies.items()})
    on_modes = {
        name: body.modal for name, body in bodies.items() if body.modal is not body.model and body.has_error_estimate
    }
    alone = ALONE in joined_system.bodies and not joined_system.terms
    provenance = joined_system.provenance if alone else scene.provenance
    return replace(joined_system, on_modes=on_modes, provenance=provenance)


def reduce_bodies(
    scene: Scene,
    built: Mapping[str, AssembledBody],
    caches: Mapping[str, Cache] | None = None,
    clock: Clock | None = None,
    vectors: Vectors | None = None,
) -> Mapping[str, ReducedBody]:
    """Reduced bodies of a scene by their names, from its full models `built`; collective.

    Equal sections are reduced once.  With `caches`, by the bodies' names, results are read from a cache or written to
    one; None means no cache.  `clock` measures the time of each stage.  The basis of a single body may consist of
    `vectors`, an array or a function of its full model; then no cache is used.  If `vectors` is None, the scene chooses
    the basis.  An InputError with the section's key is raised if a section can't be reduced.
    """
    caches, clock = caches or {}, clock or Clock()
    if vectors is not None:
        return {ALONE: reduce_body(scene, built[ALONE].model, clock, vectors)}
    if ALONE in built:
        return {ALONE: cached_body(scene, built[ALONE].model, caches.get(ALONE), clock)}
    by_model, reduced_bodies = dict[tuple[int, Choice], ReducedBody](), dict[str, ReducedBody]()
    with clock.stage("reduce"):
        for member in members(scene):
            name, key = member.part.name, (id(built[member.part.name]), member.part.reduction)
            if key not in by_model:
                try:
                    by_model[key] = _reduce_section(scene, member, built[name].model, caches.get(name))
                except InputError as error:
                    raise error.with_key(scene.section_key(member.number, error.key)) from None
            reduced_bodies[name] = _name_section(scene, member, by_model[key])
    return reduced_bodies


def cached_body(scene: Scene, model: FullModel, cache: Cache | None, clock: Clock | None = None) -> ReducedBody:
    """Reduced single body of a scene from the cache; if it is not there, made by `reduce_body` and stored; collective.

    The body has the provenance of this scene.  If `cache` is None, the body is made and not stored.  `clock` measures
    the time of each stage if the body is made.
    """
    if cache is None:
        return reduce_body(scene, model, clock)
    content = scene.reduction.model_dump(mode="json") | {"path": scene.travel}
    content["enrichment"] = enrichment_of(scene, scene.reduction, model)
    if may_be_stressed(scene):
        content["stressed"] = True
    if scene.reduction.file is not None:
        content["file"] = scene.hash  # the scene's hash covers the content of the file
    body = cache.reduced_body(content, lambda: reduce_body(scene, model, clock))
    return replace(body, modal=replace(body.modal, provenance=provenance(scene, body.basis)))


def reduce_body(
    scene: Scene, model: FullModel, clock: Clock | None = None, vectors: Vectors | None = None
) -> ReducedBody:
    """Reduce the full model of a scene's single body; collective.

    The basis is the one that the scene chooses, or made from the user's `vectors` if these are not None.  `clock`
    measures the time of each stage.  The result has the attachment modes of the scene's ports, and reactions of rigid
    supports.  Raises the errors of `take_snapshots` and `build_basis`.
    """
    clock = clock or Clock()
    with clock.stage("snapshots"):
        body = FreeBody(model, scene.reduction.solver)
        snapshots = take_snapshots(scene, model, body, vectors)
    with clock.stage("pod"):
        basis, motions = build_basis(scene, model, snapshots), support_motions(body)
        if scene.reduction.ports:
            basis = with_ports(body, basis)
        reduced_body = ReducedBody(snapshots, basis, project(scene, body, basis, provenance(scene, basis), motions))
        reduced_body = replace(reduced_body, modal=with_reactions(reduced_body.modal, body, reduced_body.V, motions))
    free_dropped(model.comm)
    return reduced_body


def _reduce_section(scene: Scene, member: Member, model: FullModel, cache: Cache | None) -> ReducedBody:
    """Reduced section on free modes and carriers, from the cache; if it is not there, made and stored; collective.

    If `cache` is None, nothing is read or stored.  Enrichment modes are added in two cases: an error is estimated, or
    terms that vary in time may act.  Inertia on carriers is added if an error is estimated.  A section is always stored
    with its residual flexibility.  If the scene asks for none, the result comes without it.
    """
    choice, stressed = member.part.reduction, may_be_stressed(scene)
    if member.part.body.mover is not None:  # it keeps both of its coordinates
        choice = choice.model_copy(update={"coordinates": model.size})
    enrichment = enrichment_of(scene, choice, model)

    def make() -> ReducedBody:
        """Reduce the section, with its residual flexibility."""
        body = FreeBody(model, choice.solver)
        snapshots = free_modes(model, choice.coordinates, choice.solver, enrichment, body, stressed)
        basis, motions = modal_basis(snapshots), support_motions(body)
        reduced_body = ReducedBody(
            snapshots, basis, section_model(body, basis, {}, choice.coordinates, motions, choice.estimable)
        )
        return replace(reduced_body, modal=with_reactions(reduced_body.modal, body, reduced_body.V, motions))

    content = choice.model_dump(mode="json") | {"section": enrichment} | ({"stressed": True} if stressed else {})
    reduced_body = make() if cache is None else cache.reduced_body(content, make)
    return reduced_body if choice.flexibility else replace(reduced_body, modal=_without_flexibility(reduced_body.modal))


def _without_flexibility(model: ReducedModel) -> ReducedModel:
    """Return a section's model without residual flexibility, neither in its tables nor on its carriers."""
    assert model.carriers is not None  # section models have carriers
    return replace(model, flexibility=None, carriers=replace(model.carriers, flexibility=None, answers=None))


def _name_section(scene: Scene, member: Member, body: ReducedBody) -> ReducedBody:
    """Return a reduced body with the name, joints and provenance of the section `member` of the scene."""
    rows = tuple(row for row in body.modal.row_names if row in member.joint_rows)
    section, about = SectionOf(member.part.name, scene.title, rows), provenance(scene, body.basis, member.number)
    return replace(body, modal=replace(body.modal, provenance=about, section=section))
