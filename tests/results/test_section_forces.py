"""What a boom of beams has as results: section forces, stress, utilisation and masses, saved and read again."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import RunResult
from pmr.compare.strength import utilisation_part
from pmr.reduction.section_forces import PIECES
from pmr.results.tables import build_tables
from pmr.scene import Scene, load_any

BOOM = "boom_three"
ELEMENTS, STEP = 24, 2e-3
QUICK = [
    "compare.against=[]", "time.end=0.1", f"time.step={STEP}", f"section.mesh.elements={ELEMENTS}",
    f"recovery={{every={STEP},frames=2}}", "section.body.material.yield_stress=355e6",
    "section.joint.tail.0.unilateral=false", "section.joint.mouth.0.unilateral=false",
    "section.reduction.estimate=false",
]  # fmt: skip


@pytest.fixture(scope="module")
def ran() -> RunResult:
    outcome = pmr.run(load_any(BOOM, QUICK))
    assert outcome is not None
    found: RunResult = outcome.result
    return found


@pytest.mark.slow
def test_moments_at_a_clamp_are_its_reaction(ran: RunResult, tmp_path: Path) -> None:
    """Weight, pads between nodes and inertia included; at the free end, beyond the last pad, nothing is left."""
    ran.save(tmp_path)
    body = RunResult.load(tmp_path).bodies["base"]
    envelope = body.envelopes["reduced"]
    moment, shear = (envelope.names.index(name) for name in ("bending moment y", "shear force z"))
    reactions = {one["name"]: one for one in ran.summary["reactions"]}
    clamp = reactions["base: clamp ry"]["max"]
    assert envelope.most[moment, 0] == pytest.approx(clamp, rel=1e-5)
    assert envelope.least[shear, 0] == pytest.approx(reactions["base: clamp z"]["min"], rel=1e-5)
    for end in (envelope.least, envelope.most):
        assert np.abs(end[[moment, shear], -1]).max() <= 1e-6 * clamp
    t = envelope.most_at[moment, 0]
    assert t == pytest.approx(reactions["base: clamp ry"]["t_max"], abs=2.0 * STEP)
    rows = [
        row for row in build_tables(ran)["section_forces"].rows if row[1] == "base" and row[2] == "bending moment y"
    ]
    assert len(rows) == PIECES * ELEMENTS + 1 and rows[0][4] == 0.0 and rows[0][7] == envelope.most[moment, 0]
    extremes = ran.summary["sections"][0]["section_forces"]["reduced"]["bending moment y"]
    assert extremes["max"] == envelope.most[moment, 0] and extremes["x_max"] == 0.0


@pytest.mark.slow
def test_stress_and_its_share_of_the_yield_stress_are_known(ran: RunResult) -> None:
    """Navier's: the moment at the clamp over the section modulus; the table has all sections."""
    rows = {row[1]: row for row in build_tables(ran)["stress"].rows}
    assert list(rows) == ["base: whole body", "middle: whole body", "fly: whole body"]
    used = ran.summary["utilisation"]["reduced"]
    assert used["section"] == "base" and used["position"][0] == 0.0 and used["yield"] == 355e6
    assert used["value"] == used["stress"] / 355e6 == rows["base: whole body"][2] / 355e6
    extremes = ran.summary["sections"][0]["section_forces"]["reduced"]
    assert max(-extremes["axial stress"]["min"], extremes["axial stress"]["max"]) == used["stress"]
    I = (0.308 * 0.408**3 - 0.292 * 0.392**3) / 12.0
    assert used["stress"] == pytest.approx(extremes["bending moment y"]["max"] * 0.204 / I, rel=1e-6)
    assert [one["name"] for one in ran.summary["masses"]] == ["base", "middle", "fly"]


def record(model: str = "reduced", **more: float) -> dict[str, object]:
    """What is recovered of a body: its largest stress, and those in regions."""
    peaks = {
        region: {"value": value, "t": 0.5, "position": [1.0, 0.0, 0.0], "face": "outer", "region": region}
        for region, value in more.items()
    }
    most = max(peaks.values(), key=lambda one: float(str(one["value"])))
    return {"stress_peak": {model: most}, "stress_by_region": {model: peaks}}


def test_each_region_is_compared_with_its_own_yield_stress() -> None:
    """The largest share need not be where the largest stress is; without a yield stress nothing is said."""
    scene = load_any(BOOM, QUICK)
    plain = load_any(BOOM, [one for one in QUICK if "yield" not in one])
    stresses = {"middle": record(top=300e6, bottom=200e6)}
    assert utilisation_part(plain, stresses).figures == {}
    found = utilisation_part(scene, stresses)
    assert found.figures["utilisation"]["reduced"]["region"] == "top" and not found.grave
    softer = with_region(scene, "bottom", 180e6)
    found = utilisation_part(softer, stresses)
    assert found.figures["utilisation"]["reduced"]["region"] == "bottom"
    assert found.figures["utilisation"]["reduced"]["value"] == pytest.approx(200.0 / 180.0)
    assert len(found.grave) == 1 and "1.11 times the yield stress" in found.grave[0]
    stiffer = with_region(scene, "top", 900e6)
    assert utilisation_part(stiffer, stresses).figures["utilisation"]["reduced"]["region"] == "bottom"


def with_region(scene: Scene, region: str, yield_stress: float) -> Scene:
    part = scene.sections[1]
    known = {region: {"material": {"yield_stress": yield_stress}}}
    body = type(part.body).model_validate(part.body.model_dump() | {"regions": known})
    sections = (scene.sections[0], part.model_copy(update={"body": body}), *scene.sections[2:])
    return scene.model_copy(update={"sections": sections})


@pytest.mark.slow
def test_envelopes_are_those_of_all_steps(ran: RunResult) -> None:
    envelope = ran.bodies["fly"].envelopes["reduced"]
    assert np.all(envelope.least <= envelope.most) and np.all(envelope.most_at <= 0.1)


@pytest.mark.slow
def test_a_full_model_in_petsc_has_them_too() -> None:
    """Beside the reduced one, whose own they nearly are; nothing is left at free ends."""
    short = [one for one in QUICK if not one.startswith(("compare", "time.end", "section.mesh", "recovery"))]
    more = ["compare.against=['full']", "simulation.full='petsc'", "time.end=0.02", "section.mesh.elements=8"]
    outcome = pmr.run(load_any(BOOM, [*short, *more, "recovery={every=0.01,frames=2}"]))
    assert outcome is not None
    for name, body in outcome.result.bodies.items():
        full, reduced = (body.envelopes[model] for model in ("full", "reduced"))
        k = full.names.index("bending moment y")
        largest = np.abs([full.most[k], full.least[k]]).max()
        assert np.abs(full.most[k] - reduced.most[k]).max() < 1e-4 * largest, name
        assert np.abs(full.least[k] - reduced.least[k]).max() < 1e-4 * largest, name
        assert name == "fly" or abs(full.most[k, -1]) <= 1e-6 * largest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["", "boom"])
def test_a_body_alone_has_its_stress_with_and_without_a_name(name: str, unmeasured: Callable[..., None]) -> None:
    """A list of one section is a body alone, whose results have no name; box walls are given by their mid-surface."""
    unmeasured(True)
    body: dict[str, object] = {
        "body": {
            "model": "beam3d",
            "box": {"length": 6.0, "width": 0.22, "height": 0.32, "wall": 0.006},
            "material": {"young": 2.1e11, "density": 7850.0, "poisson": 0.3, "yield_stress": 355e6},
        },
        "mesh": {"elements": 4},
        "supports": [{"on": "tail", "kind": "clamped"}],
        "reduction": {"coordinates": 6, "estimate": False},
    }
    scene = Scene.model_validate(
        {
            "title": "cantilever",
            **({"sections": [{"name": name, **body}]} if name else body),
            "gravity": {},
            "start": "equilibrium",
            "recovery": {"every": 0.1},
            "time": {"end": 0.1, "step": 0.05},
            "compare": {"against": []},
        }
    )
    outcome = pmr.run(scene)
    assert outcome is not None
    used = outcome.result.summary["utilisation"]["reduced"]
    mass, I = 7850.0 * (0.226 * 0.326 - 0.214 * 0.314), (0.226 * 0.326**3 - 0.214 * 0.314**3) / 12.0
    assert used["stress"] == pytest.approx(mass * 9.80665 * 6.0**2 / 2.0 * 0.163 / I, rel=1e-6)
    assert used["section"] == "" and used["value"] == used["stress"] / 355e6
    assert list(outcome.result.bodies) == [""]
