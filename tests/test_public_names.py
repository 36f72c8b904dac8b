"""The names of `import pmr`: each is there, and a room that is called does what its name says."""

import importlib
import subprocess
import sys
import warnings

import pytest

import pmr
from pmr import scene as scenes
from pmr.errors import FormerName, lazy_names


def test_every_public_name_is_there() -> None:
    assert pmr.load_scene is scenes.load_any
    assert {"ReducedModel", "Stepper", "System", "load_scene", "reduce", "run", "simulate"} <= set(dir(pmr))
    assert all(getattr(pmr, name) is not None for name in dir(pmr))


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(AttributeError, match="load_scene"):
        _ = pmr.loadscene


def test_a_former_name_is_answered_with_a_warning_that_has_both() -> None:
    """It points at the line that asks; what is called so now is found without one."""
    find = lazy_names(
        "pmr", {"load_scene": "pmr.scene:load_any"}, former={"read_scene": FormerName("load_scene", "0.3")}
    )
    with pytest.warns(DeprecationWarning, match=r"pmr\.read_scene is called pmr\.load_scene now; 0\.3 has") as said:
        assert find("read_scene") is scenes.load_any
    assert said[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert find("load_scene") is scenes.load_any


@pytest.mark.slow
@pytest.mark.parametrize("before", ["", "import pmr.simulation.native.systems; "])
def test_a_room_is_called_and_stays_a_package(before: str) -> None:
    """In a process of its own, once without and once after the package was imported by itself."""
    code = f"{before}import pmr, pmr.simulation.stepping as room; assert callable(pmr.simulate), room"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("imported", ["pmr", "pmr.cli"])
def test_importing_pmr_or_its_commands_imports_nothing_heavy(imported: str) -> None:
    heavy = {"numpy", "pydantic", "cffi", "dolfinx", "exudyn"}
    code = f"import sys, {imported}; assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_versions_are_told_without_what_computes() -> None:
    code = (
        "import sys; from pmr.pipeline import fenicsx_versions; assert not {'pmr.scene', 'pydantic'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_reduce_and_simulate_from_a_scene() -> None:
    scene = pmr.load_scene("evolved_residual", ["mesh.elements=10", "time.end=0.01"])
    response = pmr.simulate(scene, pmr.reduce(scene).reduced)
    direct = importlib.import_module("pmr.pipeline").run(scene)
    assert response.displacement.shape == direct.result.responses["reduced"].displacement.shape
    assert (response.displacement == direct.result.responses["reduced"].displacement).all()
