"""Ports: what is hung there on the coordinates alone feels the flexibility of the full body."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import one_body
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from springs import CompliantRows

import pmr
from pmr import InputError, ReducedModel, reduce
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.members import member_at
from pmr.scene.signals import Constant
from pmr.simulation import Excitation
from pmr.simulation.exudyn import add_sliding_body
from pmr.system.body import FullBody

Load = Callable[..., Scene]
COARSE = ["compare.against=[]", "mesh.elements=20", "reduction.coordinates=6", "time.end=0.5"]
SHELL = ["compare.against=[]", "mesh.size=0.3", "mesh.along=1.0", "reduction.coordinates=8"]
MASS, WEIGHT = 250.0, 250.0 * 9.81


def flexibility(body: FullBody, rows: sp.csr_matrix, s: float) -> Array:
    """What unit forces on rows (p, n) move them by, (p, p): pads are springs, rigid rows hold."""
    C = sp.csr_matrix(body.C(s))
    soft = body.row_compliance > 0.0
    K = body.K + C[soft].T @ sp.diags(1.0 / body.row_compliance[soft]) @ C[soft]
    firm = C[~soft]
    whole = sp.bmat([[K, firm.T], [firm, None]], "csc") if firm.shape[0] else sp.csc_matrix(K)
    loads = np.zeros((whole.shape[0], rows.shape[0]))
    loads[: body.size] = rows.toarray().T
    return np.asarray(rows @ spla.splu(whole).solve(loads)[: body.size])


def of_coordinates(model: ReducedModel, rows: Array, s: float) -> Array:
    """The same of coordinates alone, as a connector in Exudyn finds it."""
    K = CompliantRows(model).system(np.array([s]))[0][:, : model.size]
    return np.asarray(rows @ np.linalg.solve(K, rows.T))


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
@pytest.mark.parametrize(
    ("name", "changes", "place"),
    [
        ("boom_beam", COARSE, "tip"),
        ("boom_beam", COARSE, 3.1),
        ("boom_shell", SHELL, "tip"),
        ("evolved_residual", [], 2.5),
    ],
)
def test_coordinates_alone_answer_all_forces_at_a_port(
    load_scene: Load, name: str, changes: list[str], place: str | float
) -> None:
    """Exactly at rest, wherever the sliders are; R is known to some 1e-10 of the flexibility."""
    made = reduce(load_scene(name, [*changes, f"reduction.ports={[place]!r}".replace("'", '"')]))
    model, whole = made.reduced, made.built[ALONE].model
    full = whole.gather()
    rows = np.array(list(model.ports.values()))
    assert list(model.ports) == list(whole.ports) and rows.shape[1] == model.size
    low, high = model.domain
    for s in (low + 0.3 * (high - low), low + 0.77 * (high - low)) if full is not None else ():
        expected = flexibility(full, sp.vstack(list(whole.ports.values()), format="csr"), s)
        scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
        assert np.all(np.abs(of_coordinates(model, rows, s) - expected) <= 1e-7 * scale)


def hung(scene: Scene, model: ReducedModel, row: Array) -> Array:
    """Motion (T,) m of a mass that hangs on a row of coordinates in an Exudyn system."""
    exu = pytest.importorskip("exudyn")
    items = exu.itemInterface
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    boom = add_sliding_body(mbs, model, scene.slider.path, member_at(scene).signals)
    zero: dict[str, Any] = dict.fromkeys(("referenceCoordinates", "initialCoordinates", "initialCoordinates_t"), [0.0])
    node = mbs.AddNode(items.NodeGenericODE2(numberOfODE2Coordinates=1, **zero))
    mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=np.array([[MASS]]), forceVector=[-WEIGHT]))
    marker = mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=node))
    joined = {"scalingMarker0": row[None], "scalingMarker1": np.eye(1)}
    mbs.AddObject(items.ObjectConnectorCoordinateVector(markerNumbers=[boom.mBody, marker], **joined))
    kind = exu.OutputVariableType.Coordinates
    sensor = mbs.AddSensor(items.SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = scene.time.step
    settings.timeIntegration.endTime = scene.time.end
    settings.timeIntegration.numberOfSteps = scene.time.steps
    settings.timeIntegration.generalizedAlpha.spectralRadius = scene.time.rho_inf
    settings.timeIntegration.verboseMode = 0
    mbs.SolveDynamic(settings)
    return np.asarray(mbs.GetSensorStoredData(sensor)[:, 1])


@pytest.mark.slow
@pytest.mark.numerical
def test_a_mass_that_hangs_on_a_port_in_exudyn_moves_as_on_the_full_boom(load_scene: Load) -> None:
    scene = load_scene("boom_beam", COARSE)
    without, with_port = reduce(scene), reduce(load_scene("boom_beam", [*COARSE, 'reduction.ports=["tip"]'])).reduced
    full = without.built[ALONE].model.gather()
    assert full is not None
    z = sp.csr_matrix(full.outputs[full.output_names.index("tip z")])
    heavy = replace(
        full,
        M=sp.csr_matrix(full.M + MASS * z.T @ z),
        B=np.column_stack([full.B, -WEIGHT * z.toarray()[0]]),
        input_names=(*full.input_names, "weight"),
    )
    excitation = Excitation.from_scene(scene)
    loads: Mapping[str, Any] = {**excitation.loads, "weight": Constant(amount=1.0)}
    expected = (z @ one_body.simulate(replace(heavy, rayleigh=None), replace(excitation, loads=loads)).q.T)[0]
    tip = without.reduced.outputs[without.reduced.output_names.index("tip z")]
    size = np.abs(expected).max()
    missed = np.abs(hung(scene, without.reduced, tip) - expected).max() / size
    found = np.abs(hung(scene, with_port, with_port.ports["tip z"]) - expected).max() / size
    assert missed > 0.01 and found < 0.1 * missed


def test_ports_are_stored(load_scene: Load, tmp_path: Path) -> None:
    model = reduce(load_scene("evolved_residual", ["reduction.ports=[2.5]"])).reduced
    read = ReducedModel.load(model.save(tmp_path / "model.npz"))
    assert set(read.ports) == set(model.ports) >= {"2.5 m z", "2.5 m ry"}
    assert all(np.array_equal(read.ports[name], row) for name, row in model.ports.items())
    wrong = replace(model, ports={"2.5 m z": model.ports["2.5 m z"][1:]})
    with pytest.raises(InputError, match="ports.2.5 m z has shape"):
        ReducedModel.load(wrong.save(tmp_path / "wrong.npz"))


@pytest.mark.parametrize(
    ("name", "changes", "says"),
    [
        ("boom_beam", ['reduction.basis="eigenmodes"'], "free modes with flexibility"),
        ("boom_beam", ["reduction.flexibility=false"], "free modes with flexibility"),
        ("boom_beam", ["accuracy.tolerance=0.01"], "without ports"),
    ],
)
def test_models_that_have_no_ports(load_scene: Load, name: str, changes: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_scene(name, [*changes, 'reduction.ports=["tip"]'])


def test_places_and_sections_that_have_no_ports(load_scene: Load) -> None:
    with pytest.raises(InputError, match="no ports are allowed for sections"):
        pmr.load_scene("boom_three", ['sections.fly.reduction.ports=["tip"]'])
    with pytest.raises(InputError, match="nowhere"):
        reduce(load_scene("boom_beam", [*COARSE, 'reduction.ports=["nowhere"]']))
