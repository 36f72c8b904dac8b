"""Files of Nastran read by pyNastran: OUTPUT4 has all digits, and so has the sum of both parts of DMIG entries."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import flexible, rich_body
from processes import called

from pmr import ReducedModel, System
from pmr.export.state_space import FIELD, _field, state_space

op4 = pytest.importorskip("pyNastran.op4.op4", reason="pyNastran is not installed")
bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
S = np.array([1.7, 2.9])


def written(model: ReducedModel, to: str, folder: Path, *capture: pytest.MonkeyPatch) -> Path:
    npz, target = model.save(folder / "reduced.npz"), folder / f"beam.{to}"
    done = called(*capture, "export", str(npz), "--to", to, "--at", "1.7,2.9", "--out", str(target))
    assert done.returncode == 0, done.stderr
    return target


def matrices(model: ReducedModel) -> dict[tuple[str, str], np.ndarray]:
    space = state_space(System.of(model), {"slider": S}, "model")
    found = {("M", ""): np.eye(6), ("D", ""): -space.A[0, 6:, 6:]}
    for k in range(2):
        K = -space.A[k, 6:, :6]
        found |= {("K", str(k + 1)): (K + K.T) / 2.0, ("F", str(k + 1)): space.B[k, 6:]}
    return found


@pytest.fixture(params=[False, True])
def model(request: pytest.FixtureRequest) -> ReducedModel:
    """Its damping couples modes, or does not."""
    model = flexible(rich_body(), 6)
    if request.param:
        model = replace(model, D=model.M @ (np.diag(np.arange(1.0, 7.0)) + 0.5) @ model.M, rayleigh=None)
    return model


def test_pynastran_reads_the_entries(model: ReducedModel, tmp_path: Path, monkeypatch, capsys) -> None:
    target = written(model, "dmig", tmp_path, monkeypatch, capsys)
    deck = bdf.BDF(debug=None)
    deck.read_bdf(str(target), xref=False, punch=True)
    assert sorted(deck.spoints) == list(range(1, 7))

    def whole(letter: str, number: str) -> np.ndarray:
        high, low = (deck.dmig[f"{letter}{part}{number}"].get_matrix(is_sparse=False)[0] for part in ("", "L"))
        return high + low

    for (letter, number), A in matrices(model).items():
        np.testing.assert_allclose(whole(letter, number), A, rtol=1e-12, atol=1e-14 * np.abs(A).max())


def test_pynastran_reads_output4_bit_for_bit(model: ReducedModel, tmp_path: Path, monkeypatch, capsys) -> None:
    found = op4.read_op4(str(written(model, "op4", tmp_path, monkeypatch, capsys)), debug=None)
    expected = matrices(model)
    assert sorted(found) == sorted(letter + number for letter, number in expected)
    for (letter, number), A in expected.items():
        np.testing.assert_array_equal(found[letter + number].data, A)
        assert found[letter + number].form == (2 if letter == "F" else 6 if np.array_equal(A, A.T) else 1)


@pytest.mark.parametrize("x", [0.0, 1.0, -1.0 / 3.0, -2.2250738585072014e-308, 1.7e308, 123456789012.0])
def test_a_number_fits_its_field(x: float) -> None:
    text = _field(x)
    assert len(text) <= FIELD and "D" in text
    assert float(text.replace("D", "e")) == pytest.approx(x, rel=1e-8)
