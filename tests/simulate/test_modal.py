"""Modal form: the decomposition, and what it makes of damping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from oracle import full_body, project

from pmr.body import FullBody
from pmr.errors import InputError
from pmr.simulate import modal
from pmr.simulate.modal import diagonalise, modal_form

EXTENDED = np.finfo(np.longdouble).eps < 1e-18


def test_modes_of_a_fine_beam_are_sharp_from_the_rigid_ones_to_the_highest(full: FullBody) -> None:
    M, K = full.M.toarray(), full.K.toarray()
    omega2, X = diagonalise(M, K)
    np.testing.assert_allclose(X.T @ M @ X, np.eye(len(M)), atol=1e-11)
    S = np.asarray(X.T.astype(np.longdouble) @ (K.astype(np.longdouble) @ X.astype(np.longdouble)), float)
    scale = np.sqrt(np.outer(omega2 + 100.0, omega2 + 100.0))
    coupling = np.abs(S - np.diag(omega2)) / scale
    assert coupling.max() < (1e-10 if EXTENDED else 1e-6)
    lapack = np.abs(scipy.linalg.eigh(K, M, eigvals_only=True))[:3].max()
    assert np.abs(omega2[:3]).max() < (1e-7 if EXTENDED else 1.0)
    assert np.abs(omega2[:3]).max() < lapack  # what the corrections are for
    assert np.all(np.diff(omega2) > -1e-8)


def test_a_multiple_eigenvalue_keeps_its_space() -> None:
    random = np.random.default_rng(0)
    Q = np.linalg.qr(random.standard_normal((6, 6)))[0]
    L = np.tril(random.standard_normal((6, 6))) + 4.0 * np.eye(6)
    expected = np.array([0.0, 0.0, 2.0, 2.0, 2.0, 1e6])
    omega2, X = diagonalise(L @ L.T, L @ Q @ np.diag(expected) @ Q.T @ L.T)
    np.testing.assert_allclose(omega2, expected, atol=1e-9)
    np.testing.assert_allclose(X.T @ (L @ L.T) @ X, np.eye(6), atol=1e-13)


def test_the_form_is_the_body(rich: FullBody) -> None:
    form = modal_form(rich)
    assert form.rows == (2, 3) and form.body.row_names == ("slider 0", "slider 0.8")
    z = np.random.default_rng(1).standard_normal(form.body.size)
    q = form.X @ z
    assert not q[:2].any()  # the pin
    np.testing.assert_allclose(form.inverse @ q, z, atol=1e-13)
    np.testing.assert_allclose(form.body.C(2.3) @ z, (rich.C(2.3) @ q)[2:], rtol=1e-12)
    np.testing.assert_allclose(form.body.outputs @ z, rich.outputs @ q, atol=1e-13)
    np.testing.assert_allclose(z @ form.body.D @ z, q @ (rich.D @ q), rtol=1e-12)
    np.testing.assert_allclose(form.body.B.T @ z, rich.B.T @ q, rtol=1e-12)


def test_rayleigh_and_modal_damping_stay_in_the_diagonal(rich: FullBody) -> None:
    assert modal_form(rich).classically_damped
    np.testing.assert_allclose(np.diagonal(modal_form(rich).body.D), 0.4 + 2e-4 * modal_form(rich).omega2)
    body = project(full_body(elements=8), np.eye(27)[:, 2:])
    omega2, X = diagonalise(body.M, body.K)
    ratios = np.linspace(0.01, 0.2, body.size)
    D = body.M @ X @ np.diag(2.0 * ratios * np.sqrt(np.abs(omega2))) @ X.T @ body.M
    form = modal_form(replace(body, D=D))
    assert form.classically_damped
    np.testing.assert_allclose(np.diagonal(form.body.D)[1:], 2.0 * ratios[1:] * np.sqrt(omega2[1:]), rtol=1e-8)


def test_a_damper_at_one_point_couples_modes_however_stiff_the_beam(full: FullBody) -> None:
    D = 1e-6 * full.K.toarray()
    D[-2, -2] += 1.0
    assert not modal_form(replace(full, D=type(full.D)(D))).classically_damped


def test_what_cannot_be_diagonalised_is_refused(rich: FullBody, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="body: M: a mass matrix that is positive definite"):
        modal_form(replace(rich, M=-rich.M))
    monkeypatch.setattr(modal, "LARGEST", 20)
    with pytest.raises(InputError, match="21 coordinates, up to 20 are diagonalised"):
        modal_form(rich)


@pytest.mark.parametrize(("share", "classical"), [(1e-9, True), (1e-6, False)])
def test_what_round_off_leaves_of_modes_is_no_coupling(share: float, classical: bool) -> None:
    """Modes of a solid of 20,000 coordinates leave 6e-10."""
    body = project(full_body(elements=8), np.eye(27)[:, 2:])
    omega2, X = diagonalise(body.M, body.K)
    damping = 1.0 + 1e-4 * omega2
    coupling = share * np.sqrt(np.outer(damping, damping))
    back = np.linalg.inv(X)
    damped = replace(body, D=back.T @ (np.diag(damping) + coupling) @ back)
    assert modal_form(damped).classically_damped is classical
