"""Damaged, crafted or lying model files: accepted ones are described, exported and simulated."""

import io
import json
import struct
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from fuzz import toml
from fuzz.bases import BEAM, BOOM, FLEXIBLE
from fuzz.mutations import NUMBERS, Random, mutated, scratched
from fuzz.scenes import coarse
from fuzz.scenes import prepare as warm
from fuzz.verdict import NonsenseError, ensure_finite

MOST_STEPS = 100


prepare = warm


def case(number: int, rng: Random, folder: Path) -> str:
    """Read a mutation of a model file and use it if it is accepted; return the outcome in a few words."""
    from pmr import ReducedModel, System
    from pmr.cli.info import describe_model
    from pmr.errors import escape_controls
    from pmr.export.exudyn_script import script_data

    file = folder / "model.npz"
    file.write_bytes(_changed(_whole()[int(rng.integers(len(_whole())))], rng))
    model = ReducedModel.load(file)
    if any(not isinstance(text, str) for text in describe_model(model).values()):
        raise NonsenseError("what info says is no text")
    moved = _simulated(model)
    try:
        arrays = script_data(System.of(model), file.name)
    except ValueError as error:
        return f"{moved}, no script: {escape_controls(str(error))[:100]}"
    if any(np.asarray(array).dtype.hasobject for array in arrays.values()):
        raise NonsenseError("a script's data is no array of numbers or names")
    return moved


def _simulated(model: Any) -> str:
    """Simulate a model with its own scene; return the largest displacement as text, or why there is none."""
    import one_body
    from one_body import displacement

    from pmr import SimulationError
    from pmr.scene import Scene
    from pmr.simulation import Excitation, TimeStepping

    try:
        scene = Scene.model_validate(model.provenance["scene"])
        time = scene.time
    except (KeyError, TypeError, ValueError, AttributeError):
        return "no scene"
    stepping = TimeStepping(min(time.steps, MOST_STEPS) * time.step, time.step, time.rho_inf)
    excitation = Excitation.from_scene(scene).with_stepping(stepping)
    try:
        found = one_body.simulate(model, excitation)
    except SimulationError as error:  # what the library says to a program of one's own; no command simulates a model
        return f"gave up: {error}"
    ensure_finite("q", found.q)
    ensure_finite("multipliers", found.multipliers)
    moved = displacement(model, found.q, found.s, found.multipliers, excitation.forces(model.input_names))
    ensure_finite("displacement", moved)
    return f"{np.abs(moved).max(initial=0.0):.2e} m"


@lru_cache
def _whole() -> tuple[bytes, ...]:
    """Sound model files of three small scenes."""
    import tempfile

    from pmr import reduce
    from pmr import scene as scenes
    from pmr.fem.compat import MPI

    found = []
    with tempfile.TemporaryDirectory() as folder:
        for base in (BEAM, FLEXIBLE, BOOM):
            file = Path(folder, "scene.toml")
            file.write_text(toml.written(base))
            scene = coarse(scenes.load(file)).model_copy(update={"accuracy": None})  # what is reduced has no tolerance
            found.append(reduce(scene, MPI.COMM_SELF).reduced.save(Path(folder, "m.npz")).read_bytes())
    return tuple(found)


def _changed(content: bytes, rng: Random) -> bytes:
    """Mutate a model file: its bytes, its header, its arrays or their headers."""
    kind = rng.random()
    if kind < 0.25:
        return scratched(content, rng)
    with np.load(io.BytesIO(content)) as data:
        arrays = dict(data)
    members = {}
    header = json.loads(str(arrays.pop("header")))
    if kind < 0.55:
        header = mutated(header, rng)
        arrays["provenance"] = np.array(json.dumps(mutated(json.loads(str(arrays["provenance"])), rng), default=str))
    elif kind < 0.9:
        for _ in range(int(rng.integers(1, 3))):
            names = sorted(arrays)
            name = names[int(rng.integers(len(names)))]
            changed = _array(arrays[name], rng)
            if changed is None:
                del arrays[name]
            else:
                arrays[name] = changed
    text = np.array(json.dumps(header, default=str))
    for name, array in {"header": text, **arrays}.items():
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, np.asanyarray(array), allow_pickle=True)
        members[name] = buffer.getvalue()
    if kind >= 0.9:
        names = sorted(members)
        name = names[int(rng.integers(len(names)))]
        members[name] = _lying(members[name], rng)
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED if rng.random() < 0.05 else zipfile.ZIP_STORED) as archive:
        for name, member in members.items():
            archive.writestr(f"{name}.npy", member)
    return written.getvalue()


#: In place of names of rows, inputs and outputs.
ODD_NAMES = ["", "x" * 10_000, "a\nb", "\x1b[31m", "slider", "\u202e", "0", "F"]


def _array(array: np.ndarray, rng: Random) -> Any:
    """Array to put in place of another one; None if it is to be missing."""
    kind, number = int(rng.integers(11)), float(NUMBERS[int(rng.integers(len(NUMBERS)))])
    if kind == 0:
        return None
    if kind == 1:
        return array[..., :-1] if array.ndim else array
    if kind == 2:
        return np.concatenate([array, array]) if array.ndim else array
    if kind == 3:
        return array.T
    if array.dtype.kind == "U" and kind in (4, 5, 9, 10):
        return np.where(rng.random(np.shape(array)) < 0.5, ODD_NAMES[int(rng.integers(len(ODD_NAMES)))], array)
    if kind == 4:
        return array.astype([str, complex, np.float32, object, bool, np.float16][int(rng.integers(6))])
    if kind == 5:
        return array * number
    if kind == 6:
        return np.full(np.shape(array), number)
    if kind == 7:
        return np.zeros((0, *np.shape(array)[1:]))
    if kind == 8:
        return array[None]
    changed = np.array(array, dtype=float)
    if changed.size:
        changed.flat[int(rng.integers(changed.size))] = number if kind == 9 else -changed.flat[0]
    return changed


def _lying(member: bytes, rng: Random) -> bytes:
    """Put a header that claims another shape, type or order before the content of an array."""
    shapes = ["(268435456,)", "(1099511627776, 1099511627776)", "(-1,)", "()", "(0,)", "(3, 3, 3)", "None", "(1.5,)"]
    types = ["'<f8'", "'<f8'", "'|O'", "'<U1000000000'", "'|V8'", "'<c16'", "'>f8'", "[('a', '<f8')]", "'<M8[s]'", "0"]
    shape, descr = shapes[int(rng.integers(len(shapes)))], types[int(rng.integers(len(types)))]
    header = f"{{'descr': {descr}, 'fortran_order': {bool(rng.integers(2))}, 'shape': {shape}, }}\n".encode()
    version = bytes([int(rng.integers(1, 5)), 0])
    return b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header + member[128:]
