r"""How far the reduced sections of a boom are off, without a full one.

A second run has more coordinates in every section: its enrichment modes, and attachment modes
(`pmr.reduced.attachment`), which give what is left out its inertia and damping in the directions of all loads that the
section bore in the first run.

.. math:: \text{estimate} = 1.25 \lVert y_{\text{second}} - y_r \rVert

with the margin of one body's estimate (`pmr.compare.estimate`).  Where pads land and lift off an impact a moment
earlier changes all that follows: a third run, without the enrichment modes, has to be near the second one then.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare import errors
from pmr.compare.attached import UnsettledError, lifting, pressing, settled
from pmr.compare.boom_runs import Seen, outputs, run_from_rest
from pmr.compare.booms import columns_of, quantities, respond, tip_columns, with_friction
from pmr.compare.estimate import MARGIN
from pmr.compare.outputs import Floors, differences
from pmr.reduced.attachment import with_attachment_modes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.simulation import Excitation
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoomEstimate:
    """Estimated errors of a boom's reduced model, with margin."""

    # fractions: of `pmr.compare.booms.quantities`, of velocities and the worst probe, and of probes by their names
    errors: Mapping[str, float]
    sections: Mapping[str, float]  # along each section
    largest: float  # m: largest error of any output at any time
    error: Array  # (T, d) m: what is missing at the tip, as far as these runs know, without margin
    seconds: float
    unknown: Mapping[str, str] = field(default_factory=dict)  # none: what can't be told of one kind isn't of any

    def of(self, kind: str) -> float:
        """Error of one kind of output; 0 where there is no such output."""
        return self.errors.get(kind, 0.0)


def no_estimate(modal: Mapping[str, ReducedModel]) -> str | None:
    """Why the errors of a boom of such sections can't be estimated, in words; None where they can."""
    for name, body in modal.items():
        if body.carriers is None or body.carriers.flexibility is None:
            return f"{name} has no residual flexibility, and what its modes leave out is lost"
        if body.carriers.inertia is None or body.enrichment is None:
            return (
                f"{name} keeps no enrichment modes: they come with reduction.estimate = true, on a mesh that has more"
            )
    return None


def estimate(
    boom: Scene, modal: Mapping[str, ReducedModel], system: System, excitation: Excitation, run: SystemTrajectory
) -> BoomEstimate:
    """From the run of the boom's reduced model; one or two more are made here, in as many parts of a step.

    `modal` are the sections on their free modes, those of the system before they had modes of their cylinders.

    Raises ValueError if there is no estimate (`no_estimate`); InputError or SimulationError as `systems.simulate`;
    SimulationError too if what two richer models say of an impact differs.
    """
    begin = time.perf_counter()
    if why := no_estimate(modal):
        raise ValueError(f"no estimate: {why}")
    loads = loads_borne(system, run)
    richer = {name: with_attachment_modes(extended(body), loads[name]) for name, body in modal.items()}
    fuller = replace(system, bodies=richer)
    second = run_from_rest(fuller, excitation)
    own, better = (with_friction(boom, system.contacts, respond(*one)) for one in ((system, run), (fuller, second)))
    if lifting(run.forces[:, ~np.isnan(system.clearance)]):
        other = {name: with_attachment_modes(body, loads[name]) for name, body in modal.items()}
        pushing = [force_of(one.name) for one in system.contacts if one.clearance is not None]
        third = replace(system, bodies=other)
        found = with_friction(boom, system.contacts, respond(third, run_from_rest(third, excitation)))
        _check_settled(own, better, found, pushing)
    measured = quantities(boom, own)
    told = errors.errors({"reduced": own, "full": better}, errors.relative_error, quantities=measured)[
        "reduced_vs_full"
    ]
    rated, fully = (outputs(boom, *of, Seen(rates=True)) for of in ((system, run), (fuller, second)))
    nothing = Floors(0.0, 0.0, np.zeros(len(rated.units)))
    told |= differences(rated, fully, nothing, ["velocity", *["probe"] * bool(rated.units)])
    missing = better.displacement - own.displacement
    return BoomEstimate(
        {kind: MARGIN * size for kind, size in told.items()},
        {name: MARGIN * _along(columns_of(name, own), own, better) for name in boom.names},
        float(MARGIN * np.abs(missing).max()),
        missing[:, tip_columns(system)],
        time.perf_counter() - begin,
    )


def loads_borne(system: System, run: SystemTrajectory) -> dict[str, Array]:
    """What contacts and loads press on the carriers and inputs of each body with, (S, K + i) in N."""
    found, first = {}, 0
    for name, body in system.reduced.items():
        rows = [system.row(side.place) for side in system.sides if side.place.body == name]
        last = first + len(body.input_names)
        assert body.carriers is not None
        found[name] = pressing(body.carriers, rows, run.bodies[name], run.loads[:, first:last])
        first = last
    return found


def _check_settled(own: Response, better: Response, other: Response, pushing: Sequence[str]) -> None:
    for kind in ("displacement", "slider_force"):
        one, second, third = (getattr(response, kind) for response in (own, better, other))
        told, apart = (errors.relative_error(response, second) for response in (one, third))
        if not settled(told, apart):
            peaks = [max(float(one.force(name, 0).max()) for name in pushing) for one in (own, better, other)]
            raise UnsettledError(told, apart, peaks)


def _along(columns: Sequence[int], own: Response, better: Response) -> float:
    return errors.relative_error(own.displacement[:, columns], better.displacement[:, columns])
