"""A saved reduced model under a scene: what `pmr run` says of it, less what needs the full model."""

from __future__ import annotations

import numpy as np

from pmr.compare.estimated import reduction_error, step_part
from pmr.compare.frequencies import reduced_frequencies
from pmr.compare.made_for import check_made_for
from pmr.compare.responses import check_installed, simulate
from pmr.compare.summary import Part, contact, driven, gathered, made_with, pads, simulated, trusted
from pmr.errors import InputError
from pmr.errors.environment import Clock
from pmr.reduced.model import ReducedModel
from pmr.results import BodyResult, Frequencies, Loads, Paths, RunResult, Shapes
from pmr.scene import Scene
from pmr.scene.names import ALONE
from pmr.simulation import Excitation

#: Frequencies, and places along the path at which they are found.
FREQUENCIES, POSITIONS = 6, 11


def simulate_saved(reduced: ReducedModel, scene: Scene) -> RunResult:
    """Simulate a reduced model under another scene's path, loads and time stepping, by the simulators that it names.

    There are no errors in the result but what is estimated without the full model, and no singular values.  Raises
    InputError if the scene describes another body than the model's, loads and inputs differ, the path leaves the
    model's, or a simulator can't do what is asked;
    SimulationError if a step fails.
    """
    check_installed(scene)
    excitation = Excitation.of(scene)
    if set(excitation.loads) != set(reduced.input_names):
        allowed = f"the model's inputs are allowed: {', '.join(reduced.input_names)}"
        raise InputError("scene", "loads", list(excitation.loads), allowed)
    check_made_for(reduced, scene)
    excitation.along(reduced.domain)
    clock = Clock()
    simulations = simulate(scene, reduced, {}, clock)
    response = simulations.responses["reduced"]
    made = {name: reduced.provenance.get(name) for name in ("scene_hash", "basis", "versions")}
    figures = {
        "model": made,
        "max_displacement": float(np.abs(response.displacement).max()),
        "coordinates": {"reduced": reduced.size},
        "simulators": {"reduced": simulations.first},
    }
    s = np.unique(np.linspace(excitation.s.min(), excitation.s.max(), POSITIONS))
    found = reduced_frequencies(reduced, s, min(FREQUENCIES, reduced.size))
    estimated = reduction_error(scene, reduced, clock)
    parts = [
        made_with(scene),
        Part(figures),
        simulated(simulations.seconds, simulations.agreement, {}),
        driven(excitation),
        estimated.part,
        step_part(scene, reduced, found, clock),
        pads(scene, response),
        contact(reduced, excitation),
        trusted({}, simulations.responses),
    ]
    shapes = Shapes(np.zeros(0), reduced.output_positions, reduced.outputs)
    return RunResult(
        scene,
        gathered(parts),
        simulations.responses,
        Paths(tuple(excitation.paths), excitation.s, excitation.rates),
        Loads(reduced.input_names, reduced.input_units, excitation.forces(reduced.input_names)),
        Frequencies(s, s[:, None], {"reduced": found / (2.0 * np.pi)}),
        {ALONE: BodyResult(shapes)},
        tip_error=estimated.band,
    )
