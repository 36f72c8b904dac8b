"""Frequencies of held systems and of beams in closed form; the response in frequency that a scene may ask for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plain_machines
import pytest
import scipy.linalg
from alone import frequencies
from oracle import flexible, full_body
from scipy.interpolate import PPoly
from textbook import CLOSED_FORM, EI, LENGTH, RHO_A, TIP_DEFLECTION, static_tip_deflection

from pmr import InputError, ReducedModel, RunResult, reduce, run
from pmr import pipeline as whole
from pmr import scene as scenes
from pmr.compare.errors import band_limit, error_below_frequency
from pmr.compare.frequencies import (
    bending_frequencies,
    closed_form_frequencies,
    frequencies_on_way,
    frequency_part,
    lowest_mode_part,
    published_part,
    response_on_way,
    way_points,
)
from pmr.report import sections
from pmr.report.numbers import SPACE
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of


def test_reduced_frequencies_are_those_of_the_held_system() -> None:
    """Three masses of 1 kg on springs of 1, 4 and 9 N/m; the row holds one after the other."""
    I, c = np.eye(3), np.zeros((2, 2, 1, 3))
    c[0, :, 0], c[1, :, 0] = np.diff(I, axis=0), I[:2]
    rows = PPoly(c, [0.5, 1.5, 2.5])
    model = ReducedModel(I, 0 * I, np.diag([1.0, 4.0, 9.0]), I[:, :1], I, rows, ("F",), ("slider",), np.arange(3.0))
    found = 2.0 * np.pi * frequencies(model, np.array([0.5, 1.5, 2.5]), 3)
    assert found[:, :2] == pytest.approx(np.array([[2.0, 3.0], [1.0, 3.0], [1.0, 2.0]]))
    assert np.all(np.isnan(found[:, 2]))


def test_rows_that_give_way_are_springs() -> None:
    """Two free masses of 1 kg, one on a pad of 25 N/m, the other held."""
    c = np.zeros((1, 1, 2, 2))
    c[0, 0] = np.eye(2)
    I = np.eye(2)
    model = ReducedModel(
        I, 0 * I, 0 * I, I[:, :1], I, PPoly(c, [0.0, 1.0]), ("F",), ("pad", "pin"), np.arange(2.0),
        pads=np.array([1.0 / 25.0, 0.0]),
    )  # fmt: skip
    assert 2.0 * np.pi * frequencies(model, np.array([0.5]), 1) == pytest.approx(np.array([[5.0]]))


def test_frequencies_of_a_model_with_residual_flexibility_are_those_of_the_full_one() -> None:
    s = np.array([1.25, 2.45, 3.7])
    model = flexible(full_body(elements=40), 10)
    omega = 2.0 * np.pi * frequencies(model, s, 2)
    assert omega[0] == pytest.approx(CLOSED_FORM[1.25][:2], rel=1e-5)
    assert np.isfinite(omega).all()


def test_closed_form_where_there_is_one(load_scene) -> None:
    s = np.array([1.25, 2.5])
    bar = np.pi / 10.0 * np.sqrt(2e7 / 78.0)  # between the third and the fourth of bending
    assert closed_form_frequencies(load_scene(), s, 4)[0, 3] == pytest.approx(bar)
    assert closed_form_frequencies(load_scene(), s, 3) == pytest.approx(np.array([CLOSED_FORM[1.25], CLOSED_FORM[2.5]]))
    for change in ("supports=[{on=0.0,kind='clamped'}]", "slider.offsets=[0.0,0.1]"):
        scene = load_scene("paper_simple", [change, "compare.against=[]", "reduction.coordinates=25"])
        assert closed_form_frequencies(scene, s, 3).shape == (2, 0)


@pytest.mark.parametrize("s", CLOSED_FORM)
def test_the_lowest_frequencies(s: float) -> None:
    assert bending_frequencies(s, LENGTH, EI, RHO_A, 3) == pytest.approx(CLOSED_FORM[s], rel=1e-9)


def test_supported_at_its_end_the_beam_is_the_simply_supported_one() -> None:
    n = np.arange(1, 13)
    assert bending_frequencies(5.0, LENGTH, EI, RHO_A, 12) == pytest.approx(
        (n * np.pi / 5.0) ** 2 * np.sqrt(EI / RHO_A)
    )


def test_a_support_close_to_the_pin_makes_a_cantilever() -> None:
    assert bending_frequencies(1e-6, 1.0, 1.0, 1.0, 2) == pytest.approx(np.array([1.8751041, 4.6940911]) ** 2, rel=1e-4)


def test_many_roots_none_lost() -> None:
    """Root n lies between those of the beam with one support fewer and one more: spacing of beta L about pi."""
    beta = np.sqrt(bending_frequencies(2.2, 5.0, 1.0, 1.0, 40)) * 5.0
    assert np.all(np.diff(beta) < 1.7 * np.pi) and beta[-1] == pytest.approx(40 * np.pi, abs=np.pi)


@pytest.mark.parametrize("s", [0.0, 5.1, -1.0])
def test_a_support_off_the_beam_is_refused(s: float) -> None:
    with pytest.raises(ValueError, match="allowed are 0 < s <= 5 m"):
        bending_frequencies(s, LENGTH, EI, RHO_A, 1)


@pytest.mark.parametrize("s", TIP_DEFLECTION)
def test_static_tip_deflection(s: float) -> None:
    assert static_tip_deflection(-50.0, s, LENGTH, EI) == pytest.approx(TIP_DEFLECTION[s], rel=1e-12)


BOOM = "boom_beam"

ASKED = [
    "observe.frequency_response=true", "time.end=0.1", "compare.against=[]", "mesh.elements=12", "recovery.every=0.1",
]  # fmt: skip

STEADY = "slider.path=2.5"


@pytest.fixture(scope="module")
def outcome() -> whole.Outcome:
    found = whole.run(scenes.load(BOOM, [*ASKED, STEADY, "recovery.stress=false"]))
    assert found is not None
    return found


def test_the_response_is_that_of_the_equations_with_multipliers(outcome: whole.Outcome) -> None:
    """(-w^2 M + i w D + K) p + C^T lambda = B f,  C p + H f - (G + 1/k) lambda = 0,  y = O p + W f - X lambda."""
    model, found = outcome.reduced, outcome.result.frequency_response
    assert found is not None and model.flexibility is not None
    assert dict(zip(found.inputs, found.outputs, strict=True)) == {
        "tip force": "tip z",
        "gust": "tip y",
        "gravity": "tip z",
    }
    at = [model.output_names.index(name) for name in found.outputs]
    C, flex = model.C(2.5), model.flexibility
    F = flex.rows(2.5) + np.diag(model.row_compliance)
    for k in (0, 150, 399):
        w = 2.0 * np.pi * found.f[k]
        upper = np.hstack([-(w**2) * model.M + 1j * w * model.D + model.K, C.T])
        A = np.vstack([upper, np.hstack([C, -F])])
        x = np.linalg.solve(A, np.vstack([model.B, -flex.inputs(2.5)]))
        p, multipliers = x[: model.size], x[model.size :]
        y = np.diagonal(model.outputs[at] @ p + flex.direct[at] - flex.outputs(2.5)[at] @ multipliers)
        np.testing.assert_allclose(found.gain[0, k], np.abs(y), rtol=1e-7, atol=1e-9 * np.abs(y).max())


def test_summary_results_and_report_have_it(outcome: whole.Outcome, tmp_path: Path) -> None:
    result = outcome.result
    said = result.summary["frequency_response"]["gain"]["tip force"]
    found = result.frequency_response
    assert found is not None and found.damped and said["unit"] == "m/N"
    load = found.inputs.index("tip force")
    assert said["largest"][0] == found.gain[0, :, load].max() > abs(said["static"][0]) > 0.0
    result.save(tmp_path)
    again_result = RunResult.load(tmp_path)
    again = again_result.frequency_response
    assert again is not None and again.inputs == found.inputs
    np.testing.assert_array_equal(again.gain, found.gain)
    block = sections.response_block(again_result, "case")
    assert block is not None and len(block.drawings) == 3 and len(block.grids) == 3
    assert block.grids[0].rows[0][0] == f"2.5{SPACE}m" and "Frequency in Hz" in block.drawings[0].svg
    assert sections.response_block(replace(result, frequency_response=None), "case") is None


def test_only_who_asks_for_it_gets_it() -> None:
    scene = scenes.load(BOOM)
    assert response_on_way(scene, None, None) is None and frequency_part(None).figures == {}  # type: ignore[arg-type]


@pytest.mark.parametrize("other", ["pads.mouth.unilateral=true", "reduction.flexibility=false"])
def test_what_has_no_linear_response_is_refused(other: str) -> None:
    with pytest.raises(InputError, match="observe.frequency_response"):
        scenes.load(BOOM, ["observe.frequency_response=true", other])


@pytest.mark.slow
def test_what_moves_freely_has_no_static_response() -> None:
    """A gain at low frequencies would be that of the round-off of a frequency of 0."""
    scene = Scene.model_validate(
        {
            "title": "pinned beam",
            "free_motions": "allowed",
            "body": {
                "model": "beam3d",
                "box": {"length": 6.0, "width": 0.2, "height": 0.3, "wall": 0.006},
                "material": {"young": 2.1e11, "density": 7850.0, "poisson": 0.3},
            },
            "mesh": {"elements": 4},
            "supports": [{"on": "tail", "kind": "pinned"}],
            "loads": [{"name": "F", "on": "tip", "direction": "z", "signal": {"kind": "constant", "amount": 1.0}}],
            "observe": {"frequency_response": True},
            "reduction": {"coordinates": 6, "estimate": False},
            "time": {"end": 0.1, "step": 0.01},
            "compare": {"against": []},
        }
    )
    with pytest.raises(InputError, match="frequency_response = True: false is allowed: bodies move freely"):
        whole.run(scene)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_boom_answers_as_its_equations_with_multipliers_say() -> None:
    """Of two sections, at places from its shortest reach to its longest; cylinders are rigid, and so are such rows."""
    changes = [
        "compare.against=[]",
        "section.mesh.elements=8",
        "time.end=0.2",
        "section.joint.extension={kind='smooth_ramp',times=[0.0,0.2],values=[1.0,1.3]}",
        "sections.fly.observe.frequency_response=true",
        *(f"section.joint.{end}.0.unilateral=false" for end in ("tail", "mouth")),
    ]
    boom = scenes.load_any("boom_two", changes)
    outcome = run(boom)
    assert outcome is not None
    found, system = outcome.result.frequency_response, system_of(boom, outcome.reduced)
    assert found is not None and len(found.s) == 5 and np.all(np.diff(found.s) > 0.0)
    assembly = Assembly(system)
    for place in (0, 4):
        rows = assembly.contact_rows(system.side_coordinates({"fly": found.s[place] - boom.sections[1].length}))
        M, D, K = (A.toarray() for A in (assembly.M, assembly.D, assembly.K))
        at = [name for body, of in system.bodies.items() for name in (f"{body}: {one}" for one in of.output_names)]
        for k in (0, 200, 399):
            w = 2.0 * np.pi * found.f[k]
            # Rigid contacts by their null space, the others by their stiffness: another way than with multipliers.
            rigid = np.all(rows.F == 0.0, axis=1)
            Z = scipy.linalg.null_space(rows.C[rigid])
            C, H, X = rows.C[~rigid], rows.H[~rigid], rows.X[:, ~rigid]
            k_c = np.linalg.inv(rows.F[np.ix_(~rigid, ~rigid)])
            A = Z.T @ (K + C.T @ k_c @ C + 1j * w * D - w**2 * M) @ Z
            q = Z @ np.linalg.solve(A, Z.T @ (assembly.B.toarray() - C.T @ k_c @ H))
            y = assembly.outputs.toarray() @ q + assembly.direct - X @ k_c @ (C @ q + H)
            for number, (name, output) in enumerate(zip(found.inputs, found.outputs, strict=True)):
                assert name == system.input_names[number]
                gain, size = np.abs(y[at.index(output), number]), np.abs(y).max()
                assert found.gain[place, k, number] == pytest.approx(gain, rel=1e-6, abs=1e-9 * size)
    figures = outcome.result.summary["frequency_response"]
    assert figures["s"] == found.s.tolist() and set(figures["gain"]) == set(system.input_names)


def test_pads_of_joints_that_only_push_have_no_linear_response() -> None:
    with pytest.raises(InputError, match="observe.frequency_response.*only push"):
        scenes.load_any("boom_two", ["sections.fly.observe.frequency_response=true"])


STEP = 1e-3

T = np.arange(2000) * STEP


def tone(frequency: float, amplitude: float = 1.0) -> np.ndarray:
    """With a whole number of periods."""
    return amplitude * np.sin(2.0 * np.pi * frequency * T)[:, None]


def test_what_two_signals_have_above_a_frequency_does_not_count() -> None:
    one, other = tone(5.0) + tone(80.0), 1.1 * tone(5.0) + tone(80.0, 3.0)
    assert error_below_frequency(one, other, STEP, 20.0) == pytest.approx(0.1 / 1.1, rel=1e-9)
    assert error_below_frequency(one, other, STEP, 1e3) == pytest.approx(
        np.hypot(0.1, 2.0) / np.hypot(1.1, 3.0), rel=1e-9
    )


def test_the_band_ends_where_a_hundredth_is_left() -> None:
    for amplitude, highest in ((0.5, 60.0), (0.001, 10.0)):
        found = band_limit(tone(10.0) + tone(60.0, amplitude), STEP)
        assert highest <= found <= highest + 3.0 / (len(T) * STEP)  # the window's width
    assert band_limit(np.zeros((10, 2)), STEP) == 0.0


@pytest.mark.parametrize(("width", "height", "direction"), [(0.3, 0.6, "y"), (0.8, 0.4, "z")])
def test_the_lowest_mode_moves_the_tip_across_the_thinner_side_of_a_box(
    width: float, height: float, direction: str
) -> None:
    sizes = [f"body.box.width={width}", f"body.box.height={height}"]
    scene = scenes.load_any("boom_beam", [*sizes, "compare.against=[]"])
    system, excitation = reduce(scene).system, Excitation.from_scene(scene)
    natural = frequencies_on_way(scene, system, excitation, way_points(scene, system, excitation, 0))
    assert lowest_mode_part(scene, system, excitation, natural).figures == {"lowest_mode": {"direction": direction}}


def test_frequencies_are_those_of_the_softest_posture_at_a_boom_length() -> None:
    """The middle section goes out by as much as the last one comes in, and both go back half of the way."""
    moved = (
        f"{key}.extension={{kind='smooth_ramp',times=[0.0,1.0,2.0],values={values}}}"
        for key, values in (("sections.middle.joint", [1.0, 4.0, 2.5]), ("sections.fly.joint", [4.0, 1.0, 2.5]))
    )
    small = ("section.mesh.elements=6", "frame.second_order=false", "compare.against=[]", "time.end=2.0", *moved)
    scene = scenes.load_any(plain_machines.CRANE, small)
    system, excitation = reduce(scene).system, Excitation.from_scene(scene)
    natural = frequencies_on_way(scene, system, excitation, way_points(scene, system, excitation, 0))
    steps = excitation.s[::20]
    everywhere = Assembly(system).frequencies(system.side_coordinates(dict(zip(system.paths, steps.T, strict=True))), 1)
    assert natural.models["reduced"][0, 0] == pytest.approx(everywhere.min(), rel=1e-9)
    assert everywhere.max() > 1.05 * everywhere.min()


def test_a_published_frequency_is_that_of_the_softest_posture_at_its_length() -> None:
    """A boom of 10 m luffs from 60 to 10 degrees, where it is stiffer; beside 1.9 Hz stood 2.86 Hz."""
    published = "published={source='a paper', frequencies=[{reach=10.0, first=1.9}]}"
    scene = scenes.load_any("crane", [published])
    of_model = {"full": np.array([[1.98], [2.5], [2.86]]), "reduced": np.array([[1.99], [2.51], [2.87]])}
    luffs = Frequencies(np.full(3, 10.0), np.zeros((3, 2)), of_model, t=np.arange(3.0))
    (row,) = published_part(scene, luffs).figures["published_frequencies"]
    assert row == {"reach": 10.0, "published": 1.9, "full": 1.98, "reduced": 1.99}


def test_at_rest_a_boom_vibrates_without_the_pads_that_its_weight_lifts() -> None:
    """As one whose pads on top of tails and at the bottom of mouths hold both ways, as springs of two pads each."""
    still = [f"section.joint.{end}.0.faces={{bottom=[0.0],top=[0.0]}}" for end in ("tail", "mouth")]
    loaded = [f"section.joint.{end}.0.faces={{{face}=[0.0]}}" for end, face in (("tail", "top"), ("mouth", "bottom"))]
    natural = []
    for faces, pushes in ((still, "true"), (loaded, "false")):
        keys = (f"unilateral={pushes}", f"stiffness={1e8 if pushes == 'true' else 5e7}")
        held = [f"section.joint.{end}.0.{key}" for end in ("tail", "mouth") for key in keys]
        small = ("section.mesh.elements=12", "sections.fly.loads=[]", "compare.against=[]", *faces, *held)
        scene = scenes.load_any("boom_two", small)
        system, excitation = reduce(scene).system, Excitation.from_scene(scene)
        natural.append(frequencies_on_way(scene, system, excitation, way_points(scene, system, excitation, 0)))
    pushing, held_by_few = natural
    assert pushing.resting == pytest.approx(held_by_few.models["reduced"][:, 0], rel=1e-5)
    assert np.all(pushing.resting < 0.999 * pushing.models["reduced"][:, 0]) and held_by_few.resting is None
