"""Largest stress of a run in the walls of its sections at pads, from section forces of beams and forces of pads."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pmr.errors import InputError, call_on_first_rank
from pmr.files.arrays import Array
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.pads import Pad, restrain
from pmr.fullmodel.structure import couple
from pmr.fullmodel.wall_stress import LoadedRing, SectionStates, WallPeak, wall_peak, yield_forces
from pmr.pipeline.model_errors import UNNEEDED
from pmr.reduction.recovery import RecoveredBody
from pmr.results.field_series import mean_by_place
from pmr.results.field_stress import FORCES
from pmr.scene import Scene
from pmr.scene.choice import traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.members import members
from pmr.system.states import BodyStates

_log = logging.getLogger(__name__)

#: Reason for no stress in the walls of a section.
UNEVEN = "its walls change along it, or have frames or plates of their own"


@dataclass(frozen=True)
class LoadedSection:
    """Section forces along a section, and forces of its pads, at S times."""

    states: SectionStates
    rings: list[LoadedRing]


def stress_at_pads(
    scene: Scene,
    built: Mapping[str, AssembledBody],
    recovered: Mapping[str, RecoveredBody],
    states: Mapping[str, BodyStates],
) -> dict[str, Any]:
    """Entries of ``budget.model`` on stress in the walls of beams at pads; collective.

    ``wall_stress`` is the largest von Mises stress at the times of `states`, which are those of the reduced bodies, the
    same on every rank, from which `recovered` was recorded.  Its keys are ``value`` and its ``error`` by the meshes of
    the walls in Pa, ``t`` in s, ``position`` in m, ``section``, ``region``, and ``yield`` in Pa if the walls have a
    yield stress.  ``wall_stress_missing`` has the reason, by the name of each section with pads whose walls are not
    looked at.  ``pad_yield`` has the force of a joint's pad at which walls begin to yield
    (`pmr.fullmodel.wall_stress.yield_forces`), by the name of the joint's section.  Entries without content are left
    out.
    """
    peaks, missing = dict[str, WallPeak](), dict[str, str]()
    comm = next(iter(built.values())).model.comm
    for member in members(scene):
        part, body = member.part, built[member.part.name]
        if part.body.box is None or not (body.structure.pads.fixed or body.structure.pads.moving):
            continue
        if not traits_of(member).is_beam:
            missing[part.name] = "it is no beam: its stress is that of its own cells"
        elif not part.has_even_walls:
            missing[part.name] = UNEVEN
        else:
            loaded = _loaded_section(body, recovered[part.name], states[part.name])
            try:
                peak = comm.bcast(call_on_first_rank(comm, lambda: wall_peak(part, loaded.states, loaded.rings)))  # noqa: B023
            except UNNEEDED as error:
                missing[part.name] = error.allowed if isinstance(error, InputError) else str(error)
                continue
            peaks |= {} if peak is None else {part.name: peak}
    entries: dict[str, Any] = {"wall_stress_missing": missing} if missing else {}
    if peaks:
        name = max(peaks, key=lambda name: peaks[name].stress.value)
        entries["wall_stress"] = _peak_entry(scene.bodies[name], peaks[name], float(states[name].t[peaks[name].state]))
    try:
        forces = comm.bcast(call_on_first_rank(comm, lambda: yield_forces(scene))) if len(scene.sections) > 1 else {}
    except UNNEEDED as error:
        _log.warning("the force at which walls yield under pads is not known: %s", error)
        forces = {}
    return entries | ({"pad_yield": {name: asdict(force) for name, force in forces.items()}} if forces else {})


def _peak_entry(part: BoomSection, peak: WallPeak, t: float) -> dict[str, Any]:
    """Return the entry ``wall_stress`` for `peak`, the largest stress of a section, at the time t in s.

    It has ``value`` and ``error`` in Pa, ``t``, ``position`` in m, ``section``, the wall as ``region``, and, if the
    material has a yield stress, ``yield`` in Pa.
    """
    box, material = part.body.box, part.body.material
    assert box is not None
    flat = [side for side in box.sides if side.centre is None]
    off_mid = {side.name: abs(float((peak.position[1:] - side.start) @ side.normal)) for side in flat}
    off_face = {side.name: abs(off_mid[side.name] - side.thickness / 2.0) for side in flat}  # at an edge not the same
    entry = {
        "value": peak.stress.value,
        "error": peak.stress.error,
        "t": t,
        "position": peak.position.tolist(),
        "section": part.name,
        "region": min(off_face, key=lambda name: off_face[name]),
    }
    allowed = None if material is None else material.yield_stress
    return entry | ({} if allowed is None else {"yield": allowed})


def _loaded_section(body: AssembledBody, recovered: RecoveredBody, states: BodyStates) -> LoadedSection:
    """Return the section forces of a beam and the forces of its pads, at the times of its `states`; collective.

    `recovered` has the objects that compute full coordinates and section forces of the beam.
    """
    along, recovery = recovered.forces, recovered.recovery
    assert along is not None and recovery is not None  # as of every beam with a profile
    q = np.concatenate([np.hstack(body.model.comm.allgather(block)) for block in recovery.blocks(states)])
    values, names = along.evaluate(q, states), np.array(along.names)
    x = np.unique(along.x.round(9))
    forces = np.zeros((len(q), len(FORCES), len(x)))
    for number, name in enumerate(FORCES):
        if np.any(of := names == name):
            forces[:, number] = mean_by_place(along.x[of], values[:, of])[1]
    return LoadedSection(SectionStates(x, forces), _loaded_rings(body, states, q))


def _loaded_rings(body: AssembledBody, states: BodyStates, q: Array) -> list[LoadedRing]:
    """Return the pads of a body by their place along the body, with their forces in `states`.

    q (S, n) are the full coordinates, from which the forces of springs follow.
    """
    pads, structure = body.structure.pads, body.structure
    rings = dict[bytes, list[tuple[Pad, Array, Array]]]()

    def add(pad: Pad, x: Array, force: Array) -> None:
        size = np.array([pad.length, pad.width])
        rings.setdefault(np.concatenate([x, size]).round(6).tobytes(), []).append((pad, x, force))

    by_name = {pad.name: (pad, moves) for moves, some in ((0.0, pads.fixed), (1.0, pads.moving)) for pad in some}
    for name, s, force in zip(states.rows, states.s.T, states.multipliers.T, strict=True):
        if name in by_name:
            pad, moves = by_name[name]
            add(pad, pad.at + moves * s, force)
    T = couple(structure).T
    restraints = restrain(pads, structure.model, T)
    for row in restraints.springs:
        if row.name in by_name and row.name not in states.rows:
            pad = by_name[row.name][0]
            add(pad, np.full(len(q), pad.at), np.asarray(q @ restraints.force(row.name, T.shape[1]).toarray()[0]))
    return [
        LoadedRing(tuple(pad for pad, _, _ in ring), ring[0][1], np.stack([force for _, _, force in ring], axis=1))
        for ring in rings.values()
    ]
