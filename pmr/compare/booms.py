"""What simulators say of a boom of several sections, in the quantities of any run, and what its joints bear."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.boom_friction import friction
from pmr.compare.errors import Quantity, nrms, with_common_forces
from pmr.compare.pad_forces import PULLED, newton
from pmr.compare.summary import Part
from pmr.reduced.model import ReducedModel
from pmr.results import BoomFrequencies, Energy, Response
from pmr.results.extremes import Extremes
from pmr.scene import Boom
from pmr.scene.boom import Joint
from pmr.scene.boom_parts import STRAIGHT
from pmr.scene.built import force_of, reaction_of
from pmr.simulate.booms import cylinder
from pmr.simulate.columns import called
from pmr.simulate.modal import inertia_share, unpressed
from pmr.simulate.native import multibody
from pmr.system.assembly import Assembly
from pmr.system.body import force_outputs, length_outputs
from pmr.system.contacts import Contact
from pmr.system.system import Joined, System, SystemTrajectory

Array = NDArray[np.float64]

#: Frequencies that are compared, and places on the way at which: fewer where matrices are large.
CURVES, PLACES, FEWER_PLACES = 4, 13, 4
#: Share of the reach by which a published one may lie beyond it: it is rounded.
BESIDE = 1e-4


@dataclass(frozen=True)
class Said:
    """What a simulator says: outputs (T, o) of every body, forces and peaks (T, m) in N of contacts, energies."""

    outputs: Mapping[str, Array]
    forces: Array
    peaks: Array
    energy: Energy


def respond(system: System, trajectory: SystemTrajectory) -> Response:
    """Displacements of all sections, one after the other, and the forces of all contacts and springs."""
    kinetic = np.zeros(len(trajectory.t))
    for name, body in system.bodies.items():
        v = trajectory.bodies[name].v
        kinetic += 0.5 * np.einsum("tn,tn->t", v, (body.M @ v.T).T)
    energy = Energy(kinetic, trajectory.energy - kinetic, -trajectory.work)
    outputs = multibody.displacements(system, trajectory)
    found = response_of(system, trajectory.t, Said(outputs, trajectory.forces, trajectory.peaks, energy))
    return _with_reactions(replace(found, seconds=trajectory.seconds, surplus=trajectory.surplus), system, trajectory)


def _with_reactions(response: Response, system: System, trajectory: SystemTrajectory) -> Response:
    """With what reduced sections press on their rigid supports with."""
    names, units, columns, first = list[str](), list[str](), list[Array](), 0
    for name, body in system.bodies.items():
        loads = trajectory.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)
        known, motion = body.reactions, trajectory.bodies[name]
        if not isinstance(body, ReducedModel) or body.carriers is None or known is None or known.carried is None:
            continue
        carried = known.carried - body.carriers.values @ inertia_share(body, known).T
        forces = unpressed(body, known, motion, loads)
        own = [side for side in system.sides if side.place.body == name]
        for side, x, force in zip(own, motion.s.T, motion.multipliers.T, strict=True):
            forces -= force[:, None] * (system.row(side.place).weights(x) @ carried)
        names += [reaction_of(f"{name}: {one}") for one in known.names]
        units += known.units
        columns.append(forces)
    if not names:
        return response
    others = [] if response.others is None else [response.others]
    return replace(
        response,
        others=np.hstack([*others, *columns]),
        other_names=(*response.other_names, *names),
        other_units=(*response.other_units, *units),
    )


def response_of(system: Joined[Any], t: Array, said: Said) -> Response:
    """The same of what any simulator says at the times t (T,) s."""
    moved, springs, others = list[Array](), list[Array](), list[Array]()
    other_names, other_units = list[str](), list[str]()
    x, names, force_names = list[Array](), list[str](), list[str]()
    for name, body in system.bodies.items():
        of, y = called(body, ()), said.outputs[name]
        moved.append(y[:, length_outputs(body)])
        springs.append(y[:, force_outputs(body)])
        others.append(y[:, ~(length_outputs(body) | force_outputs(body))])
        other_names += [f"{name}: {one}" for one in of.others]
        other_units += of.other_units
        x.append(body.output_positions[length_outputs(body)])
        names += [f"{name}: {one}" for one in of.moved]
        force_names += [f"{name}: {one}" for one in of.forces]
    borne = [k for k, contact in enumerate(system.contacts) if contact.inner.row not in STRAIGHT]
    not_known = np.full(len(t), np.nan)
    return Response(
        t=t,
        x=np.concatenate(x),
        displacement=np.hstack(moved),
        energy=said.energy,
        slider_force=np.hstack([*springs, said.forces[:, borne]]),
        residual_position=not_known,
        residual_velocity=not_known,
        seconds=np.nan,
        output_names=tuple(names),
        output_units=("m",) * len(names),
        force_names=(*force_names, *(force_of(system.contact_names[k]) for k in borne)),
        force_peaks=np.hstack([*springs, said.peaks[:, borne]]),
        others=np.hstack(others) if other_names else None,
        other_names=tuple(other_names),
        other_units=tuple(other_units),
    )


def quantities(boom: Boom, response: Response) -> Mapping[str, Quantity]:
    """What is compared: the last section's tip, all lines, all forces."""
    tips = tip_columns(boom, response)
    return {
        "tip": lambda one: one.displacement[:, tips],
        "beam": lambda one: one.displacement,
        "pad_force": lambda one: one.slider_force,
    }


def tip_columns(boom: Boom, response: Response) -> list[int]:
    """Columns of the displacements of the last section's tip."""
    last = boom.sections[-1]
    named = {f"{last.name}: {last.observe.tip_along(direction)}" for direction in "yz"}
    return [k for k, name in enumerate(response.output_names) if name in named]


def columns_of(section: str, response: Response) -> list[int]:
    """Columns of the displacements of a section."""
    return [k for k, name in enumerate(response.output_names) if name.startswith(f"{section}: ")]


def sections(
    boom: Boom,
    responses: Mapping[str, Response],
    sizes: Mapping[str, Mapping[str, int]],
    more: Mapping[str, Mapping[str, Any]],
) -> Part:
    """``sections`` of summary.json: name, coordinates, the error along each against the full model, what else is known.

    Of `more`, a table for each section, ``max_von_mises`` and ``stress_peak`` are gathered of all.
    """
    reduced, full, found = responses["reduced"], responses.get("full"), []
    for name in boom.names:
        columns, said = columns_of(name, reduced), {"name": name, "coordinates": dict(sizes[name])}
        if full is not None:
            error = nrms(reduced.displacement[:, columns], full.displacement[:, columns])
            said |= {"errors": {"reduced_vs_full": {"beam": error}}}
        found.append(said | dict(more.get(name, {})))
    peaks = [(one["name"], one["stress_peak"]) for one in found if "stress_peak" in one]
    if not peaks:
        return Part({"sections": found})
    highest = {
        model: max(({"section": name, **peak[model]} for name, peak in peaks), key=lambda one: float(one["value"]))
        for model in peaks[0][1]
    }
    most = {model: peak["value"] for model, peak in highest.items()}
    return Part({"sections": found, "max_von_mises": most, "stress_peak": highest})


def joints(boom: Boom, response: Response, contacts: Sequence[Contact]) -> Part:
    """``pads`` and ``cylinders`` of summary.json, smallest and largest force with their times; pads that are pulled.

    Of cylinders also the largest ``friction`` that they overcome, where there is any.
    """
    driven = {force_of(cylinder(name)) for name in boom.names[1:]} & set(response.force_names)
    reach = boom.reach(response.t)
    loads: list[dict[str, Any]] = [
        {"name": name.removeprefix(force_of("")), **Extremes.of(response.force(name, 0), response.t, reach).summary()}
        for name in response.force_names
    ]
    pads = [load for name, load in zip(response.force_names, loads, strict=True) if name not in driven]
    resisting = {cylinder(name): values for name, values in friction(boom, contacts, response).items()}
    cylinders = [
        load | ({"friction": float(np.abs(resisting[load["name"]]).max())} if load["name"] in resisting else {})
        for name, load in zip(response.force_names, loads, strict=True)
        if name in driven
    ]
    return Part({"pads": pads, "cylinders": cylinders}, _pulled(boom, pads))


def beside_published(boom: Boom, found: BoomFrequencies) -> Part:
    """``published_frequencies``: the first one where it is published, and what each model has there.

    What is published beyond this boom's reach is left out, with a line.
    """
    published = boom.published.frequencies if boom.published else ()
    low, high, slack = found.reach[0], found.reach[-1], BESIDE * found.reach[-1]
    within = [one for one in published if low - slack <= one.reach <= high + slack]
    rows = [
        {"reach": one.reach, "published": one.first}
        | {model: float(np.interp(one.reach, found.reach, f[:, 0])) for model, f in found.models.items()}
        for one in within
    ]
    beyond = ", ".join(f"{one.reach:g}" for one in published if one not in within)
    said = f"published frequencies at a reach of {beyond} m are left out: this boom reaches {low:.6g} to {high:.6g} m"
    return Part({"published_frequencies": rows} if rows else {}, [said] if beyond else [])


def frequencies(system: System, x: Array) -> Array:
    """The lowest natural frequencies (S, f) in Hz of a small system at places x (S, sides) m, every contact closed."""
    assembly = Assembly(system)
    return np.array([assembly.frequencies(at, CURVES) for at in x])


def on_the_way(boom: Boom, t: Array, count: int) -> NDArray[np.int64]:
    """Steps (S,) at which the boom first reaches so far, evenly from its shortest to its longest."""
    reach = boom.reach(t)
    goals = np.linspace(reach.min(), reach.max(), count if np.ptp(reach) > 1e-9 * reach.max() else 1)
    return np.array(list(dict.fromkeys(int(np.argmin(np.abs(reach - goal))) for goal in goals)))


def _pulled(boom: Boom, pads: list[dict[str, Any]]) -> list[str]:
    """Joints with pads that hold both ways and are pulled, a line each: the one that is pulled most, how many more."""
    largest, said = max((max(pad["max"], -pad["min"]) for pad in pads), default=0.0), []
    for part in boom.sections[1:]:
        assert part.joint is not None
        ends, found = list[str](), list[dict[str, Any]]()
        for end in ("tail", "mouth"):
            own = [pad for pad in pads if pad["name"].startswith(f"{part.name} {end}") and _both_ways(part.joint, end)]
            pulled = [pad for pad in own if -pad["min"] > PULLED * max(pad["max"], 0.1 * largest)]
            found += pulled
            ends += [f"sections.{part.name}.joint.{end}"] * bool(pulled)
        if found:
            most = min(found, key=lambda pad: float(pad["min"]))
            more = f", and {len(found) - 1} more" if len(found) > 1 else ""
            said.append(
                f"pads of the joint of {part.name} hold both ways and pull: {most['name']} with up to "
                f"{newton(-most['min'])} at {most['t_min']:g} s{more}; if they can only push, set unilateral = true "
                f"in {' and '.join(ends)}"
            )
    return said


def _both_ways(joint: Joint, end: str) -> bool:
    return any(not ring.unilateral for ring in getattr(joint, end))


def with_forces_of_both(responses: Mapping[str, Response]) -> Mapping[str, Response]:
    """The responses with the forces that all of them know, as in the reduced model's order."""
    found, reduced = dict(responses), responses["reduced"]
    if "full" in found:
        found["reduced"], found["full"] = with_common_forces(reduced, found["full"])
    return found
