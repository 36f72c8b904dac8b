"""Expressions of a study file: arithmetic, and nothing else."""

import math
from pathlib import Path

import plain_machines
import pytest
from chart_beside_full import at_rest

from pmr import InputError
from pmr.scene import load_any
from pmr.simulation.statics.postures import HOOK, WEIGHT
from pmr.studies.allowed import Place
from pmr.studies.further_limits import AtRest, amounts_of_states, check_names, compile_expression, names_in_tables

AT = {"load": 3.0, "force": {"fly tail top": -4.0, "ring": 2.0}}


def of(text: str) -> float:
    return compile_expression(text, ("load",), ("force",))(AT)


def test_arithmetic_is_that_of_python() -> None:
    assert of("2 * load ** 2 - 1 / 4") == 17.75
    assert of('max(abs(force["fly tail top"]), force["ring"], -load)') == 4.0
    assert of('hypot(load, force["fly tail top"]) + sqrt(4) + cos(0)') == 8.0
    assert of("-min(load, 1e-3) + sin(load)") == pytest.approx(math.sin(3.0) - 1e-3)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')", "load.__class__", "(lambda: 1)()", "[load for load in force]", "force",
        'force["ring"].real', 'open("file")', "load if load else 1", "load < 1", "True", "'text'", "abs()",
        "max(1, key=abs)", "other", "load +", "1\n2", "(" * 300 + "1" + ")" * 300, "-" * 999 + "1", "1 + " * 400 + "1",
        "load\0", "9" * 400, "load + 9e999", "-(" + "9" * 400 + ")",
    ],
)  # fmt: skip
def test_what_is_no_arithmetic_over_what_is_known_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ValueError, match=r".") as refused:
        of(text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("text", ["9 ** 9 ** 9", "1 / 0", 'force["none"]', "(-1) ** 0.5"])
def test_what_has_no_value_fails_at_once(text: str) -> None:
    with pytest.raises((ArithmeticError, KeyError, ValueError)):
        of(text)


TELESCOPE = Path(__file__).parent / "kinds" / "telescope.toml"
ROTATION = ["sections.fly.observe.rotation=true", "sections.middle.observe.rotation=true"]
PROBES = ["sections.fly.probes=[{name='corner',at=[2.0,0.11,0.16],measures=['stress']}]"]
RIGID = ["sections.base.supports.luffing cylinder.stiffness='rigid'"]
HELD = [
    "sections.base.supports=[{name='pin',directions=['x','y','z','rx','rz']}]",
    "frame.cylinder={foot=[0.5,-1.0],lug=[1.5,-0.2],stiffness=1e8}",
    "frame.second_order=false",
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "changes"),
    [(TELESCOPE, ROTATION), (TELESCOPE, RIGID), (plain_machines.CRANE, PROBES), (plain_machines.CRANE, HELD)],
    ids=["planar", "rigid", "in space", "held by a cylinder"],
)
def test_names_that_are_checked_without_a_model_are_those_of_its_states(file: Path, changes: list[str]) -> None:
    """Forces of rigid supports among them, by the names that `which` of other limits chooses from."""
    scene = load_any(file, [*changes, "compare.against=[]"])
    at, states = at_rest(scene, [0.3], {"middle": [3.0], "fly": [2.0]}), list[AtRest]()
    place = Place(at, 0, [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in at.loads.names], 9.80665)

    def record(state: AtRest) -> float:
        states.append(state)
        return 0.0

    amounts_of_states(record, "limits.own", None, at, 0)(place.equilibria.states([100.0]))
    ((state,), names) = states, names_in_tables(scene)
    forces = {**state.forces, **state.supports}
    assert set(forces) == set(names["force"]) and not any("pin" in name for name in state.forces)
    probes = {
        name for name in names["output"] if any(name == f"fly: {probe.name}" for probe in scene.sections[-1].probes)
    }
    assert {name for name in state.outputs if " stress " not in name} == set(names["output"]) - probes
    for table, of in (("force", forces), ("output", state.outputs)):
        for name in of:
            check_names("own", f"{table}[{name!r}]", scene)
        with pytest.raises(InputError, match=rf"nowhere': {table} has "):
            check_names("own", f"{table}['nowhere']", scene)
    for axis in ("x", "z"):
        reaction = state.outputs[f"reaction of base: pin {axis}"]
        assert state.supports[f"base pin {axis}"] == reaction and abs(reaction) > 1.0
