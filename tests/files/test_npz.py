"""Files whose directory, headers or shapes claim what is not there.
What files hold of dataclasses, and files that earlier versions wrote.
"""

import io
import struct
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from numpy.typing import NDArray
from oracle import flexible, rich_body
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel
from pmr.cli.info import describe_model
from pmr.files.foreign import ForeignFiles, read_foreign
from pmr.files.npz import DamagedError, read, record_arrays, record_from_arrays
from pmr.results import Fields
from pmr.simulation.petsc.simulator import read_checkpoint
from pmr.studies.study import Store

ARRAYS = {
    "M": np.arange(12.0).reshape(3, 4), "turned": np.asfortranarray(np.arange(6).reshape(2, 3)),
    "single": np.float32([1.5, 2.5]), "big_endian": np.arange(3, dtype=">f8"), "flag": np.array(True),
    "empty": np.empty((0, 5)), "text": np.array('{"a": "ä"}'), "names": np.array(["a", "bc"]),
}  # fmt: skip
GIGABYTES = 2 * 10**9


def npy(shape: object, descr: str = "<f8", content: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    """An array's bytes with a header that says what it likes."""
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape!r}, }}\n".encode("latin1")
    return b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header + content


def archive(file: Path, members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(file, "w", compression) as written:
        for name, content in members.items():
            written.writestr(f"{name}.npy", content)
    return file


def lying_directory(file: Path) -> Path:
    """The central directory claims a member of two gigabytes."""
    content = bytearray(archive(file, {"M": npy((GIGABYTES // 8,), content=bytes(80))}).read_bytes())
    at = content.rindex(b"PK\x01\x02")
    content[at + 24 : at + 28] = struct.pack("<I", GIGABYTES)
    file.write_bytes(content)
    return file


def shared_content(file: Path) -> Path:
    """Every entry of the directory points to the same bytes."""
    content = archive(file, {"M": npy((10_000,), content=bytes(80_000))}).read_bytes()
    at = content.rindex(b"PK\x01\x02")
    end = content.rindex(b"PK\x05\x06")
    entry = bytearray(content[at:end])
    entries = []
    for number in range(500):
        named = bytearray(entry)
        named[28:30] = struct.pack("<H", 8)
        entries.append(bytes(named[:46]) + f"{number:04}.npy".encode() + bytes(named[46 + 5 :]))
    directory = b"".join(entries)
    tail = bytearray(content[end:])
    tail[8:12] = struct.pack("<HH", 500, 500)
    tail[12:16] = struct.pack("<I", len(directory))
    file.write_bytes(content[:at] + directory + tail)
    return file


LIES: dict[str, Callable[[Path], Path]] = {
    "shape": lambda file: archive(file, {"M": npy((GIGABYTES // 8,), content=bytes(80))}),
    "a product that overflows": lambda file: archive(file, {"M": npy((2**40, 2**40), content=bytes(80))}),
    "a negative length": lambda file: archive(file, {"M": npy((-1, 10), content=bytes(80))}),
    "too short": lambda file: archive(file, {"M": npy((11,), content=bytes(80))}),
    "too long": lambda file: archive(file, {"M": npy((9,), content=bytes(80))}),
    "a pickle": lambda file: archive(file, {"M": npy((1,), "|O", b"\x80\x04N.")}),
    "a record": lambda file: archive(file, {"M": npy((1,), "|V8", bytes(8))}),
    "text of no size": lambda file: archive(file, {"M": npy((10**9,), "<U0")}),
    "no array": lambda file: archive(file, {"M": b"hello"}),
    "a version of the future": lambda file: archive(file, {"M": npy((1,), content=bytes(8), version=b"\x09\x00")}),
    "deep brackets": lambda file: archive(file, {"M": npy((1,), "(" * 9000, bytes(8))}),
    "compressed": lambda file: archive(file, {"M": npy((2**21,), content=bytes(2**24))}, zipfile.ZIP_DEFLATED),
    "directory": lying_directory,
    "shared content": shared_content,
    "two of one name": lambda file: _twice(file),
    "no zip": lambda file: (file.write_bytes(b"hello"), file)[1],
    "nothing": lambda file: (file.write_bytes(b""), file)[1],
}


def _twice(file: Path) -> Path:
    with zipfile.ZipFile(file, "w") as written, pytest.warns(UserWarning, match="Duplicate"):
        for _ in range(2):
            written.writestr("M.npy", npy((1,), content=bytes(8)))
    return file


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_what_numpy_wrote_is_read(write: Callable[..., None], tmp_path: Path) -> None:
    write(tmp_path / "a.npz", **ARRAYS)
    found = read(tmp_path / "a.npz", expansion=10.0)
    assert set(found) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert np.array_equal(found[name], array) and found[name].dtype == array.dtype, name
        assert found[name].shape == array.shape and found[name].flags.writeable


@pytest.mark.parametrize("lie", LIES)
def test_a_lie_is_refused_before_anything_is_allocated(lie: str, tmp_path: Path, monkeypatch) -> None:
    file = LIES[lie](tmp_path / "a.npz")
    asked, empty = [], np.empty

    def counted(shape: object, *more: object) -> np.ndarray:
        asked.append(empty(0, *more).itemsize * int(np.prod(shape)))
        return empty(shape, *more)

    monkeypatch.setattr(np, "empty", counted)
    with pytest.raises(DamagedError):
        read(file)
    assert sum(asked) <= file.stat().st_size


def test_what_is_all_zeros_may_be_compressed_to_almost_nothing_where_room_is_given(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(10**6))
    assert not read(tmp_path / "a.npz", expansion=100.0, room=2**24)["a"].any()
    with pytest.raises(DamagedError, match="claims to hold"):
        read(tmp_path / "a.npz", expansion=100.0)


def test_a_flipped_byte_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **ARRAYS)
    content = (tmp_path / "a.npz").read_bytes()
    at = content.index(np.arange(12.0).tobytes()) + 11
    (tmp_path / "a.npz").write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    with pytest.raises(DamagedError, match="CRC"):
        read(tmp_path / "a.npz")


def test_a_pickle_is_never_loaded(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.array([object]), allow_pickle=True)
    archive(tmp_path / "a.npz", {"M": buffer.getvalue()})
    with pytest.raises(DamagedError, match="Object arrays cannot be loaded"):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "said", ["1", "[]", '{"scene": 1, "versions": 2, "basis": [1], "scene_hash": {}}', '{"a":' * 10**5]
)
def test_a_model_that_was_forged_is_described_or_refused(said: str, tmp_path: Path) -> None:
    with np.load(flexible(rich_body(), 6).save(tmp_path / "model.npz")) as data:
        np.savez(tmp_path / "forged.npz", **(dict(data) | {"provenance": np.array(said)}))
    try:
        assert describe_model(ReducedModel.load(tmp_path / "forged.npz"))["made with"] == ""
    except InputError as error:
        assert "not a reduced model written by pmr" in str(error) and len(str(error)) < 500


@pytest.mark.parametrize("kind", [1.0, 7, True, np.array([object()])])
def test_a_matrix_of_a_format_that_is_none_is_refused(kind: object, tmp_path: Path) -> None:
    for name in ("K", "M"):
        scipy.sparse.save_npz(tmp_path / f"{name}.npz", scipy.sparse.identity(6, format="csr"))
    with np.load(tmp_path / "K.npz") as data:
        np.savez(tmp_path / "K.npz", **(dict(data) | {"format": np.array(kind)}))
    with pytest.raises(InputError, match=r"K.npz: a readable .npz file is allowed"):
        read_foreign(ForeignFiles(*(tmp_path / name for name in ("K.npz", "M.npz", "dofs.csv", "nodes.csv"))))


EARLIER = Path(__file__).parent / "earlier"  # written by the last commit that named arrays otherwise


@dataclass(frozen=True)
class Part:
    table: PPoly
    scale: float = 1.0


@dataclass(frozen=True)
class Whole:
    M: NDArray[np.float64]
    few: NDArray[np.float32]
    names: tuple[str, ...]
    part: Part
    groups: Mapping[str, NDArray[np.int64]]
    notes: dict[str, Any] = field(default_factory=dict)
    count: int = 0
    kept: bool = False
    other: Part | None = None
    pads: NDArray[np.float64] | None = None


def whole(**change: Any) -> Whole:
    table = PPoly(np.arange(12.0).reshape(2, 2, 3), [0.0, 1.0, 4.0])
    values = {"M": np.eye(2), "few": np.float32([1.5]), "names": ("a", "\u00e4 b"), "part": Part(table, 2.5)}
    return Whole(**(values | {"groups": {"left": np.array([1, 2])}, "notes": {"x": [1, None]}, "count": 3} | change))


@pytest.mark.parametrize("change", [{}, {"names": (), "groups": {}}, {"other": whole().part, "pads": np.ones(2)}])
def test_a_dataclass_is_its_arrays(change: dict) -> None:
    expected = whole(**change)
    named = record_arrays(expected, "a.")
    found = record_from_arrays(Whole, {"b.M": np.zeros(3), **named}, "a.")
    assert record_arrays(found, "a.").keys() == named.keys()
    for name, array in record_arrays(found, "a.").items():
        assert np.array_equal(array, named[name]) and array.dtype == named[name].dtype, name
    for name in ("names", "notes", "count", "kept"):
        assert getattr(found, name) == getattr(expected, name)
    assert (found.other is None) == (expected.other is None) and found.part.scale == 2.5


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"M": None}, KeyError), ({"part.table.breaks": None}, KeyError), ({"part.scale": np.ones(2)}, ValueError),
        ({"names": np.array("ab")}, TypeError), ({"names": np.ones(2)}, TypeError),
        ({"notes": np.array("[]")}, TypeError), ({"M": np.array(["soft"])}, ValueError),
    ],
)  # fmt: skip
def test_what_is_missing_or_of_another_type_is_refused(change: dict, error: type[Exception]) -> None:
    named = {name: array for name, array in (record_arrays(whole()) | change).items() if array is not None}
    with pytest.raises(error):
        record_from_arrays(Whole, named)


def test_a_reduced_model_of_version_4_is_read(tmp_path: Path) -> None:
    with np.load(EARLIER / "reduced.npz") as data:
        np.savez(tmp_path / "kept.npz", **{name: data[name] for name in data} | {"inertia.kept": np.asarray(True)})
    with pytest.raises(InputError, match="more coordinates have the same effect"):  # which kept its residual inertia
        ReducedModel.load(tmp_path / "kept.npz")
    model = ReducedModel.load(EARLIER / "reduced.npz")
    assert (model.input_names, model.row_names, model.left_out) == (("force",), ("slider",), ("support",))
    assert (model.output_names, model.output_units) == (("middle", "tip"), ("m", "m"))
    assert model.provenance == {"scene_hash": "abc"} and np.array_equal(model.K, np.diag([1.0, 4.0]))
    assert model.pads == [1e-6] and model.clearance == [2e-3] and model.rayleigh and model.rayleigh.alpha == 0.1
    assert np.array_equal(model.rows.c, np.arange(8.0).reshape(2, 2, 1, 2)) and model.domain == (0.0, 2.5)
    assert model.flexibility and model.enrichment is None  # its modes would need carriers
    assert np.array_equal(model.flexibility.inputs.c[:, :, 0, 0], [[3.0, 4.0], [5.0, 6.0]])


def test_fields_of_version_1_are_read_and_checkpoints_refused() -> None:
    fields = Fields.load(EARLIER / "fields.npz")
    assert fields.grid.region_names(0) == "left" and fields.kind == "line" and fields.displacement.dtype == np.float32
    assert np.array_equal(fields.von_mises["top"], [[1.0], [2.0]]) and fields.displacement[1, 1, 2] == 11.0
    with pytest.raises(InputError, match="checkpoint.npz: a checkpoint is allowed, this is none"):
        read_checkpoint(EARLIER / "checkpoint.npz", {"n": 2, "norms": [1.0, 2.0]})
    assert not Store(EARLIER).is_sound("abc")  # results of tasks are computed anew by another version
