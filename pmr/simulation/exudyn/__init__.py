"""Exudyn as a simulator, and the ANCF reference in it; Exudyn itself is imported when a name is first used."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from pmr.errors import declared_names, lazy_names
from pmr.errors.environment import import_package

if TYPE_CHECKING:
    from pmr.simulation.exudyn.equations import NodeCoordinate as NodeCoordinate
    from pmr.simulation.exudyn.formulations import Formulation as Formulation
    from pmr.simulation.exudyn.free_base import OnBody as OnBody
    from pmr.simulation.exudyn.hook import Hook as Hook
    from pmr.simulation.exudyn.hook import add_hook as add_hook
    from pmr.simulation.exudyn.items import add_pre_step_function as add_pre_step_function
    from pmr.simulation.exudyn.simulator import add_sliding_body as add_sliding_body
    from pmr.simulation.exudyn.simulator import add_system as add_system
    from pmr.simulation.exudyn.simulator import simulate_system as simulate_system
    from pmr.simulation.exudyn.solver import add_drawing as add_drawing
    from pmr.simulation.exudyn.solver import add_sensors as add_sensors

#: Formulations by the names of the simulators of a scene.
FORMULATIONS: dict[str, Formulation] = {
    "exudyn": "springs",
    "exudyn-multiplier": "multipliers",
    "exudyn-callback": "callbacks",
}

#: An InputError is raised where Exudyn is not installed.
if not TYPE_CHECKING:  # to type checkers no other name exists
    __getattr__ = lazy_names(__name__, declared_names(__file__), before=partial(import_package, "exudyn"))
