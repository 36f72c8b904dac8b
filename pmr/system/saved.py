"""File of a system: its reduced bodies, the contacts between them, its terms, and the scene it was made from.

An npz file whose JSON header has format, version, names of the bodies, contacts, names and bodies of the terms, and
provenance.  The arrays of body k have names that begin with ``bodies.k.``, as in `pmr.system.carriers`.  Arrays that
begin with ``on_modes.k.`` belong to a second model of a body, which has neither cylinder modes nor modes without
inertia; the names of these bodies are in the header.  An array that equals an array of the body is not stored again:
``same`` in the header maps its name to the name of the stored array.  The matrices of term k are ``terms.k.stiffness``
and ``terms.k.damping``, and ``terms.k.supports.j`` is its work on the supports of the j-th of its bodies.  Nothing in
the file is pickled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from pmr.errors import InputError, missing_file_reason
from pmr.files import npz
from pmr.system.body_matrices import describe_names
from pmr.system.carriers import pack_model
from pmr.system.contacts import ALONE, Contact
from pmr.system.reduced_model import FORMAT as ONE_BODY
from pmr.system.reduced_model import READING, ReducedModel
from pmr.system.terms import Term

FORMAT = "pmr-system"
FORMAT_VERSION = 6
#: Limits on the memory of the content: relative to the size of the file, and absolute for a small file.
ROOM = npz.MOST_EXPANSION, npz.ROOM


@dataclass(frozen=True)
class StoredSystem:
    """Content of a system's file: the fields of a `pmr.system.system.System` that are stored."""

    bodies: Mapping[str, ReducedModel]
    contacts: tuple[Contact, ...]
    terms: tuple[Term, ...]
    provenance: dict[str, Any]
    on_modes: Mapping[str, ReducedModel]  # as `pmr.system.system.System` has them


@dataclass(frozen=True)
class _TermHeader:
    """Name and bodies of a term; its matrices are arrays of the file."""

    name: str
    bodies: tuple[str, ...]


@dataclass(frozen=True)
class _Header:
    """Header of version 6.

    An earlier version also lacks what is missing in the versions after it.  Version 5 stores all arrays of bodies, even
    arrays that are equal.  Version 4 has no contacts that bear the forces of others, and no ropes that lengthen.
    Version 3 stores all arrays of the models in ``on_modes``.  Version 2 has no such models.  Version 1 has no terms.
    """

    __pydantic_config__ = ConfigDict(defer_build=True)

    bodies: tuple[str, ...]
    contacts: tuple[Contact, ...]
    provenance: dict[str, Any]
    terms: tuple[_TermHeader, ...] = ()
    on_modes: tuple[str, ...] = ()
    same: Mapping[str, str] = field(default_factory=dict)  # name of an array that is not stored: name of an equal one


_HEADER = TypeAdapter(_Header)


def write(path: Path, system: StoredSystem) -> None:
    """Write a system to a file; an existing file is replaced only once the new one is complete.

    A body may have a second model in `on_modes`, which has neither cylinder modes nor modes without inertia.  Arrays
    that both models have in common are stored once.
    """
    arrays = dict[str, NDArray[Any]]()
    for number, body in enumerate(system.bodies.values()):
        arrays |= pack_model(body, f"bodies.{number}.")
    same, names = dict[str, str](), list(system.bodies)
    for number, (name, body) in enumerate(system.on_modes.items()):
        stem = f"bodies.{names.index(name)}."
        for key, array in pack_model(body).items():
            if stem + key in arrays and np.array_equal(array, arrays[stem + key]):
                same[f"on_modes.{number}.{key}"] = stem + key
            else:
                arrays[f"on_modes.{number}.{key}"] = array
    for number, term in enumerate(system.terms):
        arrays |= {f"terms.{number}.{key}": matrix for key, matrix in term.arrays.items()}
        on = {term.bodies.index(name): A for name, A in term.supports.items()}
        arrays |= {f"terms.{number}.supports.{body}": A for body, A in on.items()}
    header = {"format": FORMAT, "version": FORMAT_VERSION, "units": "SI", "bodies": list(system.bodies)}
    parts = {
        "contacts": [asdict(contact) for contact in system.contacts],
        "terms": [{"name": term.name, "bodies": term.bodies} for term in system.terms],
        "provenance": dict(system.provenance),
        "on_modes": list(system.on_modes),
        "same": same,
    }
    npz.write(path, arrays, {**header, **parts}, compressed=True)


def read(path: Path) -> StoredSystem | ReducedModel:
    """Return the system in a file of `write`, or the model in a file of `ReducedModel.save`.

    An InputError with the name of the file is raised under the conditions of `ReducedModel.load`.
    """
    if not isfile(path):
        allowed = f"{missing_file_reason(path)}; `pmr run` writes system.npz, or reduced.npz of one body"
        raise InputError(str(path), "", None, allowed)
    try:
        header = npz.pop_header(npz.read(path, *ROOM, only={npz.HEADER}))
        if header["format"] == ONE_BODY:
            return ReducedModel.load(path)
        if header["format"] != FORMAT:
            raise InputError(str(path), "format", header["format"], f"{FORMAT!r} or {ONE_BODY!r} is allowed")
        if int(header["version"]) > FORMAT_VERSION:
            raise InputError(str(path), "version", header["version"], f"at most {FORMAT_VERSION} can be read")
        file_header = _HEADER.validate_python(
            {field.name: header[field.name] for field in fields(_Header) if field.name in header}
        )
        data = npz.read(path, *ROOM)
        data = {key: data[place] for key, place in file_header.same.items()} | data
        models, on_modes = (
            [ReducedModel.from_arrays(data, f"{kind}.{number}.") for number in range(len(names))]
            for kind, names in {"bodies": file_header.bodies, "on_modes": file_header.on_modes}.items()
        )
        terms = tuple(_read_term(term, data, f"terms.{number}.") for number, term in enumerate(file_header.terms))
        wrong = _contradiction(file_header, models, on_modes)
    except InputError:
        raise
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(str(path), where, None, f"not a system written by pmr ({first['msg']})") from None
    except READING as error:
        raise InputError(str(path), "", None, f"not a system written by pmr ({error})") from None
    if wrong:
        raise InputError(str(path), "", None, f"not a sound system: {wrong}")
    bodies = dict(zip(file_header.bodies, models, strict=True))
    modal = dict(zip(file_header.on_modes, on_modes, strict=True))
    return StoredSystem(bodies, file_header.contacts, terms, file_header.provenance, modal)


def _read_term(header: _TermHeader, data: Mapping[str, NDArray[np.generic]], prefix: str) -> Term:
    """Term with the name and bodies in `header`, and with matrices from arrays of a file.

    The matrices (n, n) are those arrays of `data` whose names begin with `prefix`.
    """
    matrices = {key: np.asarray(data[prefix + key], float) for key in ("stiffness", "damping") if prefix + key in data}
    on = {name: f"{prefix}supports.{body}" for body, name in enumerate(header.bodies)}
    supports = {name: np.asarray(data[key], float) for name, key in on.items() if key in data}
    return Term(header.name, header.bodies, **matrices, supports=supports)


def _contradiction(header: _Header, models: list[ReducedModel], on_modes: list[ReducedModel]) -> str | None:
    """Description of what is wrong with a file; None if all names are allowed and all bodies are sound.

    `models` are the bodies in the order of the `header`, and `on_modes` the second models of bodies, without cylinder
    modes, that the header lists.
    """
    places = [place for entry in header.contacts for place in (entry.inner, entry.outer) if place is not None]
    named = {"bodies": header.bodies, "contacts": tuple(entry.name for entry in header.contacts)}
    named |= {"terms": tuple(entry.name for entry in header.terms)}
    named |= {"paths": tuple(place.path for place in places if place.path is not None)}
    if not models or len(set(header.bodies)) < len(models) or (ALONE in header.bodies and len(models) > 1):
        return f"{len(models)} bodies, one or more with names that differ are allowed"
    for what, names in named.items():
        if wrong := describe_names(what, tuple(name for name in names if (what, name) != ("bodies", ALONE))):
            return wrong
    for name, model in zip(header.bodies, models, strict=True):
        if wrong := model.contradiction():
            return f"bodies.{name}: {wrong}"
    for name, model in zip(header.on_modes, on_modes, strict=True):
        if name not in header.bodies:
            return f"on_modes.{name}: {', '.join(header.bodies)} are allowed"
        if wrong := model.contradiction() or _mismatch(models[header.bodies.index(name)], model):
            return f"on_modes.{name}: {wrong}"
    return None


def _mismatch(model: ReducedModel, on_modes: ReducedModel) -> str | None:
    """Return in words why `on_modes` is not `model` after removal of its cylinder modes and modes without inertia.

    None is returned if `on_modes` can be that model.
    """
    for names in ("row_names", "input_names", "output_names"):
        if getattr(model, names) != getattr(on_modes, names):
            return f"{names} {getattr(on_modes, names)} are not those of its body"
    if on_modes.size != (size := model.size - model.cylinder_modes - len(model.quasi_static)):
        return f"{on_modes.size} coordinates, {size} are allowed"
    return None
