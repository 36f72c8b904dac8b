"""Forces beside the axis and differences of temperature beside closed forms of beams."""

from typing import Any

import numpy as np
import plain_machines
import pytest

import pmr
from pmr import InputError, Response
from pmr.models.profile_section import section_of
from pmr.scene import Scene, load_any
from pmr.scene.checks import check_scene

L, ALPHA, WARM = 6.0, 1.2e-5, 25.0
BOX = {"length": L, "width": 0.22, "height": 0.32, "wall": 0.006}
WARMER = "acts='temperature',signal=20.0,"
PADS = [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}]


def still(amount: float) -> dict[str, Any]:
    return {"kind": "constant", "amount": amount}


def scene(model: str, loads: list[dict[str, Any]], **changes: Any) -> Scene:
    """A cantilever of one box, clamped at its tail, in equilibrium from the start."""
    section: dict[str, Any] = {
        "body": {"model": model, "box": BOX},
        "mesh": {"elements": 6},
        "supports": [{"name": "clamp", "on": "tail", "kind": "clamped"}],
        "pads": PADS,
        "slider": {"path": still(3.0)},
        "loads": loads,
        "reduction": {"coordinates": 8, "estimate": False},
    }
    built = Scene.model_validate(
        {
            "title": "on site",
            **section,
            **changes,
            "start": "equilibrium",
            "time": {"end": 0.02, "step": 0.01},
            "compare": {"against": [], "richer": "none"},
        }
    )
    check_scene(built)
    return built


def at_rest(of: Scene) -> Response:
    return pmr.simulate(of, pmr.reduce(of).reduced)


def warmth(direction: str = "z", **more: Any) -> dict[str, Any]:
    return {"name": "sun", "acts": "temperature", "direction": direction, "signal": still(WARM), **more}


pytestmark = [pytest.mark.slow, pytest.mark.numerical]


@pytest.mark.parametrize(("model", "direction"), [("beam2d", "z"), ("beam3d", "z"), ("beam3d", "y")])
def test_a_cantilever_that_is_warmer_on_one_side_bends_by_the_closed_form(model: str, direction: str) -> None:
    """w = -alpha dT x^2 / 2 h, away from the warmer side, whatever the bending stiffness."""
    found = at_rest(scene(model, [warmth(direction, expansion=ALPHA)]))
    depth = BOX["height"] if direction == "z" else BOX["width"]
    chosen = [k for k, of in enumerate(found.outputs[: len(found.output_names)]) if of.direction == direction]
    expected = -ALPHA * WARM / depth * found.x[chosen] ** 2 / 2.0
    assert found.displacement[0, chosen] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert np.abs(expected).max() > 1e-2


@pytest.mark.parametrize("model", ["beam2d", "beam3d"])
def test_a_warm_beam_that_is_held_at_both_ends_presses_on_its_supports(model: str) -> None:
    """A propped cantilever under a curvature: R = 3 EI k / 2 L, with shear 3 EI k / 2 L / (1 + 3 EI / kGA L^2)."""
    prop = {"name": "prop", "on": "tip", "directions": ["z"]}
    clamp = {"name": "clamp", "on": "tail", "kind": "clamped"}
    built = scene(model, [warmth(depth=0.4)], supports=[clamp, prop])
    found = at_rest(built)
    box, E = built.sections[0].body.box, built.sections[0].body.material.young
    section = section_of(box, 0.3)
    G, EI = built.sections[0].body.material.shear_modulus, E * section.second_moment_y
    gives = 0.0 if model == "beam2d" else 3.0 * EI / (G * section.shear_area_z * L**2)
    force = 1.5 * EI * ALPHA * WARM / 0.4 / L / (1.0 + gives)
    assert found.other("reaction of prop")[0] == pytest.approx(-force, rel=1e-6)


def test_a_free_beam_that_is_warm_has_no_bending_moment() -> None:
    """Of the section forces, from which stresses of beams follow."""
    built = scene("beam3d", [warmth()], recovery={})
    (body,) = pmr.run(built).result.bodies.values()
    envelope = body.envelopes["reduced"]
    section = section_of(built.sections[0].body.box, 0.3)
    size = built.sections[0].body.material.young * section.second_moment_y * ALPHA * WARM / BOX["height"]
    moment = envelope.names.index("bending moment y")
    assert np.abs([envelope.least[moment], envelope.most[moment]]).max() < 1e-6 * size


def test_a_force_beside_the_axis_is_a_force_on_it_and_its_moments() -> None:
    """Hook and basket at once: places of their own, and a hand that pushes along y at a point."""
    at = {"hook": [L, 0.0, -0.5], "basket": [L + 0.8, 0.4, 0.2], "hand": [2.5, 0.0, 0.6]}
    forces = {"hook": ("z", -900.0, L), "basket": ("z", -1500.0, L), "hand": ("y", 200.0, 2.5)}
    beside = [
        {"name": n, "on": on, "direction": d, "point": at[n], "signal": still(f)} for n, (d, f, on) in forces.items()
    ]
    on_axis = list[dict[str, Any]]()
    for name, (direction, force, on) in forces.items():
        on_axis.append({"name": name, "on": on, "direction": direction, "signal": still(force)})
        moment = np.cross(np.array(at[name]) - [on, 0.0, 0.0], force * np.eye(3)["xyz".index(direction)])
        for axis, amount in zip("xyz", moment.tolist(), strict=True):
            about = {"name": f"{name} {axis}", "on": on, "direction": f"r{axis}", "signal": still(amount)}
            on_axis += [about] if amount else []
    found, expected = at_rest(scene("beam3d", beside)), at_rest(scene("beam3d", on_axis))
    size = np.abs(expected.displacement).max()
    assert found.displacement == pytest.approx(expected.displacement, abs=1e-9 * size)
    for name in expected.other_names:
        assert found.other(name) == pytest.approx(expected.other(name), rel=1e-9, abs=1e-6)
    assert found.other("reaction of clamp rx")[0] == pytest.approx(-1500.0 * 0.4 - 200.0 * 0.6, rel=1e-9)


@pytest.mark.parametrize(
    ("load", "told"),
    [
        (WARMER + "on='tail'", "loads\\[0\\].on = 'tail': acts = 'force' is allowed with it"),
        (WARMER + "point=[1.0,0.0,0.0]", "loads\\[0\\].point = .*: acts = 'force' is allowed with it"),
        (WARMER + "direction='x'", "loads\\[0\\].direction = 'x': 'y' or 'z' is allowed across a body"),
        ("signal=1.0,depth=0.3", "loads\\[0\\].depth = 0.3: acts = 'temperature' or 'wind' is allowed with it"),
        (WARMER + "expansion=-1.0", "loads\\[0\\].expansion = -1.0: .*greater than 0"),
        (WARMER + "dept=0.3", "loads\\[0\\].dept = 0.3: unknown key; did you mean 'depth'"),
        ("signal=1.0,direction='rx',point=[1.0,0.0,0.0]", "a moment acts everywhere alike"),
    ],
)
def test_keys_of_loads_that_contradict_each_other_are_refused_in_one_line(load: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as refused:
        load_any(plain_machines.CRANE, [f"sections.fly.loads=[{{name='sun',{load}}}]"])
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("model", "load", "told"),
    [
        ("beam2d", warmth("y"), r"direction = 'y': x, z and ry are allowed for beam2d"),
        ("beam2d", {"point": [6.0, 0.0, 1.0], "signal": still(1.0)}, "point.*a model in space is allowed"),
        ("shell", warmth(), r"acts = 'temperature': 'force' is allowed on a shell"),
    ],
)
def test_loads_that_a_body_can_not_have_are_refused(model: str, load: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        scene(model, [load], observe={"start": 0.5, "end": 5.0, "count": 3})


def test_stress_of_probes_is_refused_beside_a_temperature() -> None:
    probes = [{"name": "p", "at": [1.0, 0.0, 0.16], "measures": ["stress"]}]
    with pytest.raises(InputError, match=r"probes\[0\].measures.*displacement is allowed beside a temperature"):
        scene("beam3d", [warmth()], probes=probes)
