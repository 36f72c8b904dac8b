"""Parametric model reduction of sliding and telescopic structures.

The boundary conditions of a beam that slides through pads change all the time.  `pmr` reduces such a beam with one
basis for all positions; the sliders are a few constraint rows that move::

    import pmr

    scene = pmr.load_scene("boom.toml", ["reduction.coordinates=8"])
    outcome = pmr.run(scene)                      # reduces, simulates, compares; needs FEniCSx
    print(outcome.result.summary["errors"])

    pmr.reduce(scene).reduced.save("reduced.npz")  # the reduced model alone; needs FEniCSx

    model = pmr.ReducedModel.load("reduced.npz")  # on any machine, without FEniCSx
    response = pmr.simulate(scene, model)
    response.t, response.displacement

    boom = pmr.load_scene("boom_three")           # several sections; workflows go by their names
    response = pmr.simulate(boom, pmr.reduce(boom).reduced)  # a model for each section

    full = pmr.full_model(scene)                  # M, D, K, B, rows and outputs as matrices of SciPy
    own = pmr.reduce(scene, basis=V)              # on vectors V (n, r) of your own; own.basis, own.reconstruct(states)

    given = pmr.from_matrices(M, K, points, groups)  # matrices of another program
    given.save("boom.npz")                        # body.model = "matrices", mesh.file = "boom.npz"

The names of this module stay the same; everything else may change between versions (docs/stays.md).
"""

from typing import TYPE_CHECKING

from pmr.errors import FORMER, declared_names, lazy_names

if TYPE_CHECKING:
    from pmr.compare.simulated import simulate, simulate_with_states
    from pmr.errors import ConvergenceError, InputError, SimulationError
    from pmr.files.matrices import from_matrices
    from pmr.observe.linear import linearize
    from pmr.observe.observer import Observer
    from pmr.observe.position import PositionObserver
    from pmr.pipeline import full_model, reduce, run
    from pmr.results import Response, RunResult
    from pmr.scene import load_any as load_scene
    from pmr.simulation.native.stepper import Stepper
    from pmr.system.body import project
    from pmr.system.reduced_model import ReducedModel
    from pmr.system.system import System

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError", "InputError", "Observer", "PositionObserver", "ReducedModel", "Response", "RunResult",
    "SimulationError", "Stepper", "System", "from_matrices", "full_model", "linearize", "load_scene", "project",
    "reduce", "run", "simulate", "simulate_with_states",
]  # fmt: skip
if not TYPE_CHECKING:  # to type checkers no other name exists
    __getattr__ = lazy_names("pmr", declared_names(__file__), former=FORMER)  # FEniCSx takes seconds, and may be absent


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
