"""DMIG entries read by pyNastran: the sum of both parts has all digits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import flexible, rich_body
from processes import called

from pmr.export.nastran import FIELD, _field
from pmr.simulate.state_space import state_space

bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
S = np.array([1.7, 2.9])


@pytest.mark.parametrize("couples", [False, True])
def test_pynastran_reads_the_matrices(couples: bool, tmp_path: Path, monkeypatch, capsys) -> None:
    model = flexible(rich_body(), 6)
    if couples:
        model = replace(model, D=model.M @ (np.diag(np.arange(1.0, 7.0)) + 0.5) @ model.M, rayleigh=None)
    npz, target = model.save(tmp_path / "reduced.npz"), tmp_path / "beam.bdf"
    done = called(monkeypatch, capsys, "export", str(npz), "--to", "dmig", "--at", "1.7,2.9", "--out", str(target))
    assert done.returncode == 0, done.stderr
    deck = bdf.BDF(debug=None)
    deck.read_bdf(str(target), xref=False, punch=True)
    assert sorted(deck.spoints) == list(range(1, 7))

    def whole(letter: str, number: str) -> np.ndarray:
        high, low = (deck.dmig[f"{letter}{part}{number}"].get_matrix(is_sparse=False)[0] for part in ("", "L"))
        return high + low

    space = state_space(model, S, "model")
    expected = {("M", ""): np.eye(6), ("D", ""): -space.A[0, 6:, 6:]}
    for k in range(2):
        expected |= {("K", str(k + 1)): -space.A[k, 6:, :6], ("F", str(k + 1)): space.B[k, 6:]}
    for (letter, number), A in expected.items():
        np.testing.assert_allclose(whole(letter, number), A, rtol=1e-12, atol=1e-14 * np.abs(A).max())


@pytest.mark.parametrize("x", [0.0, 1.0, -1.0 / 3.0, -2.2250738585072014e-308, 1.7e308, 123456789012.0])
def test_a_number_fits_its_field(x: float) -> None:
    text = _field(x)
    assert len(text) <= FIELD and "D" in text
    assert float(text.replace("D", "e")) == pytest.approx(x, rel=1e-8)
