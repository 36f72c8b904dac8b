"""Which pad carries what: every force under the name of its pad, from the structure to the report."""

import os
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pmr import Response, RunResult, reduce, run, simulate
from pmr import scene as scenes
from pmr.compare.errors import errors_between, with_common_forces
from pmr.compare.forces import history_by_name, pad_extremes, unknown_force_warnings
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.structure import structural_model
from pmr.report.columns import forces_of
from pmr.results import Energy
from pmr.scene import Scene
from pmr.scene.built import GRAVITY, force_name
from pmr.scene.members import member_at
from pmr.simulation.native.watched import exceeded_limits, exceeded_warnings, pulled_pads

ALL_ROUND = "faces={bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],right=[0.0]}"
#: A ring that only pushes, so far from the section that it never does, ahead of those that hold both ways.
MIXED = (
    f"pads=[{{name='aft',at=0.6,{ALL_ROUND},unilateral=true,clearance=0.05}},"
    f"{{name='tail',at=0.15,{ALL_ROUND}}},{{name='mouth',moving=true,{ALL_ROUND}}}]"
)
AT_REST = (
    "body.model=beam3d", "mesh.elements=20", MIXED, "slider.path=1.8", "loads=[]", "compare.against=[]",
    "recovery.stress=false", "recovery.every=0.5", "damping={ratio=0.5,frequencies=[1.0,60.0]}",
    "time={end=2.5,step=1e-2,rho_inf=0.5}",
)  # fmt: skip


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A boom under its weight alone, as a later process reads it."""
    folder = tmp_path_factory.mktemp("at_rest")
    outcome = run(scenes.load("boom_beam", AT_REST))
    assert outcome is not None
    outcome.result.save(folder)
    return RunResult.load(folder)


def statics() -> dict[str, float]:
    """Forces in N by ring and face: moments about two rings, each of whose four pads takes a quarter."""
    steel = 7850.0 * 2.0 * (0.3 + 0.4) * 0.008 * 6.0
    weight, centre = (steel + 250.0) * GRAVITY, (3.0 * steel + 6.0 * 250.0) / (steel + 250.0)
    mouth = weight * (centre - 0.15) / (1.8 - 0.15)
    return {
        "mouth bottom": mouth / 4.0,
        "mouth top": -mouth / 4.0,
        "tail bottom": (weight - mouth) / 4.0,
        "tail top": (mouth - weight) / 4.0,
    }


def with_forces(response: Response, columns: np.ndarray) -> Response:
    """With some of its forces, in this order."""
    assert response.force_peaks is not None  # some of the pads only push
    return replace(
        response,
        slider_force=response.slider_force[:, columns],
        force_peaks=response.force_peaks[:, columns],
        force_names=tuple(response.force_names[k] for k in columns),
    )


@pytest.mark.slow
def test_every_pad_carries_what_statics_says(at_rest: RunResult) -> None:
    expected, response = statics(), at_rest.responses["reduced"]
    seen = 0
    for pad in forces_of(at_rest):
        exact = next((force for face, force in expected.items() if pad.name.startswith(face)), 0.0)
        assert pad.history(response)[-1] == pytest.approx(exact, rel=2e-3, abs=1.0), pad.name
        seen += 1
        if pad.name.startswith("aft"):
            assert not pad.history(response).any(), pad.name
    assert seen == 18 == response.slider_force.shape[1]


def test_names_stand_for_columns_whatever_their_order(at_rest: RunResult) -> None:
    response = at_rest.responses["reduced"]
    order = np.random.default_rng(1).permutation(18)
    mixed = with_forces(response, order)
    shuffled = replace(at_rest, responses={"reduced": mixed})
    others = {pad.name: pad for pad in forces_of(shuffled)}
    for pad in forces_of(at_rest):
        assert np.array_equal(pad.history(response), others[pad.name].history(mixed)), pad
    force = {"pad_force": lambda one: one.slider_force}
    assert errors_between({"reduced": mixed, "full": response}, force)["reduced_vs_full"]["pad_force"] == 0.0


def test_a_response_names_displacements_and_forces(at_rest: RunResult) -> None:
    response, model = at_rest.responses["reduced"], structural_model(structure_of(member_at(at_rest.scene)))
    assert response.output_names == model.output_names[:60] and response.output_units == ("m",) * 60
    assert response.output_names[-2:] == ("tip y", "tip z")
    assert response.force_names == (*model.output_names[60:], *map(force_name, model.rows.names[:6]),
                                    *map(force_name, model.rows.names[7:]))  # fmt: skip
    assert model.rows.names[6] == "cylinder"  # which is no pad


def test_only_forces_that_both_know_are_compared(at_rest: RunResult) -> None:
    response = at_rest.responses["reduced"]
    fewer = with_forces(response, np.arange(2, 18))
    one, other = with_common_forces(response, fewer)
    assert one.force_names == other.force_names == fewer.force_names
    assert np.array_equal(one.slider_force, other.slider_force)
    missing = fewer.force(response.force_names[0])
    assert missing.shape == response.t.shape and np.isnan(missing).all()


def test_pads_that_are_pulled_are_named(at_rest: RunResult) -> None:
    """The ring that only pushes isn't, nor are pads that push; those at the sides have round-off alone."""
    expected, rows = statics(), {row["what"]: row["t"] for row in at_rest.summary["exceeded"]}
    pulled = [f"{ring} {side}" for ring in ("tail bottom", "mouth top") for side in ("right", "left")]
    assert list(rows) == [f"the pad {name} holds both ways and pulls" for name in pulled]
    (line,) = (line for line in at_rest.summary["warnings"] if "pulls" in line)
    found = re.fullmatch(
        r"the pad mouth top (left|right) holds both ways and pulls with up to ([0-9.]+) kN at [0-9.]+ s, first at "
        r"([0-9.]+) s, and 3 more: if it can only push, set unilateral = true in the ring tail and the "
        "ring mouth",
        line,
    )
    assert found and float(found[2]) > 0.99e-3 * -expected["mouth top"]  # with what it swings beyond
    assert float(found[3]) == rows[f"the pad mouth top {found[1]} holds both ways and pulls"]
    pads = {pad["name"]: pad for pad in at_rest.summary["pads"]}
    faces = ("bottom right", "bottom left", "top right", "top left", "left", "right")
    assert list(pads) == [f"{ring} {face}" for ring in ("aft", "tail", "mouth") for face in faces]
    assert set(pads["aft left"].values()) == {"aft left", 0.0, 1.8}  # no force, and the path rests
    largest = max(pads["mouth bottom left"]["max"], -pads["mouth bottom left"]["min"])
    assert pads["mouth bottom left"]["pressure"] == pytest.approx(largest / (0.3 * 0.08), rel=1e-15)
    response = at_rest.responses["reduced"]
    for name, pad in pads.items():
        force = response.force(force_name(name))
        assert (pad["min"], pad["max"]) == (force.min(), force.max())
        assert (
            force[response.t == pad["t_min"]][0] == force.min() and force[response.t == pad["t_max"]][0] == force.max()
        )


def response_with(forces: dict[str, Callable[[np.ndarray], np.ndarray]]) -> Response:
    """A response that holds these forces alone."""
    t = np.linspace(0.0, 1.0, 101)
    columns = np.stack([force(t) for force in forces.values()], axis=1)
    nothing, names = np.zeros((101, 0)), tuple(map(force_name, forces))
    return Response(t, np.zeros(0), nothing, Energy(t, t, t), columns, t, t, 0.0, force_names=names)


def boom(*overrides: str) -> Scene:
    path = "slider.path={kind='ramp',times=[0.0,1.0],values=[1.5,2.5]}"
    scene = scenes.load("boom_beam", [path, *overrides])
    return scene


def pull_warnings(scene: Scene, response: Response) -> list[str]:
    """Warnings of a run about pads of a single body that pull."""
    exceeded = exceeded_limits(pulled_pads(scene, ()), history_by_name(scene, response))
    return list(exceeded_warnings(exceeded, lambda k: f"at {response.t[k]:g} s"))


def test_a_pull_counts_beside_what_else_is_borne() -> None:
    def said(least: float, most: float, others: float = 0.0) -> list[str]:
        forces = {
            "mouth left": lambda t: np.where(t < 0.5, most, least),
            "tail left": lambda t: np.full_like(t, others),
        }
        return pull_warnings(boom(), response_with(forces))

    assert said(-2500.0, 5000.0) == [
        "the pad mouth left holds both ways and pulls with up to 2.5 kN at 0.5 s: if it can only push, set "
        "unilateral = true in the ring mouth"
    ]
    assert said(-51.0, 5000.0) and not said(-49.0, 5000.0)  # one per cent of its own push
    assert said(-51.0, 0.0, others=5e4) and not said(-49.0, 0.0, others=5e4)  # one per mille of another pad's
    assert said(-1e-5, 0.0) and not said(-1e-7, 0.0)  # whatever the size, beyond round-off


def test_a_luffing_cylinder_that_holds_the_base_is_no_pad() -> None:
    frame = "frame={pivot=[0.0,0.0,0.0],luffing=0.5,cylinder={foot=[0.5,-1.0],lug=[2.0,-0.2],stiffness=1e8}}"
    pin = "sections.base.supports=[{name='pin',directions=['x','z']}]"
    scene = scenes.load_any("boom_two", [frame, pin, "gravity={}", "time.end=0.02", "section.mesh.elements=6"])
    response = simulate(scene, reduce(scene).system)
    assert "force of base luffing cylinder" in response.force_names
    assert {name.rpartition(" ")[0] for name in pad_extremes(scene, response)} == {"fly tail", "fly mouth"}


def test_rigid_pads_that_stay_are_said_to_be_unknown() -> None:
    rigid = f"pads=[{{name='tail',at=0.15,{ALL_ROUND},stiffness='rigid'}},{{name='mouth',moving=true,{ALL_ROUND}}}]"
    scene = boom(rigid)
    (line,) = unknown_force_warnings(scene, response_with({"mouth left": np.cos}))
    assert line.startswith("the pads tail bottom right, tail bottom left, ") and "their forces are unknown" in line
    names = [name for ring in scene.pads for name, _, _ in ring.named_pads]
    assert not unknown_force_warnings(scene, response_with(dict.fromkeys(names, np.cos)))
    assert not unknown_force_warnings(boom(), response_with({"mouth left": np.cos}))


def test_points_that_hold_a_planar_beam_hold_it_both_ways() -> None:
    scene, found = scenes.load("evolved_residual"), response_with({"slider at s": lambda t: -t})
    assert pad_extremes(scene, found) == {}
    assert pull_warnings(scene, found) == unknown_force_warnings(scene, found) == []


#: Structures of the sweep: a sample in CI, all of them with PMR_SWEEP=full.
BOOMS = 60 if os.environ.get("PMR_SWEEP") == "full" else 8


def rings(rng: np.random.Generator) -> tuple[str, dict[str, float]]:
    """Rings in any order, two of which carry: pads in TOML, and the share of its ring's force that each pad takes."""
    written, shares = [], {}
    for k in range(int(rng.integers(1, 4))):
        moving, x = bool(rng.random() < 0.5), rng.uniform(-0.4, 0.8)
        at = f"at={x if moving else 0.6 + abs(x):.3f},moving={str(moving).lower()}"
        faces = "bottom=[0.0],right=[0.0]" if rng.random() < 0.5 else "top=[-0.1,0.1],left=[0.0],bottom=[0.1]"
        written.append(f"{{name='open {k}',{at},faces={{{faces}}},unilateral=true,clearance=0.05}}")
    for name, place in (("tail", "at=0.15"), ("mouth", "moving=true")):
        count = {face: int(rng.integers(1, 3)) for face in ("bottom", "top")}
        across = {1: "[0.0]", 2: "[-0.1,0.1]"}
        faces = ",".join(f"{face}={across[n]}" for face, n in count.items())
        written.append(f"{{name='{name}',{place},faces={{{faces},left=[0.0]}}}}")
        for face, n in count.items():
            sign = 1.0 if face == "bottom" else -1.0
            names = [f"{name} {face} {side}" for side in ("right", "left")] if n == 2 else [f"{name} {face}"]
            shares |= dict.fromkeys(names, sign / sum(count.values()))
    return f"pads=[{','.join(rng.permutation(written))}]", shares


@pytest.mark.slow
def test_forces_stand_under_their_pads_in_rings_of_any_kind_and_order() -> None:
    rng = np.random.default_rng(4)
    of_ring = {face.split()[0]: abs(force) * 4.0 for face, force in statics().items()}
    of_ring["tail"] *= -1.0
    for _ in range(BOOMS):
        pads, shares = rings(rng)
        scene = scenes.load("boom_beam", [*AT_REST, pads, "reduction.estimate=false"])
        response = simulate(scene, reduce(scene).reduced)
        for name in (name for ring in scene.pads for name, _, _ in ring.named_pads):
            exact = shares.get(name, 0.0) * of_ring.get(name.split()[0], 0.0)
            assert response.force(force_name(name))[-1] == pytest.approx(exact, rel=5e-3, abs=2.0), (name, pads)
