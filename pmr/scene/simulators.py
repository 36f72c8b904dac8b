"""What each simulator can do, by the names that scenes give them; what it can't is refused here, and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pmr.errors import InputError


@dataclass(frozen=True)
class Needs:
    """Needs of a body on its way that a simulator has to meet; rows by their names."""

    pushing: tuple[str, ...] = ()  #: Rows that only push
    #: Those of them that neither a pad's stiffness nor residual flexibility lets give way
    rigid_pushing: tuple[str, ...] = ()
    giving: tuple[str, ...] = ()  #: Rows that give way
    rigid_moving: tuple[str, ...] = ()  #: Rigid rows that travel along a path
    rubbing: tuple[str, ...] = ()  #: Rows with friction
    machine: tuple[str, ...] = ()  #: Directions in which the machine below moves by itself
    rho_inf: float = 0.0  #: Spectral radius at infinite frequency


@dataclass(frozen=True)
class Capabilities:
    """Capabilities of a simulator; it integrates by generalized-alpha, which damps less than rho_inf says."""

    rows_that_push: bool = False
    rows_that_give_way: bool = True
    rows_that_rub: bool = False
    machine_that_moves: bool = False
    reduced_models: bool = True  # it is one of `simulation.simulators`
    package: str | None = None  # that it needs installed


#: By the names of `simulation.simulators` and `simulation.full`.
SIMULATORS = {
    "march": Capabilities(rows_that_push=True, rows_that_rub=True, machine_that_moves=True),
    "exudyn": Capabilities(rows_that_push=True, rows_that_rub=True, package="exudyn"),
    "exudyn-multiplier": Capabilities(package="exudyn"),
    "exudyn-callback": Capabilities(rows_that_give_way=False, package="exudyn"),
    "petsc": Capabilities(rows_that_push=True, rows_that_rub=True, reduced_models=False),
}


@dataclass(frozen=True)
class Asked:
    """Place where a simulator is named: file or ``"scene"``, key and value there."""

    source: str
    key: str
    value: Any


#: The full model as a reference.
REFERENCE = Asked("scene", "compare.against", ["full"])


def refuse(name: str, needs: Needs, place: Asked | None = None) -> None:
    """Refuse, by InputError, what the simulator of this name can't do, in a line that names the key that mends it."""
    can, place = SIMULATORS[name], place or Asked("scene", "simulation.simulators", name)
    lacking = {
        "rows_that_push": (needs.pushing, f"knows no rows that only push ({', '.join(needs.pushing)})"),
        "rows_that_give_way": (needs.giving, f"knows no rows that give way ({', '.join(needs.giving)})"),
        "rows_that_rub": (needs.rubbing, f"knows no friction ({', '.join(needs.rubbing)})"),
        "machine_that_moves": (needs.machine, f"knows no machine that moves by itself ({', '.join(needs.machine)})"),
    }
    for capability, (needed, reason) in lacking.items():
        if needed and not getattr(can, capability):
            able = [
                simulator for simulator, has in SIMULATORS.items() if has.reduced_models and getattr(has, capability)
            ]
            instead = "[]" if place is REFERENCE else " or ".join(able)
            raise InputError(place.source, place.key, place.value, f"{instead} is allowed: {name} {reason}")
    if needs.rigid_pushing:
        allowed = (
            f"{', '.join(needs.rigid_pushing)} only push and are rigid: true, or a stiffness in N/m of the pads, is "
            "allowed; the force of an impact of rigid parts is no number"
        )
        raise InputError("scene", "reduction.flexibility", False, allowed)
    if needs.rho_inf == 1.0 and needs.rigid_moving:
        without = ", or compare.against = []" if place is REFERENCE else ""
        allowed = (
            f"less than 1 is allowed while the rigid row {', '.join(needs.rigid_moving)} moves: an algebraic "
            "constraint (index 3) has multipliers that nothing damps, and they grow without bound; pads that give "
            f"way, or a residual flexibility, allow 1{without}"
        )
        raise InputError("scene", "time.rho_inf", needs.rho_inf, allowed)
