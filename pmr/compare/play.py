"""Effect of the play of pads on the largest values of a run: its reduced system, simulated once with another play."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pmr.compare.evaluation import append_machine
from pmr.compare.forces import pads_on_faces, support_rows
from pmr.compare.responses import Simulation, simulate_by
from pmr.files.arrays import Summary
from pmr.results import Response
from pmr.results.response import Extremes
from pmr.scene import Scene
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.mechanism import CYLINDER
from pmr.simulation import Excitation
from pmr.system.states import states_of
from pmr.system.system import System


@dataclass(frozen=True)
class VariedPlay:
    """Simulation of a reduced system whose pads have another play than in its scene."""

    gap: float  # m: play from face to face; 0 if the play of the scene is taken away
    simulation: Simulation

    def summary(self, scene: Scene, response: Response, walls: Summary, varied_walls: Summary) -> dict[str, Any]:
        """Return ``budget.play`` of summary.json for the run of a scene that has this response.

        ``gap`` in m is the play of the other run, and ``rows`` have the largest ``value`` of the run, and the one that
        is ``varied``, the largest value of the other run; ``quantity`` is a key of `pmr.results.quantities.QUANTITIES`,
        and ``name`` that of a part or a direction.  Values have the unit of their quantity.  `walls` and `varied_walls`
        may have ``wall_stress``, the largest stress in walls at pads of both runs.
        """
        value, varied = largest_sizes(scene, response), largest_sizes(scene, self.simulation.response)
        for sizes, entries in ((value, walls), (varied, varied_walls)):
            sizes |= {("wall_stress", ""): entries["wall_stress"]["value"]} if "wall_stress" in entries else {}
        rows = [
            {"quantity": key, "name": name, "value": size, "varied": varied[key, name]}
            for (key, name), size in value.items()
            if (key, name) in varied
        ]
        return {"gap": self.gap, "rows": rows}


def simulate_varied_play(scene: Scene, system: System, excitation: Excitation) -> VariedPlay | None:
    """Simulate a reduced system without the play of its pads or, if they have none, with the play `compare.play`.

    All of this play is at the faces on top and left, so that each section lies on those at bottom and right, where a
    start at rest finds it: how far sections turn in each other depends on the sum of the play on both sides.  States
    are those at the times of the scene's recovery and, where the motion is kept, at which the force of each contact is
    largest: sections with play beat on their pads, and such a peak is short.  The result is None if no pad only pushes,
    or if `compare.play` is 0 and the scene states no play.
    """
    pushing = {contact.name: contact for contact in system.contacts if contact.clearance is not None}
    pads = {name: of for name, of in pads_on_faces(scene).items() if name in pushing}
    gap = 0.0 if any(pushing[name].clearance for name in pads) else scene.compare.play
    play = {name: gap if of.face == "left" or of.face.startswith("top") else 0.0 for name, of in pads.items()}
    contacts = tuple(replace(of, clearance=play.get(of.name, of.clearance)) for of in system.contacts)
    if contacts == system.contacts:
        return None
    other = replace(system, contacts=contacts)
    steps = scene.recovered_steps
    simulation = simulate_by(scene, other, excitation, scene.simulation.simulators[0], steps.tolist())
    if simulation.run is not None and len(steps):
        steps = np.union1d(steps, simulation.run.forces.argmax(axis=0))
        simulation = replace(simulation, states=states_of(other, simulation.run, steps))
    return VariedPlay(gap, replace(simulation, response=append_machine(scene, simulation.response)))


def largest_sizes(scene: Scene, response: Response) -> dict[tuple[str, str], float]:
    """Return the largest sizes of tip displacements, forces, stress at probes, and the use of the support polygon.

    They are named by the key of their quantity and by a direction or a part; the largest of all pads has no part.
    Histories that are round-off are left out.
    """
    sizes = dict[tuple[str, str], float]()
    for direction in ("y", "z"):
        tip = float(np.abs(response.of("tip", direction=direction)).max(initial=0.0))
        sizes |= {("tip", direction): tip} if tip > response.round_off else {}
    forces = {("pad_force", ""): response.of("pad"), ("cylinder_force", ""): response.of("cylinder")}
    if CYLINDER in response.other_names:
        forces["luffing_force", ""] = response.other(CYLINDER)
    largest = {key: float(np.abs(of).max(initial=0.0)) for key, of in forces.items()}
    for row in support_rows(scene, response):
        if not row["name"].endswith(LUFFING_CYLINDER):
            largest["support", row["name"]] = Extremes.from_summary(row).size
    sizes |= {key: size for key, size in largest.items() if size > response.force_floor}
    stresses = [response.other(of.name) for of in response.outputs if of.kind == "probe" and of.unit == "Pa"]
    for key, histories in (("probe", stresses), ("tipping", response.of("tipping"))):
        sizes |= {(key, ""): size} if (size := float(np.abs(histories).max(initial=0.0))) else {}
    return sizes
