"""What the motion of a reduced system says by itself, as parts of summary.json."""

from __future__ import annotations

from pmr.compare import boom_figures, fatigue, frame_energy, luffing_cylinder, moving_frame, pad_forces, ropes, summary
from pmr.compare.accuracy.order import Choice
from pmr.compare.estimated import SimulatedSystem, step_part
from pmr.compare.responses import Simulations
from pmr.compare.summary import Part
from pmr.errors.environment import Clock
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.simulation import Excitation, contact_step


def parts_of_motion(
    scene: Scene,
    moved: SimulatedSystem,
    made: Simulations,
    natural: Frequencies,
    clock: Clock,
    choice: Choice | None = None,
) -> list[Part]:
    """Forces of contacts and supports, the step's error, published frequencies, and how fine the sampling is.

    `made` is what simulators say of `moved`; `natural` are frequencies on the way; with the step of a `choice` its
    error is known.
    """
    excitation, known = Excitation.of(scene), None if choice is None else choice.found.step_error
    system, marched = moved.system, scene.simulation.simulators[0] == "march"
    omega = contact_step.contact_frequency(system, excitation)
    return [
        pad_forces.part(scene, system, made.first.response),
        ropes.part(scene, made.first.response),
        luffing_cylinder.part(scene, made.first.response),
        fatigue.part(scene, made.first.response),
        step_part(
            moved if marched else SimulatedSystem(system, excitation),
            natural.models["reduced"],
            clock,
            scene.accuracy is not None,
            known,
        ),
        boom_figures.beside_published(scene, natural),
        Part(
            contact_step.summary(omega, made.made),
            contact_step.warnings(omega, excitation.stepping),
        ),
        summary.sampling(excitation),
        moving_frame.frame(scene, system, excitation, natural),
        frame_energy.energy(scene, system, excitation, made.first.run),
    ]
