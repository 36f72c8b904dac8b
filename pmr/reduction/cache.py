"""Reduced bodies, and a folder in which each is stored under a digest of everything that it is computed from.

The cache has results that follow from a full model and take longer than building the model.  The name of a file is a
digest of everything that decides its content: operators, inputs, outputs, rows, the request and the code.  So scenes
use the same file if they differ only in the signals of loads or in the motion along the same path.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, NotHeldError, environment
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import tall
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.files.whole import NotWrittenError
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis
from pmr.reduction.snapshots import Snapshots
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.members import members
from pmr.system.attachment import simulated_model
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System

Content = TypeVar("Content")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ReducedBody:
    """Reduced model of a body, with its basis and the snapshots from which the basis is made; same on every rank."""

    snapshots: Snapshots
    basis: Basis
    modal: ReducedModel  # with tables over one path, or on free modes with carriers
    stressed: bool = False  # whether terms that vary in time act on it

    @property
    def V(self) -> NDArray[np.float64]:
        """Basis V (n_local, k) of k vectors: this rank's part of the n coordinates."""
        return np.array(self.basis.V.getDenseArray())

    @property
    def has_error_estimate(self) -> bool:
        """Whether errors can be estimated with `modal`, that is, whether its carriers have residual inertia."""
        return self.modal.carriers is not None and self.modal.carriers.inertia is not None

    @cached_property
    def model(self) -> ReducedModel:
        """Model that is simulated: `modal` with cylinder modes and, for a stressed body, with modes without inertia."""
        return simulated_model(self.modal, self.stressed)


#: Keys of a scene that do not change any reduced model.
IRRELEVANT_KEYS = ("title", "start", "time", "recovery", "simulation", "compare", "accuracy", "budget", "published")


def model_digest(model: FullModel) -> str:
    """Digest of all data of a full model and of the code of pmr that computes; the same on every rank; collective.

    The digest also depends on the number of ranks.
    """
    digest = hashlib.blake2b(digest_size=16)
    matrices = [model.M, model.K, model.B, model.outputs, *model.matrices.values()]
    for A in matrices if model.rayleigh is not None else [*matrices, model.D]:
        for part in A.getValuesCSR():
            digest.update(part.tobytes())
    for row in model.rows.rows:
        U = row.carriers
        indices = U.indptr.astype(np.int64), U.indices.astype(np.int64)  # in 64 bits on every machine
        for part in (row.breaks, row.coefficients, row.touched, *indices, U.data):
            digest.update(part.tobytes())
        digest.update(repr((row.name, row.compliance, row.clearance)).encode())
    for name, row in model.ports.items():
        digest.update(repr((name, row.indices.tolist(), row.data.tolist())).encode())
    if model.rigid is not None:
        for part in (model.rigid.coordinates, model.rigid.held_measures, model.output_positions):
            digest.update(part.tobytes())
    names = (model.input_names, model.output_names, model.output_units, tuple(model.matrices))
    digest.update(repr((names, model.rayleigh, model.reference_frequency, environment.computing_digest())).encode())
    return hashlib.blake2b(repr(model.comm.allgather(digest.hexdigest())).encode(), digest_size=16).hexdigest()


class SystemFiles(NamedTuple):
    """Paths of two files about the reduced system of a scene; either file may be missing.

    If the file `stored` exists, the system is stored.  If the file `refusal` exists, supports and pads leave the scene
    free to move; the file says how.
    """

    stored: Path
    refusal: Path


@dataclass(frozen=True)
class SystemCache:
    """Folder that stores reduced systems of scenes with the same full model, and arrays about these scenes."""

    folder: Path
    content: str  # digest of the scene's full model, see `model_digest`
    comm: MPI.Comm

    def system_of(self, scene: Scene, make: Callable[[], System]) -> System:
        """Return the reduced system of a scene, from the cache or, if it is not there, made by `make` and stored.

        Collective: the system is the same on every rank.  `make` may raise a NotHeldError: supports and pads leave the
        scene free to move.  This error is stored too, and raised again at the next call without a call of `make`.
        """
        file, unheld = self._system_files(scene)
        if (not_held := self._read(unheld)) is not None:
            raise NotHeldError("scene", "free_motions", scene.free_motions, *map(str, not_held["said"]))
        system = None if self._read(file) is None else self._load(System.load, file)
        if system is None:
            try:
                system = make()
            except NotHeldError as error:
                self._write(unheld, {"said": np.array([error.allowed, error.short])})
                raise
            self._write(file, {}, system)
        return system

    def arrays(self, kind: str, request: Mapping[str, object], make: Callable[[], Array]) -> Array:
        """Return the array (any shape) of a `kind` for a `request`, from the cache or made by `make`; collective.

        `kind` is the first word of the file's name.  `request` holds all that the array depends on beside the full
        model.  If the array is not stored, `make` is called on all ranks, and the result is stored.  A stored array is
        the same on all ranks.
        """
        file = self._file(kind, request)
        stored = self._read(file)
        if stored is not None:
            return np.asarray(stored["array"], float)
        array = make()
        self._write(file, {"array": array})
        return array

    def has_system(self, scene: Scene) -> bool:
        """Whether the folder has a file for the system of this scene, or for the refusal to reduce the scene.

        The file may be damaged.
        """
        return any(file.is_file() for file in self._system_files(scene))

    def _system_files(self, scene: Scene) -> SystemFiles:
        """Paths of the files of a scene's system."""
        # joints are part of the structure, but the end of the simulated time decides how far pads get
        path = scene.travel if ALONE in scene.bodies else [member.pad_positions for member in members(scene)]
        files = [sorted(part.file_digests.items()) for part in scene.sections]
        # paths and signals of loads change no reduced model
        exclude: dict[str, Any] = dict.fromkeys(IRRELEVANT_KEYS, True)
        exclude |= {"sections": {"__all__": {"slider": {"path"}, "loads": {"__all__": {"signal"}}}}}
        request = {"scene": scene.model_dump_json(exclude=exclude), "path": path, "files": files}
        return SystemFiles(self._file("system", request), self._file("unheld", request | {"end": scene.time.end}))

    def _file(self, kind: str, request: Mapping[str, object]) -> Path:
        """Path of the file that stores the content of a `kind` for a `request`.

        The request holds all that the content depends on beside the full model.
        """
        text = repr((self.content, sorted(request.items())))
        return self.folder / f"{kind}-{hashlib.blake2b(text.encode(), digest_size=12).hexdigest()}.npz"

    def _load(self, load: Callable[[Path], Content], file: Path) -> Content | None:
        """Model or system, on every rank, that `load` reads from the file beside `file` (`_model_file`); collective.

        If that file can't be read, a warning is logged and None is returned.
        """
        loaded = None
        if self.comm.rank == 0:
            try:
                loaded = load(_model_file(file))
            except InputError as error:
                _log.warning("%s is made again: %s", file, error)
        everywhere: Content | None = self.comm.bcast(loaded)
        return everywhere

    def _read(self, file: Path) -> dict[str, NDArray[Any]] | None:
        """Arrays of a file by name, read by rank 0, on every rank; None if it is missing or damaged.  Collective."""
        arrays = npz.read_stored(file) if self.comm.rank == 0 else None
        result: dict[str, NDArray[Any]] | None = self.comm.bcast(arrays)
        return result

    def _write(
        self, file: Path, arrays: Mapping[str, NDArray[np.generic]], model: ReducedModel | System | None = None
    ) -> None:
        """Write `arrays` (any shape) by name to `file`.  If `model` is not None, write it to a file of its own first.

        The model's file is `_model_file(file)`.  Only rank 0 writes.  If a file can't be written, a warning is logged.
        """
        if self.comm.rank != 0:
            return
        try:
            if model is not None:
                model.save(_model_file(file))  # written first: `file` itself shows that both are complete
            npz.store(file, arrays)
        except NotWrittenError as error:
            _log.warning("not kept: %s", error)


@dataclass(frozen=True)
class Cache(SystemCache):
    """Folder that stores results which follow from one full model."""

    model: FullModel

    def reduced_body(self, request: Mapping[str, object], make: Callable[[], ReducedBody]) -> ReducedBody:
        """Return the body stored for this request; if there is none, call `make` and store its result; collective.

        The request holds all that the body depends on beside the full model and the code.
        """
        file = self._file("reduction", request)
        arrays = self._read(file)
        if arrays is not None:
            stored_body = self._load_body(file, arrays)
            if stored_body is not None:
                return stored_body
        body = make()
        has_basis = body.basis.V is not body.snapshots.S
        arrays = {
            "S": self._gather_rows(body.snapshots.S),
            "V": self._gather_rows(body.basis.V) if has_basis else np.empty((0, 0)),
            "omega": body.snapshots.omega,
            "s": body.snapshots.s,
            "residuals": body.snapshots.residuals,
            "sigma": body.basis.sigma,
            "source": np.array(body.snapshots.source),
            "product": np.array(body.basis.product),
        }
        self._write(file, arrays, body.modal)
        return body

    def _load_body(self, file: Path, arrays: Mapping[str, NDArray[Any]]) -> ReducedBody | None:
        """Body from the file of its model and from the arrays that are stored beside it; collective.

        `arrays` has its snapshots (``S``, ``omega``, ``s``, ``residuals``) and its basis (``V``, ``sigma``).  None is
        returned if the model's file can't be used.
        """
        model = self._load(ReducedModel.load, file)
        if model is None:
            return None
        S = tall(np.asarray(arrays["S"], float)[self.model.share], self.model.M)
        V = tall(np.asarray(arrays["V"], float)[self.model.share], self.model.M) if arrays["V"].size else S
        snapshots = Snapshots(S, arrays["omega"], arrays["s"], arrays["residuals"], str(arrays["source"]))
        return ReducedBody(snapshots, Basis(V, arrays["sigma"], str(arrays["product"])), model)

    def _gather_rows(self, tall_matrix: PETSc.Mat) -> Array:
        """Whole matrix (n, k) on rank 0, as an array, of the distributed `tall_matrix`; collective.

        On other ranks the result is an array without entries.
        """
        shares = self.model.comm.gather(np.array(tall_matrix.getDenseArray()))
        return np.concatenate(shares) if shares is not None else np.empty((0, 0))


def cache_in(folder: Path, model: FullModel) -> Cache:
    """Cache in `folder` of results that follow from a full model; collective.

    The folder is created if it does not exist; an InputError is raised if this fails.  The model must not change
    afterwards, because its digest is computed here.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        allowed = f"a folder that can be written to is allowed ({error.strerror})"
        raise InputError("command line", "--cache", str(folder), allowed) from None
    return Cache(folder, model_digest(model), model.comm, model)


def _model_file(file: Path) -> Path:
    """Path of the file beside `file` that stores the reduced model or system which belongs to it."""
    return file.with_name(f"{file.stem}-reduced.npz")
