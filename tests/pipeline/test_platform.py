"""A platform of four octagonal sections as beams whose walls give way, and as shells."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import pmr
from pmr.compare import forces as ropes
from pmr.compare.model_part import Motion, model_budget
from pmr.fem.compat import MPI
from pmr.pipeline.model_errors import measure_model

pytest.importorskip("gmsh")
WORKFLOWS = Path(__file__).parents[2] / "workflows"
QUICK = ["section.reduction.estimate=false", "time.step=0.01", "time.end=1.5"]
COARSE = ["section.mesh.size=0.16", "section.mesh.along=0.7"]


def scene(name: str, *changes: str):
    return pmr.load_scene(WORKFLOWS / f"{name}.toml", [*QUICK, *changes])


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("PMR_SWEEP") != "full", reason="a minute: PMR_SWEEP=full takes it")
def test_a_platform_of_four_octagons_is_as_far_from_shells_as_its_budget_says() -> None:
    """Stated by reductions of their own, true by those of the scenes; the same within a factor of two."""
    short = "sections.first.joint.extension={kind='smooth_ramp',times=[0.0,1.5],values=[4.5,5.0]}"
    beam = scene("platform", *COARSE, short, "compare.richer=shell")
    stated = measure_model(beam, MPI.COMM_SELF, None)
    shell = scene("platform_shell", *COARSE, short)
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
    own = {name: response.force(f"force of cylinder of {name}", 0)[0] for name in found}
    assert found["fly"] == own["fly"] and found["second"] == own["second"] + own["fly"]
    assert found["first"] == pytest.approx(sum(own.values()), rel=1e-12)
