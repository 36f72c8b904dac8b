from dataclasses import replace
from typing import get_args

import pytest

from pmr import InputError, scene
from pmr.scene.choice import REFERENCE, SIMULATORS, SimulatorNeeds, refuse_unsupported
from pmr.scene.run_settings import SimulatorName

NEEDS = {
    "rows_that_push": SimulatorNeeds(pushing_rows=("top",), flexible_rows=("top",)),
    "rows_that_give_way": SimulatorNeeds(flexible_rows=("slider",)),
}


def test_every_simulator_of_a_scene_declares_what_it_can_do() -> None:
    assert [name for name, can in SIMULATORS.items() if can.reduced_models] == list(get_args(SimulatorName))


@pytest.mark.parametrize("name", SIMULATORS)
@pytest.mark.parametrize("what", NEEDS)
def test_what_is_not_declared_is_refused_with_a_key_and_who_can(name: str, what: str) -> None:
    refuse_unsupported(name, SimulatorNeeds())
    if getattr(SIMULATORS[name], what):
        refuse_unsupported(name, NEEDS[what])
        return
    with pytest.raises(InputError) as caught:
        refuse_unsupported(name, NEEDS[what])
    assert (caught.value.key, caught.value.value) == ("simulation.simulators", name)
    assert caught.value.allowed.startswith("march ") and "petsc is allowed" not in caught.value.allowed
    with pytest.raises(InputError, match=r"compare\.against = \['full'\]: \[\] is allowed"):
        refuse_unsupported(name, NEEDS[what], REFERENCE)


def test_what_no_simulator_can_names_the_key_that_mends_it() -> None:
    pushing = SimulatorNeeds(pushing_rows=("top",), rigid_pushing_rows=("top",))
    with pytest.raises(InputError, match=r"reduction\.flexibility = False: top only push and are rigid"):
        refuse_unsupported("march", pushing)
    undamped = SimulatorNeeds(rigid_moving_rows=("slider",), rho_inf=1.0)
    for name in SIMULATORS:
        with pytest.raises(InputError, match=r"time\.rho_inf = 1\.0: less than 1 .* rigid row slider moves.*allow 1$"):
            refuse_unsupported(name, undamped)
        refuse_unsupported(name, replace(undamped, rho_inf=0.99))
    with pytest.raises(InputError, match=r"allow 1, or compare\.against = \[\]"):
        refuse_unsupported("march", undamped, REFERENCE)


def test_rigid_pads_that_only_push_need_something_that_gives_way() -> None:
    pads = "pads=[{name='tail',at=0.15,faces={top=[0.1],bottom=[0.1]},length=0.1,width=0.05,stiffness='rigid',"
    pads += "unilateral=true,moving=true}]"
    asked = [pads, "compare.against=[]"]
    scene.load("boom_beam", asked)
    with pytest.raises(InputError, match=r"reduction\.flexibility = False: tail only push and are rigid"):
        scene.load("boom_beam", [*asked, "reduction.flexibility=false"])
