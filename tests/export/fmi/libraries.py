"""Call FMUs through their C interface, in both versions of FMI, with the package's library."""

import csv
import ctypes
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmr.export import fmi
from pmr.export.fmi import Contents
from pmr.files.arrays import Array

_UINT, _SIZE, _DOUBLES = ctypes.c_uint32, ctypes.c_size_t, ctypes.POINTER(ctypes.c_double)
_LOGGER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
_LOGGER_3 = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)


class CallError(Exception):
    """The FMU refused a call; the message is its reason."""


@dataclass(frozen=True)
class Library:
    """Functions of an FMU, value references and causalities by name, and the location of its resources."""

    functions: ctypes.CDLL
    version: str
    token: str
    references: dict[str, int]
    causality: dict[str, str]
    resources: bytes

    def named(self, causality: str) -> list[str]:
        """Names of the variables with this causality."""
        return [name for name, has in self.causality.items() if has == causality]


def loaded(unit: Contents, folder: Path, version: str) -> Library:
    """Unpack the contents of an FMU in a folder and load the package's binary for it."""
    (host,) = fmi.selected_platforms("host", "3")
    library = Path(fmi.__file__).parent / "binaries" / host.folder_3 / f"pmr_fmi{host.suffix}"
    resources = folder / f"fmi {version}" / "resources"
    resources.mkdir(parents=True)
    (resources / "system.pmr").write_bytes(unit.system)
    root = ET.fromstring(unit.texts["modelDescription.xml"])
    variables = root.find("ModelVariables")
    assert variables is not None
    return Library(
        ctypes.CDLL(str(library)),
        version,
        unit.described.token,
        {v.attrib["name"]: int(v.attrib["valueReference"]) for v in variables},
        {v.attrib["name"]: v.attrib["causality"] for v in variables},
        (resources.as_uri() if version == "2" else f"{resources}/").encode(),
    )


class Instance:
    """Instance of an FMU, called by names of variables; raises CallError for a status that is not OK."""

    def __init__(self, made: Library, model_exchange: bool = False, token: str | None = None) -> None:
        self.library, self.said = made, [""]
        names = (made.token if token is None else token).encode()
        two, functions = made.version == "2", made.functions
        if two:
            self._logger = _LOGGER(lambda e, i, status, category, message: self.said.append(message.decode()))
            callbacks = (ctypes.c_void_p * 5)(ctypes.cast(self._logger, ctypes.c_void_p).value, None, None, None, None)
            self._callbacks = callbacks
            make = functions.fmi2Instantiate
            arguments = [b"body", 0 if model_exchange else 1, names, made.resources, callbacks, 0, 0]
        else:
            self._logger = _LOGGER_3(lambda e, status, category, message: self.said.append(message.decode()))
            given = [b"body", names, made.resources, False, False]
            if model_exchange:
                make, arguments = functions.fmi3InstantiateModelExchange, [*given, None, self._logger]
            else:
                make = functions.fmi3InstantiateCoSimulation
                arguments = [*given, False, False, None, _SIZE(0), None, self._logger, None]
        make.restype = ctypes.c_void_p
        made_instance = make(*arguments)
        if not made_instance:
            raise CallError(self.said[-1])
        self.c = ctypes.c_void_p(made_instance)

    def free(self) -> None:
        """Free the instance."""
        free = getattr(self.library.functions, f"fmi{self.library.version}FreeInstance")
        free.restype = None
        free(self.c)

    def call(self, name: str, *arguments: object) -> None:
        """Call a function of the interface; raise CallError if its status is not OK."""
        if getattr(self.library.functions, f"fmi{self.library.version}{name}")(self.c, *arguments) != 0:
            raise CallError(self.said[-1])

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set variables."""
        self._access("Set", names, np.array(values, dtype=float))

    def get(self, names: Sequence[str]) -> Array:
        """Values of variables."""
        values = np.zeros(len(names))
        self._access("Get", names, values)
        return values

    def choose_start(self, kind: int) -> None:
        """Choose the start: 0 at rest, 1 static, 2 as given."""
        reference = (_UINT * 1)(self.library.references["start"])
        if self.library.version == "2":
            self.call("SetInteger", reference, _SIZE(1), (ctypes.c_int * 1)(kind))
        else:
            self.call("SetInt64", reference, _SIZE(1), (ctypes.c_int64 * 1)(kind), _SIZE(1))

    def initialise(self, names: Sequence[str] = (), values: Sequence[float] = ()) -> None:
        """Initialise at t = 0 with values of some variables."""
        if self.library.version == "2":
            self.call("SetupExperiment", 0, ctypes.c_double(0.0), ctypes.c_double(0.0), 0, ctypes.c_double(0.0))
            self.call("EnterInitializationMode")
        else:
            zero = ctypes.c_double(0.0)
            self.call("EnterInitializationMode", False, zero, zero, False, zero)
        self.set(names, values)
        self.call("ExitInitializationMode")

    def step(self, t: float, h: float) -> None:
        """Take a communication step of h s from t s."""
        more: list[object] = [1]
        if self.library.version == "3":
            flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
            more = [True, *flags, ctypes.byref(ctypes.c_double())]
        self.call("DoStep", ctypes.c_double(t), ctypes.c_double(h), *more)

    def set_states(self, states: Array) -> None:
        """Set the continuous states."""
        self.call("SetContinuousStates", np.ascontiguousarray(states).ctypes.data_as(_DOUBLES), _SIZE(len(states)))

    def derivatives(self, count: int) -> Array:
        """Derivatives of the `count` continuous states."""
        found = np.zeros(count)
        name = "GetDerivatives" if self.library.version == "2" else "GetContinuousStateDerivatives"
        self.call(name, found.ctypes.data_as(_DOUBLES), _SIZE(count))
        return found

    def directional(self, unknowns: Sequence[str], known: str) -> Array:
        """Derivatives of some unknowns by a known variable."""
        found, seed = np.zeros(len(unknowns)), np.ones(1)
        of, at = self._references(unknowns), self._references([known])
        pointers = [seed.ctypes.data_as(_DOUBLES), found.ctypes.data_as(_DOUBLES)]
        if self.library.version == "3":
            pointers = [pointers[0], _SIZE(1), pointers[1], _SIZE(len(unknowns))]
        self.call("GetDirectionalDerivative", of, _SIZE(len(unknowns)), at, _SIZE(1), *pointers)
        return found

    def saved(self) -> ctypes.c_void_p:
        """Save the current state of the FMU, and return a pointer to it."""
        state = ctypes.c_void_p()
        self.call("GetFMUstate" if self.library.version == "2" else "GetFMUState", ctypes.byref(state))
        return state

    def restore(self, state: ctypes.c_void_p) -> None:
        """Restore a state."""
        self.call("SetFMUstate" if self.library.version == "2" else "SetFMUState", state)

    def serialised(self, state: ctypes.c_void_p) -> bytes:
        """Serialise a state."""
        word, size = ("FMUstate" if self.library.version == "2" else "FMUState"), ctypes.c_size_t()
        self.call(f"Serialized{word}Size", state, ctypes.byref(size))
        content = ctypes.create_string_buffer(size.value)
        self.call(f"Serialize{word}", state, content, size)
        return content.raw

    def deserialised(self, content: bytes) -> ctypes.c_void_p:
        """Read a serialised state."""
        state = ctypes.c_void_p()
        word = "DeSerializeFMUstate" if self.library.version == "2" else "DeserializeFMUState"
        self.call(word, content, _SIZE(len(content)), ctypes.byref(state))
        return state

    def _references(self, names: Sequence[str]) -> object:
        """Array of the value references of variables."""
        return (_UINT * len(names))(*(self.library.references[name] for name in names))

    def _access(self, verb: str, names: Sequence[str], values: Array) -> None:
        """Call the function that sets or gets variables; `values` are read or overwritten."""
        of, pointer, count = self._references(names), values.ctypes.data_as(_DOUBLES), _SIZE(len(names))
        if self.library.version == "2":
            self.call(f"{verb}Real", of, count, pointer)
        else:
            self.call(f"{verb}Float64", of, count, pointer, count)


def follow_reference(unit: Contents, library: Library) -> tuple[dict[str, Array], dict[str, Array]]:
    """Outputs of an FMU under the inputs of its own reference, and the outputs of this, by name, at its instants."""
    given, expected = (table(unit.texts[f"resources/reference_{part}.csv"]) for part in ("in", "out"))
    instance, t, instants = Instance(library), given.pop("time"), expected.pop("time")
    rows = np.column_stack(list(given.values()))
    instance.initialise(list(given), rows[0])
    outputs = [instance.get(list(expected))]
    for k in range(len(rows) - 1):
        instance.set(list(given), rows[k])
        instance.step(t[k], t[k + 1] - t[k])
        outputs.append(instance.get(list(expected)))
    shown = np.array(outputs)[np.searchsorted(t, instants - 1e-9)]
    return dict(zip(expected, shown.T, strict=True)), expected


def table(text: str) -> dict[str, Array]:
    """Columns of comma-separated values by their names."""
    head, *rows = csv.reader(text.splitlines())
    return dict(zip(head, np.array(rows, float).T, strict=True))
