r"""Flexible bodies for other programs: Exudyn's FEMinterface, Simscape Multibody, Standard Input Data.

Standard Input Data (SID) is text that SIMPACK, Modelica libraries and others read.  With the modes :math:`\varphi_k` as
the columns of :math:`\varphi`, modal coordinates :math:`q_k`, positions x of points before and :math:`r = x + \varphi_k
q_k` after deformation, the angular velocity :math:`\omega`, the mass m and its centre c, and all integrals over the
mass, it has

.. math::
    m c = \int x + \varphi_k q_k, \quad J = -\int \tilde r \tilde r, \quad C_t = \int \varphi^T, \quad
    C_r = \int (r \times \varphi)^T, \quad M_e = \int \varphi^T \varphi

.. math::
    G_{r,k} = -2 \int \tilde x \tilde\varphi_k, \quad G_{e,k} = 2 \int (\varphi_k \times \varphi)^T, \quad
    O_e \Omega = \int \varphi^T \tilde\omega \tilde\omega\, r, \quad
    \Omega = (\omega_x^2, \omega_y^2, \omega_z^2, \omega_x \omega_y, \omega_y \omega_z, \omega_x \omega_z)

A tilde makes a vector the matrix of its cross product; J is listed as xx, yy, zz, xy, xz, yz.  The integrals follow
from the mass matrix of the nodes without lumping of masses.  Geometric stiffness is not included (ksigma = 0).
Wallrapp: Standardization of flexible body modeling in multibody system codes, Mechanics of Structures and Machines 22,
1994, pp. 283-304; Schwertassek, Wallrapp: Dynamik flexibler Mehrkoerpersysteme, 1999, section 6.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

from pmr.errors import InputError, environment
from pmr.files.arrays import Array
from pmr.files.whole import replacement_file, write_text
from pmr.results.field_series import FramedBody, NodalBody


def write_ffrf(body: NodalBody, target: Path) -> Path:
    """Write a body as data of Exudyn's ObjectFFRFreducedOrder, with Exudyn's writer, and return the file's path.

    Raises InputError if Exudyn is not installed.
    """
    environment.import_package("exudyn")
    from exudyn.FEM import FEMinterface

    fem = FEMinterface()
    fem.nodes = {"Position": body.points}
    fem.massMatrix, fem.stiffnessMatrix = body.M, body.K
    fem.modeBasis = {"matrix": body.modes, "type": "NormalModes"}
    fem.eigenValues = body.omega**2
    fem.metaData = {"sliders at s in m": body.s}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacement_file(target) as part:
        named = part.with_name(f"{part.name}.npz")  # Exudyn's writer adds this suffix
        fem.SaveToFile(str(named))
        named.replace(part)
    return target


def write_simscape(body: FramedBody, target: Path) -> Path:
    """Write a body as data of Simscape's block Reduced Order Flexible Solid, and return the file's path.

    The data are the origins P (F, 3) of F frames, and the matrices K, M and C.  The rows and columns of the matrices
    are x, y, z, rx, ry, rz of each frame, then the modes.
    """
    names = np.array(body.frames.names, dtype=object)
    content = {"P": body.frames.points, "K": body.K, "M": body.M, "C": body.C, "frames": names, "s": body.s}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacement_file(target) as part, part.open("wb") as stream:
        scipy.io.savemat(stream, content)
    return target


_DIAGONAL, _FULL = 1, 3
#: Pairs of axes, in the order of the entries of J and of the products of angular velocities in O_e.
INERTIA = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
#: The two axes that follow each axis.
_NEXT = ((1, 2), (2, 0), (0, 1))
#: Share of the largest entry by which the masses of a node along x, y and z may differ.
ALIKE = 1e-9


@dataclass(frozen=True)
class Taylor:
    """A matrix that is linear in the m modal coordinates q: M0 + sum_k M1[:, k] q_k.

    M0 is (r, c); M1 is (r, m, c), or None if the matrix is constant.  `structure` is the number by which the format
    denotes the structure of the matrix.
    """

    M0: Array
    M1: Array | None = None
    structure: int = _FULL


def inertia_integrals(body: NodalBody) -> Mapping[str, Taylor]:
    """Inertia integrals by the equations of the module, by their names in the format, in the order of its files.

    Raises InputError if a node's mass differs along x, y and z: no field of displacements has such a mass matrix.
    """
    scalar = sp.csr_matrix(body.M[::3][:, ::3])
    if abs(body.M - sp.kron(scalar, sp.eye(3))).max() > ALIKE * abs(scalar).max():
        raise InputError("scene", "mesh.file", None, "masses that are the same along x, y and z are allowed")
    x, phi = body.points, body.modes.reshape(len(body.points), 3, -1)
    m = phi.shape[2]
    unit, of_x = np.asarray(scalar.sum(axis=0)).ravel(), np.asarray(scalar @ x)
    of_phi = np.asarray(scalar @ phi.reshape(len(x), -1)).reshape(phi.shape)
    xx, xp = of_x.T @ x, np.einsum("ni,njk->ijk", of_x, phi)
    pp = np.einsum("nik,njl->ijkl", phi, of_phi)
    Ct = np.einsum("n,nik->ki", unit, phi)
    eye = np.eye(3)[:, :, None]
    trace = np.einsum("iik->k", xp)
    J0 = np.trace(xx) * np.eye(3) - xx
    J1 = 2.0 * trace * eye - xp - xp.swapaxes(0, 1)
    Gr = 2.0 * (trace * eye - xp.swapaxes(0, 1))
    Cr0 = np.stack([xp[b, c] - xp[c, b] for b, c in _NEXT], axis=1)
    Cr1 = np.stack([pp[b, c].T - pp[c, b].T for b, c in _NEXT], axis=2)
    return {
        "mdCM": Taylor((unit @ x)[:, None], Ct.T[:, :, None]),
        "J": Taylor(*(np.stack([J[a, b] for a, b in INERTIA])[..., None] for J in (J0, J1))),
        "Ct": Taylor(Ct),
        "Cr": Taylor(Cr0, Cr1),
        "Me": Taylor(np.einsum("iikl->kl", pp)),
        "Gr": Taylor(Gr.transpose(0, 2, 1).reshape(3, 3 * m)),
        "Ge": Taylor(2.0 * Cr1.reshape(m, 3 * m)),
        "Oe": Taylor(_centrifugal(xp), _centrifugal(pp)),
        "ksigma": Taylor(np.zeros((m, 1))),
        "Ke": Taylor(np.diag(body.omega**2), structure=_DIAGONAL),
        "De": Taylor(body.damping),
    }


def write_sid(body: NodalBody, target: Path) -> Path:
    """Write a body as Standard Input Data, with 17 digits, and return the file's path.

    The nodes of the file are the points of the body's loads and outputs.  Raises InputError as `inertia_integrals`.
    """
    write_text(target, "\n".join([*_sid_lines(body), ""]))
    return target


def _centrifugal(of: Array) -> Array:
    """Coefficients (m, 6) of the integral of phi . omega x (omega x r), by the six products Omega of the module.

    `of` (3, 3, m) are the integrals of the products of each component of r = x with each component of phi, for m modes.
    If r is the part of the position that is linear in the modes, `of` is (3, 3, m, m).  Its third axis is the mode of
    r, its fourth axis the mode of phi, and the coefficients are (m, m, 6).
    """
    trace = np.einsum("ii...->...", of)
    squares = [of[a, a] - trace for a, b in PRODUCTS[:3]]
    return np.stack([*squares, *(of[a, b] + of[b, a] for a, b in PRODUCTS[3:])], axis=-1)


def _sid_lines(body: NodalBody) -> Iterator[str]:
    """Yield the lines of a body's file of Standard Input Data: sizes and frequencies, nodes, inertia integrals."""
    m, places = len(body.omega), body.frames
    yield f"{len(places.names):5d}{m:5d}    :No. nodes, No. modes: sliders at s = {body.s!r} m, SI units"
    yield " part"
    yield _entry_line(6, "new modal", "")
    yield f"{'':11}refmod"
    yield _entry_line(16, "mass", _number(float(body.M[::3][:, ::3].sum())))
    yield _entry_line(16, "nelastq", f"{m:6d}")
    for k, omega in enumerate(body.omega, start=1):
        yield _entry_line(16, f"ielastq ({k:4d})", f" Eigen Mode {k:4d} : {omega / (2.0 * np.pi):12.6g} Hz")
    yield f"{'':11}end refmod"
    yield f"{'':11}frame"
    for k in range(len(places.names)):
        yield from _node_lines(k + 1, places.points[k], places.displacement[k], places.rotation[k])
    yield f"{'':11}end frame"
    for name, value in inertia_integrals(body).items():
        yield from _taylor_lines(11, name, value, m)
    yield f"{'':6}end modal"
    yield " end part"


def _node_lines(number: int, point: Array, translation: Array, turned: Array) -> Iterator[str]:
    """Yield the lines of node `number` at `point` (3,), with its modal displacements and rotations, each (3, m).

    `translation` are the displacements per unit of m modes, and `turned` the rotations.
    """
    m, skew = translation.shape[1], np.zeros((3, translation.shape[1], 3))
    for a, (b, c) in enumerate(_NEXT):
        skew[c, :, b], skew[b, :, c] = turned[a], -turned[a]
    yield _entry_line(16, "new node", f"{number:8d}")
    yield _entry_line(21, "rframe", " body ref")
    yield from _taylor_lines(21, "origin", Taylor(point[:, None], translation[:, :, None]), m)
    yield from _taylor_lines(21, "phi", Taylor(translation), m)
    yield from _taylor_lines(21, "psi", Taylor(turned), m)
    yield from _taylor_lines(21, "AP", Taylor(np.eye(3), skew), m)
    yield f"{'':16}end node"


def _taylor_lines(indent: int, name: str, value: Taylor, m: int) -> Iterator[str]:
    """Yield the lines of a matrix called `name`, of a body with m modes, after `indent` blanks; zeros are left out."""
    yield f"{'':{indent}}{name}"
    sizes = {"order": int(value.M1 is not None), "nrow": len(value.M0), "ncol": value.M0.shape[1], "nq": m, "nqn": 0}
    structure = value.structure if np.any(value.M0) or value.M1 is not None else 0
    for key, size in (sizes | {"structure": structure}).items():
        yield _entry_line(26, key, f"{size:6d}")
    for i, j in np.argwhere(value.M0):
        yield _entry_line(26, f"m0({i + 1:2d},{j + 1:2d})", _number(value.M0[i, j]))
    if value.M1 is not None:
        for j, k, i in np.argwhere(value.M1.transpose(2, 1, 0)):
            yield _entry_line(26, f"m1({i + 1:2d},{k + 1:2d},{j + 1:2d})", _number(value.M1[i, k, j]))
    yield f"{'':{indent}}end {name}"


def _entry_line(indent: int, key: str, value: str) -> str:
    """Line with `indent` blanks, a key, and its value, which begins in a fixed column."""
    return f"{'':{indent}}{key:<{48 - indent}}={value}"


def _number(x: float) -> str:
    """Text of the number x in Fortran's notation, with all 17 digits; its mantissa has 19 characters."""
    return f"{x: .16E}".replace("E", "D")
