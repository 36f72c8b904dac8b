"""What the motion of a reduced system says by itself, as parts of summary.json."""

from __future__ import annotations

from pmr.compare import boom_figures, fatigue, frame_energy, luffing_cylinder, moving_frame, pad_forces, ropes, summary
from pmr.compare.estimated import SimulatedSystem
from pmr.compare.responses import Simulations
from pmr.compare.summary import Part
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.simulation import Excitation, contact_step


def parts_of_motion(
    scene: Scene,
    moved: SimulatedSystem,
    made: Simulations,
    natural: Frequencies,
    step: Part,
) -> list[Part]:
    """Forces of contacts and supports, the step's error, published frequencies, and how fine the sampling is.

    `made` is what simulators say of `moved`; `natural` are frequencies on the way; `step` says what its error is.
    """
    excitation, system = Excitation.of(scene), moved.system
    omega = contact_step.contact_frequency(system, excitation)
    of_forces = [
        pad_forces.part(scene, system, made.first.response),
        ropes.part(scene, made.first.response),
        luffing_cylinder.part(scene, made.first.response),
        fatigue.part(scene, made.first.response),
    ]
    others = [
        boom_figures.beside_published(scene, natural),
        Part(
            contact_step.summary(omega, made.made),
            contact_step.warnings(omega, excitation.stepping),
        ),
        summary.sampling(excitation),
        moving_frame.frame(scene, system, excitation, natural),
        frame_energy.energy(scene, system, excitation, made.first.run),
    ]
    return [*of_forces, step, *others]
