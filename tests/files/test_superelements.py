"""Superelements: boundary nodes and amplitudes of fixed-interface modes, beside the matrices they were made from."""

from dataclasses import replace
from pathlib import Path

import bricks
import numpy as np
import pytest
import scipy.sparse as sp
from superelements import bar, boundary, superelement

import pmr
from pmr import InputError, from_matrices
from pmr.files.matrices import MODAL, GivenMatrices


def frequencies(body: GivenMatrices, folder: Path) -> np.ndarray:
    """Frequencies (S, 6) in Hz of a body on pads along the path."""
    body.save(folder / "bar.npz")
    (folder / "bar.toml").write_text(bricks._SCENE.replace('against = ["full"]', "against = []"))
    outcome = pmr.run(pmr.load_scene(folder / "bar.toml"))
    return np.asarray(outcome.result.frequencies.models["reduced"][:, :6])


@pytest.mark.slow
def test_a_superelement_on_pads_has_the_frequencies_of_all_nodes(tmp_path: Path) -> None:
    whole = bar(3)
    part = superelement(whole, boundary(whole), 8)
    assert part.size < 0.6 * whole.size and part.mass == pytest.approx(whole.mass, rel=1e-9) and not len(part.held)
    assert frequencies(part, tmp_path) == pytest.approx(frequencies(whole, tmp_path), rel=5e-3)


@pytest.mark.parametrize(("along", "held"), [((0, 1, 2), 6), ((2,), 2), ((0, 2), 5)])
def test_supports_inside_a_superelement_are_told_from_its_stiffness(along: tuple[int, ...], held: int) -> None:
    whole = bar()
    at_tail = np.isin(whole.node, whole.groups["tail"]) & np.isin(whole.direction, along)
    nodes = np.setdiff1d(boundary(whole), whole.groups["tail"])
    assert len(superelement(whole, nodes, 4, np.flatnonzero(at_tail)).held) == held


def test_springs_to_ground_inside_a_superelement_are_told_from_its_stiffness() -> None:
    whole = bar()
    springs = np.zeros(whole.size)
    springs[np.isin(whole.node, whole.groups["tip"]) & (whole.direction == 2)] = 1e7
    sprung = replace(whole, K=sp.csr_matrix(whole.K + sp.diags(springs)))
    assert len(superelement(sprung, boundary(whole), 4).held) == 2


def test_a_superelement_is_stored_and_read(tmp_path: Path) -> None:
    part = superelement(bar(), boundary(bar()), 3)
    read = GivenMatrices.load(part.save(tmp_path / "part.npz"))
    assert read.modal.sum() == 3 and (read.K != part.K).nnz == 0 and np.array_equal(read.node, part.node)


def test_modal_amplitudes_are_read_from_rows_without_a_node(tmp_path: Path, run_command) -> None:
    whole = bar()
    part = superelement(whole, boundary(whole), 3)
    for name, A in (("K", part.K), ("M", part.M)):
        sp.save_npz(tmp_path / f"{name}.npz", A)
    rows = ["node,direction", *(f"{n + 1},{d + 1}" for n, d in zip(part.node[:-3], part.direction[:-3], strict=True))]
    (tmp_path / "dofs.csv").write_text("\n".join([*rows, "90001,0", "90002,0", "90003,0", ""]))
    places = [f"{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(part.points.tolist(), 1)]
    (tmp_path / "nodes.csv").write_text("\n".join(["node,x,y,z", *places, "5000,1.2,0,0", ""]))  # the last has no row
    files = [f"--{name}={tmp_path / file}" for name, file in (("mass", "M.npz"), ("dofs", "dofs.csv"))]
    arguments = str(tmp_path / "K.npz"), *files, f"--nodes={tmp_path / 'nodes.csv'}"
    done = run_command("matrices", *arguments)
    assert done.returncode == 0, done.stderr
    assert "3 of them modal amplitudes" in done.stdout and "free to move as a rigid body" in done.stdout
    assert len(GivenMatrices.load(tmp_path / "K-matrices.npz").points) == len(part.points)


def test_an_amplitude_that_takes_energy_away_is_refused() -> None:
    part = superelement(bar(), boundary(bar()), 2)
    M = part.M.tolil()
    M[0, -1] = M[-1, 0] = 10.0 * np.sqrt(part.M[0, 0] * part.M[-1, -1])
    with pytest.raises(InputError, match="without negative eigenvalues"):
        replace(part, M=sp.csr_matrix(M))


def test_amplitudes_alone_are_refused() -> None:
    none = np.full(2, MODAL)
    with pytest.raises(InputError, match="coordinates of nodes are allowed, not modal amplitudes alone"):
        from_matrices(np.eye(2), np.eye(2), np.eye(3), {}, none, none)


def test_nodes_that_are_condensed_are_left_out_if_nothing_is_held(caplog: pytest.LogCaptureFixture) -> None:
    """Guyan's condensation of a free bar, with all of its nodes in the list: those inside are not fixed."""
    whole = bar()
    nodes = boundary(whole)
    part = superelement(whole, nodes, 1)
    K, M = (A[: part.size - 1, : part.size - 1] for A in (part.K, part.M))
    node, direction = nodes[part.node[:-1]], part.direction[:-1]
    given = from_matrices(M, K, whole.points, whole.groups, node, direction)
    assert len(given.points) == len(nodes) and not given.lacks and not len(given.held)
    assert np.array_equal(given.points[given.groups["bottom"]], part.points[part.groups["bottom"]])
    assert f"{len(whole.points) - len(nodes)} nodes have no coordinate, but K holds no rigid motion" in caplog.text
