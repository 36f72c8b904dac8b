"""One file of a system: its reduced bodies, the contacts between them, and the scene that it was made from.

An npz file whose header in JSON has format, version, names of the bodies, contacts, terms and provenance; the arrays of
body k stand behind ``bodies.k.``, as `pmr.reduced.stored` names them; behind ``on_modes.k.`` those of bodies without
modes of their cylinders and without inertia, whose names the header has too, where they are others than those of the
body with these modes: ``same`` names arrays of this kind that stand there once; and the matrices of term k are
``terms.k.stiffness`` and ``terms.k.damping``.  Nothing in it is pickled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from pmr.errors import InputError
from pmr.errors.text import no_file
from pmr.files import npz, records
from pmr.reduced import stored
from pmr.reduced.model import FORMAT as ONE_BODY
from pmr.reduced.model import READING, ReducedModel
from pmr.reduced.soundness import misnamed
from pmr.system.contacts import ALONE, Contact
from pmr.system.terms import Term

FORMAT = "pmr-system"
FORMAT_VERSION = 6
#: What content may take in memory, by that of the file, and for a small one.
ROOM = npz.MOST_EXPANSION, npz.ROOM


@dataclass(frozen=True)
class Saved:
    """What a file holds."""

    bodies: Mapping[str, ReducedModel]
    contacts: tuple[Contact, ...]
    terms: tuple[Term, ...]
    provenance: dict[str, Any]
    on_modes: Mapping[str, ReducedModel]  # as `pmr.system.system.System` has them


@dataclass(frozen=True)
class _TermHeader:
    """A term without its matrices."""

    name: str
    bodies: tuple[str, ...]


@dataclass(frozen=True)
class _Header:
    """Of version 6; 5 has all arrays of bodies, 4 no ropes that bear others or change their length.

    Version 3 has all arrays of models on modes, 2 no such models, 1 no terms either.
    """

    bodies: tuple[str, ...]
    contacts: tuple[Contact, ...]
    provenance: dict[str, Any]
    terms: tuple[_TermHeader, ...] = ()
    on_modes: tuple[str, ...] = ()
    same: Mapping[str, str] = field(default_factory=dict)  # where an array stands that is left out


_HEADER = TypeAdapter(_Header)


def write(path: Path, system: Saved) -> None:
    """Write a system, all of it or nothing."""
    arrays = dict[str, NDArray[Any]]()
    for number, body in enumerate(system.bodies.values()):
        arrays |= stored.arrays(body, f"bodies.{number}.")
    same, names = dict[str, str](), list(system.bodies)
    for number, (name, body) in enumerate(system.on_modes.items()):
        beside = f"bodies.{names.index(name)}."
        for key, array in stored.arrays(body).items():
            if beside + key in arrays and np.array_equal(array, arrays[beside + key]):
                same[f"on_modes.{number}.{key}"] = beside + key
            else:
                arrays[f"on_modes.{number}.{key}"] = array
    for number, term in enumerate(system.terms):
        arrays |= {f"terms.{number}.{key}": matrix for key, matrix in term.arrays.items()}
        on = {term.bodies.index(name): A for name, A in term.supports.items()}
        arrays |= {f"terms.{number}.supports.{body}": A for body, A in on.items()}
    header = {"format": FORMAT, "version": FORMAT_VERSION, "units": "SI", "bodies": list(system.bodies)}
    parts = {
        "contacts": [asdict(one) for one in system.contacts],
        "terms": [{"name": term.name, "bodies": term.bodies} for term in system.terms],
        "provenance": dict(system.provenance),
        "on_modes": list(system.on_modes),
        "same": same,
    }
    npz.write(path, arrays, {**header, **parts}, compressed=True)


def read(path: Path) -> Saved | ReducedModel:
    """What `write` wrote, or the model of a file that holds one body, as `ReducedModel.save` writes it.

    An InputError of the file is raised as by `ReducedModel.load`.
    """
    if not isfile(path):
        allowed = f"{no_file(path)}; `pmr run` writes system.npz, or reduced.npz of one body"
        raise InputError(str(path), "", None, allowed)
    try:
        header = npz.without_header(npz.read(path, *ROOM, only={npz.HEADER, npz.OLD_HEADER}))
        if header["format"] == ONE_BODY:
            return ReducedModel.load(path)
        if header["format"] != FORMAT:
            raise InputError(str(path), "format", header["format"], f"{FORMAT!r} or {ONE_BODY!r} is allowed")
        if int(header["version"]) > FORMAT_VERSION:
            raise InputError(str(path), "version", header["version"], f"at most {FORMAT_VERSION} can be read")
        known = _HEADER.validate_python(
            {field.name: header[field.name] for field in fields(_Header) if field.name in header}
        )
        data = npz.read(path, *ROOM)
        data = {key: data[one] for key, one in known.same.items()} | data
        models, on_modes = (
            [
                records.record(ReducedModel, stored.filled(data, f"{kind}.{number}."), f"{kind}.{number}.")
                for number in range(len(names))
            ]
            for kind, names in {"bodies": known.bodies, "on_modes": known.on_modes}.items()
        )
        terms = tuple(_term(one, data, f"terms.{number}.") for number, one in enumerate(known.terms))
        wrong = _contradiction(known, models, on_modes)
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
    bodies, modal = dict(zip(known.bodies, models, strict=True)), dict(zip(known.on_modes, on_modes, strict=True))
    return Saved(bodies, known.contacts, terms, known.provenance, modal)


def _term(known: _TermHeader, data: Mapping[str, NDArray[Any]], prefix: str) -> Term:
    found = {key: np.asarray(data[prefix + key], float) for key in ("stiffness", "damping") if prefix + key in data}
    on = {name: f"{prefix}supports.{body}" for body, name in enumerate(known.bodies)}
    supports = {name: np.asarray(data[key], float) for name, key in on.items() if key in data}
    return Term(known.name, known.bodies, **found, supports=supports)


def _contradiction(known: _Header, models: list[ReducedModel], on_modes: list[ReducedModel]) -> str | None:
    """What is wrong with it, in words; None where names are names and every body is sound."""
    places = [place for one in known.contacts for place in (one.inner, one.outer) if place is not None]
    named = {"bodies": known.bodies, "contacts": tuple(one.name for one in known.contacts)}
    named |= {"terms": tuple(one.name for one in known.terms)}
    named |= {"paths": tuple(place.path for place in places if place.path is not None)}
    if not models or len(set(known.bodies)) < len(models) or (ALONE in known.bodies and len(models) > 1):
        return f"{len(models)} bodies, one or more with names that differ are allowed"
    for what, names in named.items():
        if wrong := misnamed(what, tuple(name for name in names if (what, name) != ("bodies", ALONE))):
            return wrong
    for name, model in zip(known.bodies, models, strict=True):
        if wrong := model.contradiction():
            return f"bodies.{name}: {wrong}"
    for name, model in zip(known.on_modes, on_modes, strict=True):
        if name not in known.bodies:
            return f"on_modes.{name}: {', '.join(known.bodies)} are allowed"
        if wrong := model.contradiction() or _other(models[known.bodies.index(name)], model):
            return f"on_modes.{name}: {wrong}"
    return None


def _other(model: ReducedModel, on_modes: ReducedModel) -> str | None:
    """Why one model is no other with modes of its cylinder, in words; None where it may be."""
    for names in ("row_names", "input_names", "output_names"):
        if getattr(model, names) != getattr(on_modes, names):
            return f"{names} {getattr(on_modes, names)} are not those of its body"
    if on_modes.size != (own := model.size - model.cylinder_modes - len(model.quasi_static)):
        return f"{on_modes.size} coordinates, {own} are allowed"
    return None
