"""A section's model is no model of a boom: refused wherever a whole body is asked for, written alone if named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from processes import called

import pmr
from pmr.errors import InputError
from pmr.export.formats import FORMATS
from pmr.scene import Scene
from pmr.scene.signals import Constant
from pmr.system.reduced_model import ReducedModel

SHORT = ["compare.against=[]", "time.end=0.05", "section.mesh.elements=8"]
STATE_SPACES = [name for name, one in FORMATS.items() if "section" in one.options]


@pytest.fixture(scope="module")
def boom() -> Scene:
    found = pmr.load_scene("boom_two", SHORT)
    return found


@pytest.fixture(scope="module")
def models(boom: Scene) -> dict[str, ReducedModel]:
    return dict(pmr.reduce(boom).reduced)


@pytest.fixture
def fly(models: dict[str, ReducedModel], tmp_path: Path) -> Path:
    return models["fly"].save(tmp_path / "reduced-fly.npz")


@pytest.mark.parametrize("to", FORMATS)
def test_no_format_takes_it_for_a_boom(to: str, fly: Path, monkeypatch, capsys) -> None:
    done = called(monkeypatch, capsys, "export", str(fly), "--to", to)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "reduced-fly.npz: section = 'fly'" in done.stderr
    assert [file.name for file in fly.parent.iterdir()] == [fly.name]


@pytest.mark.slow
@pytest.mark.parametrize("to", FORMATS)
def test_it_is_written_alone_where_it_is_named(to: str, fly: Path, monkeypatch, capsys) -> None:
    """Only where it is named by its own name, and only as what needs no path: a state space of the free section."""
    named = ("export", str(fly), "--to", to, "--section")
    wrong, done = (called(monkeypatch, capsys, *named, name) for name in ("base", "fly"))
    assert wrong.returncode == 2
    if to not in STATE_SPACES:
        assert done.returncode == 2 and "it is allowed with --to matlab, " in done.stderr
        return
    assert "--section = 'base': 'fly' is allowed" in wrong.stderr
    assert done.returncode == 0 and "section fly alone, without its joints" in done.stdout


def test_what_is_written_is_the_free_section(fly: Path, monkeypatch, capsys) -> None:
    """Its own modes, three of them rigid, and the answer O (K - w^2 M + i w D)^-1 B + W to forces."""
    assert called(monkeypatch, capsys, "export", str(fly), "--to", "matlab", "--section", "fly").returncode == 0
    data, model = scipy.io.loadmat(fly.with_name("state_space.mat")), ReducedModel.load(fly)
    A, B, C, D = (data[name][:, :, 0] for name in "ABCD")
    assert data["s"].shape == (1, 1) and data["inputs"][0, 0].item() == "fly.tip force" and len(C) == len(model.outputs)
    omega2 = np.sort(-np.linalg.eigvals(A[model.size :, : model.size]).real)
    assert np.all(np.abs(omega2[:3]) <= 1e-9 * omega2[-1])  # three rigid motions
    np.testing.assert_allclose(omega2[3:], np.sort(np.diagonal(model.K))[3:], rtol=1e-9)
    w = 0.5 * np.sqrt(omega2[3])
    assert model.flexibility is not None
    direct = np.linalg.solve(model.K - w**2 * model.M + 1j * w * model.D, model.B)
    expected = model.outputs @ direct + model.flexibility.direct
    found = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_it_is_not_simulated_as_a_whole_body(models: dict[str, ReducedModel]) -> None:
    for use in (
        lambda: pmr.Stepper(models["fly"], 1e-3, 1.0),
        lambda: pmr.simulate(pmr.load_scene("boom_beam"), models["fly"]),
    ):
        with pytest.raises(InputError, match="section = 'fly': the model of a whole body is allowed"):
            use()
    exudyn = pytest.importorskip("exudyn")
    from pmr.simulation.exudyn import add_sliding_body

    loads = {name: Constant(amount=0.0) for name in models["fly"].input_names}
    with pytest.raises(InputError, match="section = 'fly'"):
        add_sliding_body(exudyn.SystemContainer().AddSystem(), models["fly"], Constant(amount=1.0), loads)


def test_a_whole_body_is_no_section(tmp_path: Path, monkeypatch, capsys) -> None:
    scene = pmr.load_scene("evolved_residual", ["mesh.elements=6"])
    model = pmr.reduce(scene).reduced.save(tmp_path / "reduced.npz")
    done = called(monkeypatch, capsys, "export", str(model), "--to", "matlab", "--section", "fly")
    assert done.returncode == 2 and "--section = 'fly': none is allowed" in done.stderr
    with pytest.raises(InputError, match="pmr.simulate: models = 'ReducedModel': a model for each section"):
        pmr.simulate(pmr.load_scene("boom_two", SHORT), ReducedModel.load(model))


@pytest.mark.slow
def test_a_boom_is_reduced_and_simulated_in_python(
    models: dict[str, ReducedModel], boom: Scene, tmp_path: Path
) -> None:
    """Saved and read again, too: the same equations in the same order."""
    read = {name: ReducedModel.load(one.save(tmp_path / f"{name}.npz")) for name, one in models.items()}
    found, run = pmr.simulate(boom, read), pmr.run(boom).result.responses["reduced"]
    np.testing.assert_array_equal(found.displacement, run.displacement)
    np.testing.assert_array_equal(found.slider_force, run.slider_force)
    with pytest.raises(InputError, match="models.base = 'section fly': the model of section base is allowed"):
        pmr.simulate(boom, {"base": read["fly"], "fly": read["fly"]})
    with pytest.raises(InputError, match=r"models = \['fly'\]: a model for each section"):
        pmr.simulate(boom, {"fly": read["fly"]})
    with pytest.raises(InputError, match=r"sections.fly.loads = \[\]: the inputs of its model are allowed"):
        pmr.simulate(pmr.load_scene("boom_two", [*SHORT, "sections.fly.loads=[]"]), read)
    with pytest.raises(InputError, match="accuracy: none is allowed for pmr.reduce, which makes only"):
        pmr.reduce(pmr.load_scene("boom_two", [*SHORT, "accuracy.tolerance=0.01"]))
