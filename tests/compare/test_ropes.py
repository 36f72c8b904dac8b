"""Sections that ropes move with others, beside statics and the work that telescoping takes."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from export.fmi.libraries import follow_reference, loaded
from pydantic import ValidationError
from scipy.integrate import solve_ivp

import pmr
from pmr import InputError, System
from pmr.compare import forces as ropes
from pmr.export.exudyn_script import write_exudyn_script
from pmr.export.fmi import fmu_contents
from pmr.fullmodel.build import build_bodies, models_of
from pmr.pipeline.full_order import FullOrder
from pmr.report import forces as reported
from pmr.results.response import Extremes
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.checks import check_scene
from pmr.scene.joints import Cylinder, Rope
from pmr.scene.keys import cylinder_name
from pmr.simulation import Excitation
from pmr.simulation.moving import read_scene
from pmr.simulation.native import systems
from pmr.simulation.native.watched import exceeded_limits, pushed_ropes
from pmr.system.assembly import Assembly

G, TIP, SECOND = 9.80665, 250.0, 0.7
PADS = [{"at": 0.15, "faces": {"bottom": [0.0], "top": [0.0]}, "unilateral": False}]
OUT = {"kind": "smooth_ramp", "times": [0.5, 2.5], "values": [0.8, 3.0]}


def section(name: str, height: float, **rest: object) -> dict[str, object]:
    box = {"length": 6.0, "width": height - 0.1, "height": height, "wall": 0.006}
    body = {"model": "beam2d", "box": box, "material": {"young": 2.1e14}}
    return {"name": name, "body": body, "mesh": {"elements": 8}, "reduction": {"coordinates": 5}, **rest}


def boom() -> Scene:
    """Stiff sections at 30 degrees; a rope pulls the second 0.7 times as far as the first, another the fly."""
    joint = {"tail": PADS, "mouth": PADS}
    found = Scene.model_validate(
        {
            "title": "ropes",
            "sections": [
                section("base", 0.5, supports=[{"name": "clamp", "kind": "clamped"}]),
                section("first", 0.45, joint={**joint, "extension": OUT}),
                section("second", 0.4, joint={**joint, "follows": "first", "ratio": SECOND, "offset": 0.1}),
                section("fly", 0.35, joint={**joint, "follows": "second"})
                | {"masses": [{"name": "load", "on": "tip", "mass": TIP}]},
            ],
            "gravity": {"inclination": 30.0},
            "time": {"end": 3.0, "step": 1e-3},
            "compare": {"against": []},
        }
    )
    check_scene(found)
    return found


@pytest.fixture(scope="module")
def simulated() -> tuple[Scene, pmr.Response, np.ndarray]:
    scene = boom()
    system = pmr.reduce(scene).system
    masses = np.array([7850.0 * part.body.box.length * 0.006 * 2 * (2 * height - 0.1)
                       for part, height in zip(scene.sections[1:], (0.45, 0.4, 0.35), strict=True)])  # fmt: skip
    masses[-1] += TIP
    return scene, pmr.simulate(scene, system), masses


@pytest.mark.slow
def test_a_rope_bears_what_follows_it_and_the_cylinder_bears_all(simulated) -> None:
    """At rest, by statics: a weight counts by how far it moves where the cylinder moves by one."""
    scene, response, masses = simulated
    found, along = ropes.rope_forces(scene, response), masses * G / 2.0
    fly, second = along[2], along[1] + 2.0 * along[2]
    first = along.sum() + SECOND * second
    at_rest = [found[name][0] for name in ("first", "second", "fly")]
    assert at_rest == pytest.approx([first, second, fly], rel=1e-6)


@pytest.mark.slow
def test_the_cylinder_gives_the_work_that_raises_all_sections(simulated) -> None:
    scene, response, masses = simulated
    drive, t = ropes.rope_forces(scene, response)["first"], response.t
    power = drive * scene.paths["first"].rate(t)
    work = float((power[1:] + power[:-1]) @ np.diff(t) / 2.0)
    tails = np.cumsum([np.ptp(scene.paths[name].value(t)) for name in scene.names[1:]])
    assert work == pytest.approx(float(masses @ tails) * G / 2.0, rel=2e-4)


@pytest.mark.slow
def test_the_summary_and_the_report_have_them(simulated) -> None:
    scene, response, _ = simulated
    said = ropes.ropes_part(scene, response).figures["ropes"]
    assert [(one["name"], one["follows"]) for one in said] == [("first", None), ("second", "first"), ("fly", "second")]
    assert "power" in said[0] and "power" not in said[1]
    assert Extremes.from_summary(said[0]["force"]).summary() == said[0]["force"]
    assert [force.name for force in reported.rope_forces({"ropes": said})] == [
        "cylinder of first",
        "rope of second",
        "rope of fly",
    ]


def elastic(lengths: tuple[float, float, float], offset: float, **rope: object) -> Scene:
    """Two stiff sections in a base; two strands of 1e6 N pull the last one as the first goes."""
    joint = {"tail": PADS, "mouth": PADS}
    base, first, fly = (
        section(name, height) | {"name": name} for name, height in (("base", 0.5), ("first", 0.45), ("fly", 0.4))
    )
    base["supports"] = [{"name": "clamp", "kind": "clamped"}]
    first["joint"], fly["masses"] = joint | {"extension": OUT}, [{"name": "load", "on": "tip", "mass": TIP}]
    fly["joint"] = joint | {"follows": "first", "offset": offset, "rope": {"EA": 1e6, "strands": 2} | rope}
    for one, length in zip((base, first, fly), lengths, strict=True):
        one["body"]["box"]["length"] = length
    rest = {"time": {"end": 3.0, "step": 1e-3}, "compare": {"against": []}}
    found = Scene.model_validate({"title": "rope", "sections": [base, first, fly], **rest})
    check_scene(found)
    return found


@pytest.mark.parametrize(
    ("lengths", "offset", "rope", "l"),
    [((6.0, 6.0, 6.0), 0.0, {}, 6.0), ((6.0, 5.5, 5.0), 0.3, {}, 4.7), ((6.0, 6.0, 6.0), 1.0, {"length": 9.0}, 9.0)],
)
def test_a_section_swings_on_its_rope_by_the_stiffness_of_all_strands(lengths, offset, rope, l) -> None:
    """f = sqrt(2 EA / (l m)) / 2 pi wherever the sections are, as l does not change: s_1 + L_1 - L_0 + L_1 - s_2."""
    scene = elastic(lengths, offset, **rope)
    system = pmr.reduce(scene).system
    at = np.array([0.8, 1.7, 3.0])
    x = system.side_coordinates({name: at + k * offset for k, name in enumerate(("first", "fly"))})
    mass = TIP + 7850.0 * lengths[2] * 0.006 * 2 * 0.7
    found = Assembly(system).frequencies(x, 1, np.zeros((3, 0)))[:, 0]
    assert found == pytest.approx(np.full(3, np.sqrt(2e6 / (l * mass)) / (2.0 * np.pi)), rel=1e-5)


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        ({"follows": "first", "ratio": 2.0, "rope": {"EA": 1e6}}, "a length is needed"),
        ({"follows": "first", "cylinder": {"stiffness": 1e6}, "rope": {"EA": 1e6}}, "one of them"),
        ({"extension": OUT, "rope": {"EA": 1e6}}, "a length is needed"),
        ({"extension": OUT, "rope": {"EA": 1e6, "length": 2.5, "lengthens": -1.0}}, "more than 3 m is allowed"),
    ],
)
def test_a_rope_that_is_not_known_is_refused_in_one_line(joint, said) -> None:
    content = elastic((6.0, 6.0, 6.0), 0.0).model_dump(exclude_unset=True)
    content["sections"][2]["joint"] = {"tail": PADS, "mouth": PADS} | joint
    with pytest.raises((ValidationError, InputError)) as caught:
        check_scene(Scene.model_validate(content))
    assert said in str(caught.value)


def test_the_summary_says_how_long_and_stiff_a_rope_is(simulated) -> None:
    scene, response, _ = simulated
    joint = scene.joint(3).model_copy(update={"rope": Rope(EA=6e6, strands=2)})
    fly = scene.sections[3].model_copy(update={"joint": joint})
    said = ropes.ropes_part(scene.model_copy(update={"sections": (*scene.sections[:3], fly)}), response).figures[
        "ropes"
    ]
    assert said[2]["length"] == 6.0 and said[2]["stiffness"] == 2e6 and "length" not in said[1]
    names = [force.name for force in reported.rope_forces({"ropes": said})]
    assert names[:2] == ["cylinder of first", "rope of second"]
    assert names[2] == "rope of fly, 6.00\u00a0m long, EA/l 2.00\u00a0kN/mm"


WINCH = {"EA": 1e6, "strands": 2, "length": 5.0, "lengthens": -1.0}


def winch(simulator: str = "march") -> Scene:
    """One stiff section at 30 degrees on a rope that gets as much shorter as this slides out; it swings on the way."""
    base, fly = section("base", 0.5, supports=[{"name": "clamp", "kind": "clamped"}]), section("fly", 0.45)
    fly["joint"] = {"tail": PADS, "mouth": PADS, "extension": OUT | {"times": [0.1, 1.1]}, "rope": WINCH}
    fly["masses"] = [{"name": "load", "on": "tip", "mass": TIP}]
    found = Scene.model_validate(
        {
            "title": "winch",
            "sections": [base, fly],
            "gravity": {"inclination": 30.0},
            "time": {"end": 1.2, "step": 1e-3, "rho_inf": 1.0},
            "simulation": {"simulators": [simulator], "full": "petsc"},
            "compare": {"against": []},
        }
    )
    check_scene(found)
    return found


def fly_mass() -> float:
    return TIP + 7850.0 * 6.0 * 0.006 * 2 * 0.8


def swinging(scene: Scene, t: np.ndarray) -> np.ndarray:
    """Force of the rope by m (u'' + s'') + k(s) u = -m g / 2, from rest, by Runge and Kutta's method of order 8."""
    path, m = scene.paths["fly"], fly_mass()

    def pull(at: float, u: float) -> float:
        return 2e6 / (5.0 - float(path.value(at))) * u

    def rates(at: float, y: np.ndarray) -> list[float]:
        return [y[1], -pull(at, y[0]) / m - G / 2.0 - float(path.second_rate(at))]

    still = -m * G / 2.0 * (5.0 - float(path.value(0.0))) / 2e6
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "max_step": 5e-3}
    found = solve_ivp(rates, (0.0, t[-1]), [still, 0.0], t_eval=t, **options)
    return np.array([pull(at, u) for at, u in zip(t, found.y[0], strict=True)])


@pytest.mark.slow
@pytest.mark.parametrize("simulator", ["march", "exudyn", "full"])
def test_a_section_swings_on_a_winchs_rope_as_its_equation_says(simulator: str) -> None:
    """Within the scheme's phase error, omega^3 h^2 t / 12."""
    if simulator == "full":
        scene = winch()
        found = FullOrder.join(scene, models_of(build_bodies(scene))).reference("full")
    else:
        scene = winch(simulator)
        found = pmr.simulate(scene, pmr.reduce(scene).system)
    force, known = -found.force(force_name(cylinder_name("fly"))), swinging(scene, found.t)
    late = np.sqrt(2e6 / 2.0 / fly_mass()) ** 3 * 1e-3**2 / 12.0 * 1.2  # rad: of the trapezoidal rule, at the shortest
    assert force == pytest.approx(known, abs=late * np.ptp(known) / 2.0) and late < 0.006
    assert found.surplus < 1e-4
    (said,) = ropes.ropes_part(scene, found).figures["ropes"]
    ends = [5.0 - scene.paths["fly"].value(t) for t in (0.0, scene.time.end)]
    assert (said["name"], said["follows"], said["length"]) == ("fly", None, pytest.approx(max(ends)))
    (pushed,) = exceeded_limits(pushed_ropes(scene), ropes.history_by_name(scene, found))
    assert pushed.limit.event == "the rope of fly would have to push" and pushed.value == pytest.approx(-force.max())
    pulls = replace(found, slider_force=found.slider_force + force.max(), force_peaks=None)
    assert force.max() > 0.0 and not exceeded_limits(pushed_ropes(scene), ropes.history_by_name(scene, pulls))
    assert said["stiffness"] == pytest.approx(2e6 / max(ends)) and said["force"]["min"] == pytest.approx(-force.max())


@pytest.mark.slow
def test_the_drums_work_closes_the_balance_of_energy() -> None:
    """What is stored less all work stays the same; the drum's own is minus the half of lambda^2 dl / EA."""
    scene = winch()
    system = pmr.reduce(scene).system
    ran = systems.simulate(system, Excitation.from_scene(scene))
    left, force = ran.energy - ran.work, ran.forces[:, system.contact_names.index(cylinder_name("fly"))]
    shorter = np.diff(scene.paths["fly"].value(ran.t)) / 2e6
    drum = np.cumsum(((force[1:] + force[:-1]) / 2.0) ** 2 * shorter) / 2.0
    assert drum[-1] > 5.0
    assert np.abs(left - left[0]).max() < 1e-3 * drum[-1]


@pytest.mark.slow
def test_a_rope_and_what_pulls_it_give_way_together() -> None:
    """u = A F with A = S^T diag(1/k) S, S = [[1, r], [0, 1]]: at rest, and in both frequencies."""
    r, k = 0.7, np.array([4e6, 2e6 / 4.7])
    scene = elastic((6.0, 5.5, 5.0), 0.0, length=4.7)
    sections = list(scene.sections)
    sections[1] = sections[1].model_copy(
        update={"joint": sections[1].joint.model_copy(update={"cylinder": Cylinder(stiffness=k[0])})}
    )
    sections[2] = sections[2].model_copy(update={"joint": sections[2].joint.model_copy(update={"ratio": r})})
    system = pmr.reduce(scene.model_copy(update={"sections": tuple(sections)})).system
    S = np.array([[1.0, r], [0.0, 1.0]])
    A, masses = S.T @ np.diag(1.0 / k) @ S, 7850.0 * 0.006 * 2 * np.array([0.8 * 5.5, 0.7 * 5.0]) + [0.0, TIP]
    numbers = [system.contact_names.index(cylinder_name(name)) for name in ("first", "fly")]
    x = system.side_coordinates({"first": np.array([1.7]), "fly": np.array([r * 1.7])})
    assert Assembly(system).contact_rows_over_time(x).F[0][np.ix_(numbers, numbers)] == pytest.approx(A, rel=1e-9)
    moved = np.array([[1.0, 0.0], [1.0, 1.0]])  # of both sections, by what their drives give way
    omega2 = scipy.linalg.eigh(np.linalg.inv(A), moved.T @ np.diag(masses) @ moved, eigvals_only=True)
    found = Assembly(system).frequencies(x, 2, np.zeros((1, 0)))[0]
    assert found == pytest.approx(np.sqrt(omega2) / (2.0 * np.pi), rel=1e-4)


@pytest.mark.slow
def test_a_chain_of_ropes_gives_way_alike_in_all_simulators(tmp_path: Path) -> None:
    """Four sections, whose drives couple contacts that share no body; one rope gets longer on the way."""
    content = boom().model_dump(exclude_unset=True)
    drives = (
        {"cylinder": {"stiffness": 4e6}, "extension": OUT | {"times": [0.0, 0.2]}},
        {"rope": {"EA": 1e6, "length": 9.0, "lengthens": 0.3}},
        {"rope": {"EA": 2e6}},
    )
    for part, drive in zip(content["sections"][1:], drives, strict=True):
        part["joint"] |= drive
    content["time"]["end"], found = 0.2, []
    for name in ("march", "exudyn"):
        asked = Scene.model_validate(content | {"simulation": {"simulators": [name]}})
        check_scene(asked)
        system = found[0][0] if found else pmr.reduce(asked).system
        found.append((system, pmr.simulate(asked, system)))
    for name in ("first", "second", "fly"):
        one, other = (response.force(force_name(cylinder_name(name))) for _, response in found)
        assert np.ptp(one) > 100.0
        assert one == pytest.approx(other, abs=1e-6 * np.abs(other).max())
    changing = system.save(tmp_path / "changing.npz")
    with pytest.raises(InputError, match=r"rope.lengthens = 'cylinder of second': 0 is allowed here"):
        write_exudyn_script(changing, tmp_path / "script.py")
    unit = fmu_contents(system, read_scene(system, "system.npz"), "boom", "3")
    outputs, reference = follow_reference(unit, loaded(unit, tmp_path, "3"))
    for name in (name for name in outputs if name.startswith("force_of_cylinder")):
        bound = 1e-6 * np.abs(reference[name]).max()
        np.testing.assert_allclose(outputs[name], reference[name], rtol=0.0, atol=bound)
    still = [replace(one, lengthening=0.0, path=None) for one in system.contacts]
    saved = replace(system, contacts=tuple(still)).save(tmp_path / "system.npz")
    s = {"first": 1.0, "second": 0.8, "fly": 0.8}
    expected = Assembly(System.load(saved)).contact_rows(system.side_coordinates(s)).F
    assert np.count_nonzero(np.abs(expected - np.diag(np.diagonal(expected))) > 1e-9) >= 6
    names = runpy.run_path(str(write_exudyn_script(saved, tmp_path / "script.py")))
    assert names["rows_at"]([s[path] for path in system.paths]).F == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_where_nothing_follows_there_are_none(simulated) -> None:
    assert ropes.rope_forces(pmr.load_scene("boom_four"), simulated[1]) == {}


@pytest.mark.slow
def test_a_rope_that_bears_round_off_does_not_push(simulated) -> None:
    """1.8e-15 N beside pads that bear kilonewtons was "the rope would have to push"."""
    scene, response, _ = simulated
    drives = [response.force_names.index(force_name(cylinder_name(name))) for name in scene.names[1:]]
    for size, said in ((-1e-15, 0), (-1.0, 2)):
        forces = response.slider_force.copy()
        forces[:, drives] = size
        changed = replace(response, slider_force=forces, force_peaks=None)
        assert len(exceeded_limits(pushed_ropes(scene), ropes.history_by_name(scene, changed))) == said
