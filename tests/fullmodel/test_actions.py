"""Probes as outputs: what they say beside the beam theory, the recovered stresses and the geometry."""

from pathlib import Path

import numpy as np
import pytest

from pmr import InputError, RunResult, full_model, run
from pmr import scene as scenes
from pmr.fullmodel.actions import Gauge
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.structure import Structure
from pmr.models.profile_section import section_of
from pmr.scene import Scene
from pmr.scene.members import member_at
from pmr.scene.structures import BoxProfile

COARSE = ("mesh.size=0.2", "mesh.along=0.5")
BOX = "{length=6.0,width=0.3,height=0.4,wall=0.008}"


def boom(model: str, *probes: str) -> Scene:
    coarse = () if model == "beam" else COARSE
    return scenes.load(f"boom_{model}", [*coarse, f"probes=[{','.join(probes)}]"])


def gauges(structure: Structure) -> dict[str, Gauge]:
    return {one.name: one for one in structure.outputs if isinstance(one, Gauge)}


@pytest.mark.parametrize("model", ["beam", "shell", "solid"])
def test_a_stretched_body_has_the_stress_and_strain_of_a_bar(model: str) -> None:
    """u = (e x, -nu e y, -nu e z): stress E e along x, none across, everywhere."""
    scene = boom(model, "{name='p',at=[3.0,0.15,0.2],measures=['stress','strain','displacement']}")
    structure = structure_of(member_at(scene))
    q, found, e = np.zeros(structure.model.size), gauges(structure), 1e-4
    nodes = getattr(structure.model, "nodes", None)
    if nodes is None:  # of a beam, whose width nobody sees
        q[0::6] = e * np.linspace(0.0, 6.0, len(q) // 6)
    else:
        for i, share in enumerate((1.0, -0.3, -0.3)):
            q[nodes.component == i] = e * share * nodes.points[nodes.component == i][:, i]
    values = {name: float((one.row @ q)[0]) for name, one in found.items()}
    along, stress, strain = {"beam": "axial", "shell": "along", "solid": "xx"}[model], 210e9 * e, e
    assert values[f"p stress {along}"] == pytest.approx(stress, rel=1e-9)
    assert values[f"p strain {along}"] == pytest.approx(strain, rel=1e-9)
    assert values["p displacement x"] == pytest.approx(1e3 * e * found["p displacement x"].at[0], rel=1e-12)
    for name, value in values.items():
        if name.startswith("p stress") and name != f"p stress {along}":
            assert abs(value) < 1e-9 * stress, name
    if model != "beam":
        across = {"shell": "across", "solid": "yy"}[model]
        assert values[f"p strain {across}"] == pytest.approx(-0.3 * strain, rel=1e-9)


def test_the_nearest_point_of_the_face_counts_and_of_a_group_the_mean() -> None:
    scene = boom(
        "shell", "{name='in',at=[2.1,0.0,0.3],face='inner'}", "{name='any',at=[2.1,0.0,0.3]}",
        "{name='top',on='top',face='middle'}",
    )  # fmt: skip
    structure = structure_of(member_at(scene))
    found, known = gauges(structure), structure.model.stresses()  # type: ignore[attr-defined]
    assert found["in stress along"].face == "inner" and found["any stress along"].face == "outer"
    distance = np.linalg.norm(known.points[known.points_on("inner")] - (2.1, 0.0, 0.3), axis=1)
    assert np.linalg.norm(found["in stress along"].at - (2.1, 0.0, 0.3)) == distance.min()
    q = np.random.default_rng(1).standard_normal(structure.model.size)
    on = known.points_on("middle")
    on = on[np.isin(known.cell[on], structure.model.grid.regions["top"])]  # type: ignore[attr-defined]
    mean = known.evaluate(q[None])[0, on].mean(axis=0)
    values = [float((found[f"top stress {c}"].row @ q)[0]) for c in known.components]
    assert values == pytest.approx(mean.tolist(), rel=1e-9)


def test_stress_of_a_beam_is_linear_within_an_element() -> None:
    """On a cantilever with a force at its tip the moment is linear, whatever nodes there are beside the point."""
    places, section, curvature = (2.7, 0.0, 6.0), section_of(BoxProfile(width=0.3, height=0.4, wall=0.008), 0.3), 1e-3
    probes = ",".join(f"{{name='p{at}',at=[{at},0.15,0.2]}}" for at in places)
    for elements in (3, 4):
        scene = scenes.load("boom_beam", [f"mesh.elements={elements}", f"probes=[{probes}]"])
        structure = structure_of(member_at(scene))
        x, q = np.linspace(0.0, 6.0, elements + 1), np.zeros(structure.model.size)
        shear = 2.6 * section.second_moment_y / section.shear_area_z * x  # E / G = 2.6
        q[2::6] = curvature * (x**2 * (18.0 - x) / 6.0 + shear)
        q[4::6] = -curvature * x * (12.0 - x) / 2.0
        for at in places:
            gauge = gauges(structure)[f"p{at} stress axial"]
            assert gauge.at[0] == pytest.approx(at)
            stress = -210e9 * curvature * (6.0 - at) * gauge.at[2]
            assert float((gauge.row @ q)[0]) == pytest.approx(stress, rel=1e-6, abs=1.0)


def test_a_point_of_a_beam_moves_with_its_section_between_nodes() -> None:
    """A bent beam of three elements: the cubic at the probe's own place, not the motion of the nearest node.

    A point beside the axis turns with its section; it had the displacement of the axis.
    """
    probes = "probes=[{name='p',at=[2.7,0.15,0.2],measures=['displacement']}]"
    structure = structure_of(member_at(scenes.load("boom_beam", ["mesh.elements=3", probes])))
    x, q = np.linspace(0.0, 6.0, 4), np.zeros(structure.model.size)
    q[0::6], q[2::6], q[4::6], q[3::6] = 1e-4 * x, 1e-3 * x**2, -2e-3 * x, 3e-3 * x
    found = gauges(structure)
    assert found["p displacement z"].at == pytest.approx([2.7, 0.15, 0.2])
    turned = np.cross([3e-3 * 2.7, -2e-3 * 2.7, 0.0], [0.0, 0.15, 0.2])
    for name, value in zip("xyz", turned + [1e-4 * 2.7, 0.0, 1e-3 * 2.7**2], strict=True):
        assert float((found[f"p displacement {name}"].row @ q)[0]) == pytest.approx(1e3 * value, rel=1e-9, abs=1e-12)


DECK = """*NODE
1, 0, -0.1, 0
2, 1, -0.1, 0
3, 2, -0.1, 0
4, 0, 0.1, 0
5, 1, 0.1, 0
6, 2, 0.1, 0
*ELEMENT, TYPE=S4, ELSET=all
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*ELSET, ELSET=soft
2
*NSET, NSET=tail
1, 4
*NSET, NSET=tip
3, 6
"""
STRIP = """
title = "A strip of two materials"
body = { model = "shell", thickness = 0.01, regions.soft.material = { young = 70e9, poisson = 0.1 } }
mesh.file = "strip.inp"
supports = [{ on = "tail", kind = "clamped" }]
loads = [{ on = "tip", direction = "x", signal = 1.0 }]
observe = { start = 0.5, end = 1.5 }
time = { end = 0.1, step = 1e-2 }
probes = [{ name = "p", on = "all", measures = ["strain"] }]
"""


def test_the_mean_strain_of_a_group_takes_the_material_of_each_cell(tmp_path: Path) -> None:
    """All cells have the same strain; their stresses differ."""
    (tmp_path / "strip.inp").write_text(DECK)
    (tmp_path / "strip.toml").write_text(STRIP)
    structure = structure_of(member_at(scenes.load(tmp_path / "strip.toml")))
    nodes, strains, q = structure.model.nodes, (1e-4, -4e-5), np.zeros(structure.model.size)  # type: ignore[attr-defined]
    for i, strain in enumerate(strains):
        q[nodes.component == i] = strain * nodes.points[nodes.component == i][:, i]
    values = [float((gauge.row @ q)[0]) for gauge in gauges(structure).values()]
    assert values == pytest.approx([*strains, 0.0], rel=1e-9, abs=1e-15)


@pytest.mark.slow
def test_a_simulated_probe_is_the_recovered_stress() -> None:
    """The reduced model's own outputs beside the stresses of the states recovered from it, and the full model's.

    A probe of a beam does not know what loads do within its element, if its nodes stood still.
    """
    changes = ("time.end=0.5", "recovery.every=0.5", "mesh.elements=12", "slider.path=2.0")
    probes = "probes=[{name='p',at=[2.0,0.15,0.2]},{name='axis',at=[2.0,0.0,0.0],measures=['displacement']}]"
    outcome = run(scenes.load("boom_beam", [*changes, probes, "reduction.coordinates=8"]))
    assert outcome is not None and outcome.result.body.fields is not None
    result, reduced = outcome.result, outcome.result.responses["reduced"]
    assert reduced.other_units[:5] == ("Pa", "Pa", "mm", "mm", "mm")  # reactions follow
    fields, (place, *_) = result.body.fields, result.summary["probes"]
    near = int(np.linalg.norm(fields.points - (2.0, 0.0, 0.0), axis=1).argmin())
    moved = [reduced.other(f"axis displacement {d}")[-1] for d in "xyz"]
    assert moved == pytest.approx(1e3 * fields.displacement[-1, near], rel=1e-5, abs=1e-9)  # fields are single
    stress, shear = (reduced.other(f"p stress {c}")[-1] for c in ("axial", "torsion"))
    cells = np.flatnonzero(np.any(fields.cells == near, axis=1))
    mises, beside = np.hypot(stress, np.sqrt(3.0) * shear), fields.von_mises[place["face"]][-1, cells]
    assert mises == pytest.approx(beside.max(), abs=within_an_element(result, h=0.5))
    errors = result.summary["errors"]["reduced_vs_full"]
    assert errors["p stress axial"] < 1e-3 and errors["axis displacement z"] < 1e-3


def within_an_element(result: RunResult, h: float) -> float:
    """Stress in Pa of q h^2 / 12, and of P h / 8 of the largest pads at top, bottom and sides, in the corners."""
    section = section_of(BoxProfile(width=0.3, height=0.4, wall=0.008), 0.3)
    q, most = 7850.0 * section.area * 9.81, max(max(abs(one["min"]), abs(one["max"])) for one in result.summary["pads"])
    return float(
        (q * h**2 / 12.0 + most * h / 8.0) * 0.204 / section.second_moment_y
        + most * h / 8.0 * 0.154 / section.second_moment_z
    )


@pytest.mark.parametrize(
    ("model", "probe", "key", "allowed"),
    [
        ("beam", "{name='p',at=[1.0,0.0,0.0],face='outer'}", "probes[0].face", "top left"),
        ("beam", "{name='p',on='tip'}", "probes[0].on", "groups of cells are allowed: none"),
        ("shell", "{name='p',on='weld'}", "probes[0].on", "bottom, left, right, top"),
        ("beam", "{name='p',at=[6.1,0.0,0.0],measures=['displacement']}", "probes[0].at",
         "x from 0 to 6 m, y from -0.15"),
        ("shell", "{name='p',at=[1.0,0.0,200.0]}", "probes[0].at", "z from -0.2 to 0.2 m"),
    ],
)  # fmt: skip
def test_what_no_probe_can_measure_is_refused(model: str, probe: str, key: str, allowed: str) -> None:
    with pytest.raises(InputError) as caught:
        structure_of(member_at(boom(model, probe)))
    assert caught.value.key == key and allowed in caught.value.allowed


def test_a_planar_beam_has_no_stresses_but_moves() -> None:
    at = "probes=[{name='p',at=[2.5,0.0,0.0],measures=['%s']}]"
    with pytest.raises(InputError, match="no stresses"):
        structure_of(member_at(scenes.load("paper_simple", [at % "strain"])))
    found = gauges(structure_of(member_at(scenes.load("paper_simple", [at % "displacement"]))))
    assert list(found) == ["p displacement x", "p displacement z"]


@pytest.mark.slow
def test_a_support_that_gives_way_says_its_force() -> None:
    """Under its own weight, 30 degrees up: the cylinder holds what points along the axis."""
    cylinder = "supports=[{name='cylinder',directions=['x'],stiffness=1e8}]"
    still = ("time={end=2.0,step=1e-2,rho_inf=0.5}", "damping={ratio=0.5,frequencies=[1.0,60.0]}", "slider.path=2.0")
    down = "gravity.direction=[-0.5,0.0,-0.8660254037844386]"
    scene = scenes.load(
        "boom_beam",
        [
            *still,
            cylinder,
            down,
            "loads=[]",
            "mesh.elements=12",
            "recovery={every=0.5,stress=false}",
            "compare.against=[]",
        ],
    )
    outcome = run(scene)
    assert outcome is not None
    response = outcome.result.responses["reduced"]
    mass = 7850.0 * 2.0 * (0.3 + 0.4) * 0.008 * 6.0 + 250.0
    assert abs(response.force("force of cylinder")[-1]) == pytest.approx(mass * 9.80665 * 0.5, rel=1e-3)


def test_a_region_that_a_drawn_mesh_lacks_is_refused_without_the_name_of_a_file() -> None:
    """The mesh of a box is drawn into a file of a temporary folder, which nobody can open afterwards."""
    scene = scenes.load("boom_shell", [*COARSE, "body.regions.nose={thickness=0.02}"])
    with pytest.raises(InputError, match="mesh of body.box has these regions: bottom, left, right, top") as caught:
        full_model(scene)
    assert ".msh" not in str(caught.value)


def test_a_planar_beam_takes_probes_on_the_side_walls_of_a_wide_box() -> None:
    """The model has no width: its stress is that at the probe's height."""
    box = "section.body.box={length=6.0, width=0.9, height=0.2, wall=0.008}"
    probes = "section.probes=[{name='p', at=[3.0, 0.45, 0.1]}, {name='q', at=[3.0, 0.0, 0.1]}]"
    scene = scenes.load_any("boom_two", ["section.body.model='beam2d'", box, probes])
    found = gauges(structure_of(member_at(scene, 1)))
    assert (found["p stress axial"].row != found["q stress axial"].row).nnz == 0
