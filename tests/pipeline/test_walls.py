"""Beams whose walls give way beside shells of the same boxes, pads and loads.
A platform of four octagonal sections as beams whose walls give way, and as shells.
"""

import os

import numpy as np
import pytest
from alone import frequencies

import pmr
from pmr.compare import forces as ropes
from pmr.compare.model_part import Motion, model_budget
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.pipeline.model_errors import measure_model
from pmr.simulation import Excitation
from pmr.simulation.excitation import side_positions
from pmr.system.assembly import Assembly

pytest.importorskip("gmsh")
ALONE = ["compare.against=[]", "simulation.simulators=['march']"]


def largest(scene, reduced) -> float:
    return float(np.abs(pmr.simulate(scene, reduced).displacement).max())


@pytest.mark.slow
def test_the_reference_boom_has_the_shells_frequencies_and_deflections() -> None:
    """Nothing is fitted: the first two frequencies along the path within 2 %, the largest displacement within 1 %."""
    f, most = {}, {}
    for name in ("boom_beam", "boom_beam_walls", "boom_shell"):
        scene = pmr.load_scene(name, ALONE)
        reduced = pmr.reduce(scene).reduced
        f[name] = frequencies(reduced, np.linspace(1.5, 4.0, 6), 2)
        most[name] = largest(scene, reduced)
    assert f["boom_beam_walls"] == pytest.approx(f["boom_shell"], rel=0.02)
    assert most["boom_beam_walls"] == pytest.approx(most["boom_shell"], rel=0.01)
    assert np.all(f["boom_beam"] > 1.05 * f["boom_shell"]) and most["boom_beam"] < 0.75 * most["boom_shell"]


@pytest.mark.slow
def test_walls_of_both_sections_of_a_joint_give_way() -> None:
    """Pressed on are shells of the same cells as those beside them."""
    short = ["section.mesh.size=0.16", "section.mesh.along=0.3", "time.step=5e-3", "section.reduction.estimate=false"]
    most = {}
    for name, body in (("beam", "{model='beam3d'}"), ("gives", "{model='beam3d',walls='give'}"), ("shell", "{}")):
        scene = pmr.load_scene("boom_three_shell", [*ALONE, *short, f"section.body={body}"])
        most[name] = largest(scene, pmr.reduce(scene).reduced)
    assert most["gives"] == pytest.approx(most["shell"], rel=0.01)
    assert most["beam"] < 0.9 * most["shell"]


@pytest.mark.slow
def test_octagonal_sections_on_slanted_pads_move_alike_as_beams_and_as_shells() -> None:
    """Displacement, frequencies far out, and forces of pads, which plates of their own thickness share out."""
    short = ["section.joint.extension={kind='smooth_ramp',times=[0.5,1.5],values=[4.0,4.2]}", "time.end=2.0"]
    short += ["section.mesh.size=0.12", "section.mesh.along=0.3", "time.step=5e-3", "section.reduction.estimate=false"]
    most, f, forces = {}, {}, {}
    for name in ("boom_octagonal", "boom_octagonal_shell"):
        scene = pmr.load_scene(name, short)
        system = pmr.reduce(scene).system
        response = pmr.simulate(scene, system)
        most[name], forces[name] = np.abs(response.displacement).max(), response.slider_force
        f[name] = frequencies_of(scene, system, np.array([0.99]))
    beams, shells = most
    assert most[beams] == pytest.approx(most[shells], rel=0.01)
    assert f[beams] == pytest.approx(f[shells], rel=0.01)
    assert np.abs(forces[beams] - forces[shells]).max() < 0.03 * np.abs(forces[shells]).max()


@pytest.mark.slow
def test_pads_that_only_push_dent_the_walls_too() -> None:
    """Let go at rest the box comes down on those below its mouth and above its tail."""
    rings = [f"pads.{ring}.unilateral=true" for ring in ("tail", "mouth")]
    changes = [*ALONE, *rings, "time.end=0.15", "gravity.rise=0.0", "loads=[]"]
    sag = {}
    for walls in ("rigid", "give"):
        scene = pmr.load_scene("boom_beam_walls", [*changes, f"body.walls={walls}", "mesh={}"])
        response = pmr.simulate(scene, pmr.reduce(scene).reduced)
        assert np.all(response.slider_force >= 0.0) and response.slider_force.max() > 1e4
        sag[walls] = float(np.abs(response.displacement).max())
    assert sag["give"] > 1.3 * sag["rigid"]


#: Coarse cells and long steps; both models have the same.
COARSE = ["section.mesh={size=0.2,along=0.4}", "section.body={model='beam3d',walls='give'}", "time.step=5e-3"]


def coarse(*changes: str):
    scene = pmr.load_scene("boom_three_shell", [*ALONE, *COARSE, "compare.richer=shell", *changes])
    return scene.model_copy(update={"accuracy": None})


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="compares two ranks with one")
def test_walls_give_way_alike_on_all_ranks() -> None:
    """Rank 0 alone presses on shells; what it finds all ranks take.  At few places: pads slide half a metre."""
    x, out = np.array([0.7, 0.9]), "={kind='smooth_ramp',times=[1.0,5.0,9.0],values=[1.5,2.0,1.5]}"
    one = [*ALONE, "mesh.size=0.2", "mesh.along=0.4", f"slider.path{out}"]
    for scene in (coarse(f"section.joint.extension{out}"), pmr.load_scene("boom_beam_walls", one)):
        here, together = (build_bodies(scene, comm) for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
        for name, one in here.items():
            walls, same = one.structure.pads.walls, together[name].structure.pads.walls
            assert walls.count == same.count > 0
            assert same.standing.compliance == pytest.approx(walls.standing.compliance, rel=1e-12)
            for a, b in zip(walls.sliding, same.sliding, strict=True):
                assert b.compliance == pytest.approx(a.compliance, rel=1e-12)
        f = [frequencies_of(scene, pmr.reduce(scene, of).system, x) for of in (MPI.COMM_SELF, MPI.COMM_WORLD)]
        assert f[1] == pytest.approx(f[0], rel=1e-6)


def frequencies_of(scene, system: pmr.System, share: np.ndarray) -> np.ndarray:
    """The lowest ones of the reduced system where its paths are so far along."""
    excitation = Excitation.from_scene(scene)
    steps = (share * (len(excitation.times) // 2)).astype(int)
    return Assembly(system).frequencies(side_positions(system, excitation)[steps], 2)


pytest.importorskip("gmsh")
QUICK = ["section.reduction.estimate=false", "time.step=0.01", "time.end=1.5"]
COARSE_PLATFORM = ["section.mesh.size=0.16", "section.mesh.along=0.7"]


def scene(name: str, *changes: str):
    return pmr.load_scene(name, [*QUICK, *changes])


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("PMR_SWEEP") != "full", reason="a minute: PMR_SWEEP=full takes it")
def test_a_platform_of_four_octagons_is_as_far_from_shells_as_its_budget_says() -> None:
    """Stated by reductions of their own, true by those of the scenes; the same within a factor of two."""
    short = "sections.first.joint.extension={kind='smooth_ramp',times=[0.0,1.5],values=[4.5,5.0]}"
    beam = scene("platform", *COARSE_PLATFORM, short, "compare.richer=shell")
    stated = measure_model(beam, MPI.COMM_SELF, None)
    shell = scene("platform_shell", *COARSE_PLATFORM, short)
    own, richer = (Motion.compute(one, pmr.reduce(one).system) for one in (beam, shell))
    true = model_budget(beam, own, richer, "shell")
    for kind in ("beam", "tip", "pad_force", "frequency"):
        assert 0.5 < stated[kind] / true[kind] < 2.0
    assert true["tip"] < 0.05 and true["frequency"] < 0.05


@pytest.mark.slow
def test_the_pivot_holds_the_roll_of_the_basket_and_one_cylinder_all_ropes() -> None:
    """At rest, by statics, whatever the sections are: a basket aside turns the boom; ropes lean on it."""
    boom = scene("platform", "section.body.walls=rigid", "section.mesh={elements=10}", "time.end=0.05")
    response = pmr.simulate(boom, pmr.reduce(boom).system)
    roll = response.other("reaction of base: pivot rx")[0]
    assert abs(roll) == pytest.approx(400.0 * 9.80665 * 0.5 * 0.8, rel=1e-6)
    found = {name: force[0] for name, force in ropes.rope_forces(boom, response).items()}
    own = {name: response.force(f"force of cylinder of {name}")[0] for name in found}
    assert found["fly"] == own["fly"] and found["second"] == own["second"] + own["fly"]
    assert found["first"] == pytest.approx(sum(own.values()), rel=1e-12)
