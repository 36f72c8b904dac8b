"""What the motion of a system says by itself, as parts of summary.json and as warnings."""

from __future__ import annotations

from pmr.compare import boom_figures, fatigue, frame_energy, luffing_cylinder, moving_frame, pad_forces, ropes, summary
from pmr.compare.estimated import SimulatedSystem
from pmr.compare.responses import Simulations
from pmr.compare.summary import Part
from pmr.results import Frequencies, Response
from pmr.scene import Scene
from pmr.scene.hints import hints
from pmr.simulation import Excitation, contact_step
from pmr.system.system import System


def parts_of_forces(scene: Scene, system: System, response: Response) -> list[Part]:
    """Forces of pads, cylinders, supports, ropes and luffing cylinder, and fatigue, in a system's response."""
    return [
        pad_forces.part(scene, system, response),
        ropes.part(scene, response),
        luffing_cylinder.part(scene, response),
        fatigue.part(scene, response),
    ]


def warnings_of_response(scene: Scene, system: System, response: Response) -> tuple[str, ...]:
    """Warnings of a run with this response of its system that take no other model, the gravest first."""
    excitation = Excitation.of(scene)
    omega = contact_step.contact_frequency(system, excitation)
    parts = [
        Part(grave=hints(scene)),
        *parts_of_forces(scene, system, response),
        Part(warnings=contact_step.warnings(omega, excitation.stepping)),
        summary.sampling(excitation),
        summary.theory(scene, {"motion": response}),
    ]
    return tuple(summary.combine_parts(parts)["warnings"])


def parts_of_motion(
    scene: Scene,
    simulated: SimulatedSystem,
    simulations: Simulations,
    natural: Frequencies,
    step: Part,
) -> list[Part]:
    """Forces of contacts and supports, the step's error, published frequencies, and how fine the sampling is.

    `simulations` are those of `simulated`; `natural` are frequencies on the way; `step` says what its error is.
    """
    excitation, system = Excitation.of(scene), simulated.system
    omega = contact_step.contact_frequency(system, excitation)
    other_parts = [
        boom_figures.beside_published(scene, natural),
        Part(
            contact_step.summary(omega, simulations.made),
            contact_step.warnings(omega, excitation.stepping),
        ),
        summary.sampling(excitation),
        moving_frame.frame(scene, system, excitation, natural),
        frame_energy.energy(scene, system, excitation, simulations.first.run),
    ]
    return [*parts_of_forces(scene, system, simulations.first.response), step, *other_parts]
