"""Flexible-body files: SID read by a reader of the tests' own, Exudyn's by Exudyn.
The .mat for Simscape's flexible body: frames first, six coordinates each; its frequencies are the full model's.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from bricks import bricks, on_pads
from processes import called

from pmr import InputError
from pmr import scene as scenes
from pmr.export.bodies import INERTIA, inertia_integrals, write_ffrf, write_sid
from pmr.fem.distributed import times
from pmr.fullmodel.build import build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes
from pmr.reduction.held_body import held_body, nodes_of
from pmr.results.field_series import NodalBody

S, MODES = 0.85, 5


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return on_pads(tmp_path_factory.mktemp("bar"))


@pytest.fixture(scope="module")
def body(scene_file: Path) -> NodalBody:
    return held_body(scenes.load(scene_file, ["damping.mass=0.5", "damping.stiffness=1e-5"]), S, MODES)


def read_sid(file: Path) -> dict[str, dict[str, np.ndarray]]:
    """Tables M0 (r, c) and M1 (r, q, c) of all matrices of a file; those of a node behind its number.

    By the published format (Wallrapp 1994) as ReadSID of the EMBS Modelica library takes it: a name alone on a line,
    six sizes, entries ``m0(r,c) = x`` and ``m1(r,q,c) = x`` with D for E, and ``end name``.
    """
    found, name, node, sizes = {}, "", "", {}
    for line in file.read_text().splitlines()[1:]:
        key, _, value = (part.strip() for part in line.partition("="))
        if key == "new node":
            node = f"{value} "
        elif key == "end node":
            node = ""
        elif key == "mass":
            found["mass"] = {"M0": np.array([[float(value.replace("D", "E"))]])}
        elif key in ("order", "nrow", "ncol", "nq", "nqn", "structure"):
            sizes[key] = int(value)
            if key == "structure":
                r, c, q = sizes["nrow"], sizes["ncol"], sizes["nq"]
                found[node + name] = {"M0": np.zeros((r, c)), "M1": np.zeros((r, q, c))}
        elif entry := re.fullmatch(r"(m[01])\(([ \d,]+)\)", key):
            at = tuple(int(part) - 1 for part in entry[2].split(","))
            found[node + name][entry[1].upper()][at] = float(value.replace("D", "E"))
        elif not value and not key.startswith("end"):
            name = key
    return found


@pytest.mark.slow
def test_a_sid_file_read_back_has_all_digits(body: NodalBody, tmp_path: Path) -> None:
    found = read_sid(write_sid(body, tmp_path / "bar.SID_FEM"))
    expected = inertia_integrals(body)
    assert found["mass"]["M0"].item() == pytest.approx(7850.0 * 2.0 * 0.2 * 0.3, rel=1e-12)
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name]["M0"], value.M0, err_msg=name)
        if value.M1 is not None:
            np.testing.assert_array_equal(found[name]["M1"], value.M1, err_msg=name)
    np.testing.assert_allclose(found["Ke"]["M0"], np.diag(body.omega**2), rtol=1e-15)
    np.testing.assert_array_equal(found["De"]["M0"], body.damping)
    assert np.all(np.diag(body.damping) < 0.5 + 1e-5 * body.omega**2)  # nothing damps what gives way at moving pads
    for k in range(len(body.frames.names)):
        np.testing.assert_array_equal(found[f"{k + 1} origin"]["M0"][:, 0], body.frames.points[k])
        np.testing.assert_array_equal(found[f"{k + 1} origin"]["M1"][:, :, 0], body.frames.displacement[k])
        np.testing.assert_array_equal(found[f"{k + 1} psi"]["M0"], body.frames.rotation[k])
        turned = np.cross(
            np.eye(3)[:, None], body.frames.rotation[k].T[None]
        )  # rows e_i x psi, of which -psi~ consists
        np.testing.assert_array_equal(found[f"{k + 1} AP"]["M1"].transpose(2, 1, 0), -turned)


def test_damping_is_that_of_the_model(scene_file: Path, body: NodalBody) -> None:
    full = build(scenes.load(scene_file, ["damping.mass=0.5", "damping.stiffness=1e-5"])).model.gather()
    expected = body.modes.T @ (full.D @ body.modes)  # nodes are in the order of the model's coordinates
    np.testing.assert_allclose(body.damping, expected, rtol=0.0, atol=1e-9 * expected.max())


def cross_sum(weight: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """int a x b of two fields (N, 3) with a mass matrix (N, N)."""
    table = a.T @ (weight @ b)
    return np.array([table[1, 2] - table[2, 1], table[2, 0] - table[0, 2], table[0, 1] - table[1, 0]])


def test_the_integrals_are_those_of_a_body_that_moves(body: NodalBody) -> None:
    """Forces of inertia of a moving and deforming body, node by node; J and Cr stop at the first power of q."""
    value, rng = inertia_integrals(body), np.random.default_rng(6)
    q, dq, ddq = 1e-9 * rng.normal(size=MODES), *rng.normal(size=(2, MODES))
    a, omega, alpha = rng.normal(size=(3, 3))
    phi, weight = body.modes.reshape(-1, 3, MODES), body.M[::3][:, ::3]
    r = body.points + phi @ q
    field = a + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r)) + 2.0 * np.cross(omega, phi @ dq) + phi @ ddq
    forces = np.asarray(weight @ field)

    def at(name: str) -> np.ndarray:
        one = value[name]
        return one.M0 if one.M1 is None else one.M0 + np.einsum("rqc,q->rc", one.M1, q)

    J = np.zeros((3, 3))
    for (i, j), entry in zip(INERTIA, at("J")[:, 0], strict=True):
        J[i, j] = J[j, i] = entry
    centre, Ct = at("mdCM")[:, 0], at("Ct")
    mass = float(weight.sum())
    moved = mass * a - np.cross(centre, alpha) + np.cross(omega, np.cross(omega, centre)) + Ct.T @ ddq
    np.testing.assert_allclose(forces.sum(axis=0), moved + 2.0 * np.cross(omega, Ct.T @ dq), rtol=1e-9)
    Gr = np.einsum("ikj,k->ij", value["Gr"].M0.reshape(3, MODES, 3), dq)
    turned = np.cross(centre, a) + J @ alpha + at("Cr").T @ ddq + Gr @ omega + np.cross(omega, J @ omega)
    np.testing.assert_allclose(cross_sum(weight, r, field), turned, rtol=1e-6)
    Ge = np.einsum("kla,l->ka", value["Ge"].M0.reshape(MODES, MODES, 3), dq)
    squares = np.array([omega[i] * omega[j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))])
    shaken = Ct @ a + at("Cr") @ alpha + at("Me") @ ddq + Ge @ omega + at("Oe") @ squares
    np.testing.assert_allclose(np.einsum("nik,ni->k", phi, forces), shaken, rtol=1e-6, atol=1e-9 * np.abs(shaken).max())
    np.testing.assert_allclose(at("J")[1, 0], mass * (2.0**2 / 3.0 + 0.3**2 / 12.0), rtol=1e-6)


def test_exudyn_reads_its_file_and_finds_the_frequencies(body: NodalBody, tmp_path: Path) -> None:
    import exudyn
    from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
    from exudyn.itemInterface import CoordinateConstraint, MarkerNodeCoordinate, NodePointGround

    fem = FEMinterface()
    fem.LoadFromFile(str(write_ffrf(body, tmp_path / "bar.npz")))
    for found, expected in (
        (fem.massMatrix.toarray(), body.M.toarray()),
        (fem.stiffnessMatrix.toarray(), body.K.toarray()),
        (fem.modeBasis["matrix"], body.modes),
        (fem.GetNodePositionsAsArray(), body.points),
    ):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(
        body.modes.T @ (body.K @ body.modes), np.diag(body.omega**2), atol=1e-7 * body.omega[-1] ** 2
    )
    flexible = ObjectFFRFreducedOrderInterface(fem)
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    items = flexible.AddObjectFFRFreducedOrder(mbs)
    ground = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    for k in range(7):  # position and Euler parameters of the reference frame
        held = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=items["nRigidBody"], coordinate=k))
        if k != 3:
            mbs.AddObject(CoordinateConstraint(markerNumbers=[ground, held]))
    mbs.Assemble()
    values = np.sort(mbs.ComputeODE2Eigenvalues(useAbsoluteValues=True)[0])
    np.testing.assert_allclose(np.sqrt(values[-MODES:]), body.omega, rtol=1e-6)


@pytest.mark.slow
def test_the_command_writes_either(scene_file: Path, tmp_path: Path, run_command) -> None:
    for to in ("sid", "ffrf"):
        target = tmp_path / f"{to}.file"
        options = ["--at", "0.85", "--to", to, "--modes", "3", "--out", str(target)]
        done = run_command("flexible", str(scene_file), *options)
        assert done.returncode == 0, done.stderr
        assert target.exists() and "3 modes" in done.stdout and ": tip, at 2, 0, 0 m" in done.stdout


REFUSED = [
    (["--at", "3"], "--at = 3.0: a place from 0.6 to 1.1 m"),
    (["--to", "adams"], "--to = 'adams': sid, ffrf, simscape is allowed"),
    (["--modes", "0"], "--modes = 0"),
    (["--modes", "100000"], "--modes = 100000: at most "),
    (["--set", "masses=[{name='m',on='tip',mass=1.0}]"], "masses = 'm': none is allowed"),
    (["--set", "pads.mouth.unilateral=true"], "only pushes"),
]


@pytest.mark.parametrize(("options", "says"), REFUSED, ids=[says for _, says in REFUSED])
def test_what_such_files_cannot_hold_is_refused(
    options: list[str], says: str, scene_file: Path, tmp_path: Path, run_command
) -> None:
    chosen = options if "--at" in options else ["--at", "0.85", *options]
    done = run_command("flexible", str(scene_file), *chosen, "--out", str(tmp_path / "body"))
    assert done.returncode == 2 and says in done.stderr and not (tmp_path / "body").exists()


def test_a_shell_has_no_nodes_of_three_displacements() -> None:
    from pmr.models.matrices import Matrices

    given = bricks((1, 1, 1), (1.0, 1.0, 1.0))
    np.testing.assert_array_equal(nodes_of(Matrices(given)).ravel(), np.arange(24))
    beam = scenes.load("workflows/boom_beam.toml", ["masses=[]", "recovery.stress=false"])
    with pytest.raises(InputError, match="a solid, or matrices"):
        held_body(beam, 2.0, 2)


S_SIMSCAPE, COUNT = 0.85, 8
BOOM = ["mesh.elements=12", "recovery.stress=false"]


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = on_pads(tmp_path_factory.mktemp("bar"))
    bricks((10, 1, 1), (2.0, 0.2, 0.3)).save(file.with_name("bar.npz"))
    return file


def written(file: Path, s: float, modes: int, folder: Path, capture: tuple, *overrides: str) -> dict[str, np.ndarray]:
    target, options = folder / "body.mat", [part for one in overrides for part in ("--set", one)]
    asked = ["--at", str(s), "--to", "simscape", "--modes", str(modes), "--out", str(target), *options]
    done = called(*capture, "flexible", str(file), *asked)
    assert done.returncode == 0, done.stderr
    assert "frame 1: ground, at 0, 0, 0 m" in done.stdout
    return scipy.io.loadmat(target)


def frequencies(said: dict[str, np.ndarray]) -> np.ndarray:
    """With the ground at rest."""
    return 1.0 / np.sqrt(scipy.linalg.eigh(said["M"][6:, 6:], said["K"][6:, 6:], eigvals_only=True)[::-1][:COUNT])


def modes_of(model: FullModel, s: float) -> Modes:
    return eigensolver(model, "dense").lowest(s, COUNT)


def test_with_all_modes_it_is_the_full_model(bar: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    """Frames and modes are then coordinates of the whole body: with the ground at rest its frequencies and damping."""
    damped = ["damping.mass=0.5", "damping.stiffness=1e-5"]
    full = build(scenes.load(bar, damped)).model
    rigid = int(np.sum(full.row_compliance == 0.0))
    said = written(bar, S_SIMSCAPE, full.size - rigid - 6, tmp_path, (monkeypatch, capsys), *damped)
    expected = modes_of(full, S_SIMSCAPE)
    np.testing.assert_allclose(frequencies(said), expected.omega, rtol=1e-6)
    theta, z = scipy.linalg.eigh(said["M"][6:, 6:], said["K"][6:, 6:])
    z = z[:, ::-1][:, :COUNT] / np.sqrt(theta[::-1][:COUNT])  # of modal mass 1 kg
    found = np.sum(z * (said["C"][6:, 6:] @ z), axis=0)
    np.testing.assert_allclose(found, np.sum(expected.phi * times(full.D, expected.phi), axis=0), rtol=1e-6)


def displaced(point: np.ndarray) -> np.ndarray:
    """Displacement (3, 6) of a point under unit translations and rotations about the origin."""
    return np.hstack([np.eye(3), np.cross(np.eye(3), point).T])


@pytest.mark.slow
@pytest.mark.parametrize("case", ["bar", "boom"])
def test_what_the_block_reads(case: str, bar: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    """Frequencies from above, the nearer the more modes; all frames as one move without force, with the whole mass."""
    file, s, overrides = (bar, S_SIMSCAPE, []) if case == "bar" else (Path("workflows/boom_beam.toml"), 2.0, BOOM)
    scene, capture = scenes.load(file, overrides), (monkeypatch, capsys)
    few, many = (written(file, s, modes, tmp_path, capture, *overrides) for modes in (4, 16))
    P, K, M, C = (many[name] for name in "PKMC")
    assert P.shape == (2, 3) and K.shape == M.shape == C.shape == (28, 28)
    assert [str(cell[0]) for cell in many["frames"].ravel()] == ["ground", "tip"]
    expected = modes_of(build(scene).model, s).omega
    off = [frequencies(one) / expected - 1.0 for one in (few, many)]
    assert np.all(off[1] > -1e-7) and np.all(off[0] > off[1] - 1e-7)
    assert off[1][:4].max() < 1e-4
    rigid = np.vstack([*(np.vstack([displaced(point), np.eye(6)[3:]]) for point in P), np.zeros((16, 6))])
    for A in (K, M, C):
        np.testing.assert_array_equal(A, A.T)
    size = np.sqrt(np.diag(np.abs(rigid).T @ np.abs(K) @ np.abs(rigid)))
    assert np.all(np.abs(rigid.T @ K @ rigid) <= 1e-9 * np.outer(size, size))
    assert np.linalg.eigvalsh(M[6:, 6:])[0] > 0.0  # of the whole zero, where a spring alone joins ground and frame
    inertia, total = rigid.T @ M @ rigid, 7850.0 * 2.0 * 0.2 * 0.3
    if case == "boom":
        box, density = scene.body.box, scene.body.material.density
        total = 2.0 * density * (box.width + box.height) * box.wall * box.length + sum(
            mass.mass for mass in scene.masses
        )
    np.testing.assert_allclose(inertia[:3, :3], total * np.eye(3), rtol=1e-9, atol=1e-9 * total)
    if case == "bar":
        given = bricks((10, 1, 1), (2.0, 0.2, 0.3))
        R = np.vstack([displaced(point) for point in given.points])
        np.testing.assert_allclose(inertia, R.T @ given.M @ R, rtol=1e-9, atol=1e-9 * total)


def test_a_force_at_the_tip_moves_it_as_the_full_model(bar: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    said = written(bar, S_SIMSCAPE, 1, tmp_path, (monkeypatch, capsys))
    found = np.linalg.solve(said["K"][6:, 6:], np.eye(7)[:, 2])[2]
    full = build(scenes.load(bar)).model.gather()
    C, compliance = full.rows.at(S_SIMSCAPE).toarray(), full.rows.compliance
    saddle = np.block([[full.K.toarray(), C.T], [C, -np.diag(compliance)]])
    load = np.concatenate([full.B[:, 0], np.zeros(len(C))])
    assert found == pytest.approx(load @ np.linalg.solve(saddle, load), rel=1e-9)


REFUSED_SIMSCAPE = [
    ("workflows/paper_simple.toml", [], "a body in space is allowed"),
    ("workflows/boom_beam.toml", ["supports=[{on='tip',points='all'}]"], "places that move, each by itself"),
    ("workflows/boom_beam.toml", ["supports=[]", "free_motions=allowed"],
     "pads and supports that hold the body at s in all directions"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "overrides", "says"), REFUSED_SIMSCAPE, ids=[says for *_, says in REFUSED_SIMSCAPE])
def test_what_has_no_frames_is_refused(file: str, overrides: list[str], says: str, tmp_path: Path, run_command) -> None:
    options = [part for one in overrides for part in ("--set", one)]
    asked = ["--at", "2", "--to", "simscape", "--out", str(tmp_path / "body.mat"), *options]
    done = run_command("flexible", file, *asked)
    assert done.returncode == 2 and says in done.stderr and len(done.stderr.splitlines()) == 1
