"""A reduced model as a functional mock-up unit (FMU): an archive of description, binaries, the system and a reference.

The binaries are the compiled kernel with the FMI interface around it, the same for all models: they are built with the
package.  Only resources/system.pmr differs between models.
"""

from __future__ import annotations

import hashlib
import platform as this
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pmr.kernel
from pmr.errors import BEYOND_ENDS, InputError, environment
from pmr.export.fmi.description import (
    ModelAttributes,
    build_description,
    inputs_csv,
    model_description,
    outputs_csv,
    reference,
)
from pmr.export.fmi.variables import Drivers, Identifiers, Role, Variable, variables
from pmr.files.arrays import Array
from pmr.files.whole import replacement_file
from pmr.kernel.blocks import LINE, lines, pack, seal
from pmr.kernel.filter import FilterData
from pmr.kernel.kernel import checksum
from pmr.kernel.limits import LimitCheck
from pmr.simulation import contact_step
from pmr.simulation.moving import StoredScene, read_scene
from pmr.simulation.native.watched import watched_limits
from pmr.system.system import System

#: Sizes and numbers of a filter in the order in which source/estimator.c reads them.
SIZES = ("states", "outputs", "sensors", "inputs", "loads", "parameters", "biased", "scaled", "off", "payload")
NUMBERS = ("gravity", "gate", "refused", "alarm", "share", "following")


@dataclass(frozen=True)
class UnitObserver:
    """Kalman filter of an observer in an FMU, and the outputs and loads of the system to which its numbers refer.

    The filter has q outputs, i inputs and p sensors.  `outputs`, `columns`, `orders`, `felt`, `inputs` and `sensors`
    are in the filter's order.  `units` has the unit of each unknown, then of each output, by name.
    """

    data: FilterData
    step: float  # s
    outputs: tuple[str, ...]  # (q,)
    columns: NDArray[np.int32]  # (q,) among outputs of the bodies, then forces of all contacts
    orders: NDArray[np.int32]  # (q,): of rates with respect to time
    felt: Array  # (q,) m/s^2: what accelerometers feel at rest
    inputs: tuple[str, ...]  # (i,): loads of the model
    sensors: tuple[str, ...]  # (p,)
    units: Mapping[str, str]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of all quantities that are estimated in addition to the outputs."""
        return tuple(name for name in self.units if name not in self.outputs)

    def arrays(self, drivers: Drivers) -> dict[str, NDArray[np.int32] | Array]:
        """Arrays of the observer of a system with these `drivers`, for resources/system.pmr, by name.

        Arrays without entries are left out.
        """
        numbers, data = drivers.system.input_names, self.data
        sizes = [*(data.sizes[name] for name in SIZES), data.sizes["acceleration"], len(self.unknowns)]
        arrays: dict[str, NDArray[np.int32] | Array] = {
            "sizes": np.array(sizes, np.int32),
            "numbers": np.array([*(data.numbers[name] for name in NUMBERS), self.step]),
            "columns": self.columns,
            "orders": self.orders,
            "felt": self.felt,
            "loads": np.array([drivers.first_load_number + numbers.index(name) for name in self.inputs], np.int32),
            "x": data.x,
            "P": data.P.ravel(),
            "square": data.square,
        }
        arrays |= {name: np.asarray(array, np.int32) for name, array in data.indices.items()} | dict(data.arrays)
        return {f"observer_{name}": array for name, array in arrays.items() if len(array)}

    def variables(self, names: Identifiers, first: int) -> Iterator[Variable]:
        """Yield the observer's variables, numbered from the value reference `first` on, as in source/estimator.c.

        Their order is: an input for the measurement of each sensor; the estimate of each output, and its standard
        deviation; the estimate of each unknown, and its standard deviation; the innovation of each sensor; the alarm of
        each sensor.  `names` makes identifiers from names.
        """
        listed = list[Variable]()
        for name in self.sensors:
            what = f"measured {name}; NaN where nothing was measured"
            variable = Variable(names(f"measured_{name}"), 0, what, Role("input", initial=""), self._unit(name))
            listed.append(replace(variable, start=float("nan")))
        for group in (self.outputs, self.unknowns):
            for what in ("estimate", "standard deviation"):
                listed += [self._output(names, what, name, self._unit(name)) for name in group]
        listed += [self._output(names, "innovation", name, "1") for name in self.sensors]
        listed += [self._output(names, "alarm", name, "1") for name in self.sensors]
        yield from (replace(variable, reference=first + k) for k, variable in enumerate(listed))

    def _unit(self, name: str) -> str:
        """Unit of the output or unknown called `name`, in FMI's spelling."""
        return self.units[name].replace("^", "")

    @staticmethod
    def _output(names: Identifiers, what: str, name: str, unit: str) -> Variable:
        """Output variable in the unit `unit` for a result of the observer about the output or unknown `name`.

        `what` says which result it is, such as a standard deviation.
        """
        return Variable(names(f"{what}_of_{name}"), 0, f"{what} of {name}, one step ago", unit=unit)


VERSIONS = ("2", "3")
_HERE = Path(__file__).parent
_SOURCES = (Path(pmr.kernel.__file__).with_name("src"), _HERE / "source")
#: Time stamp of every file in the archive, so that the same model makes the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Platform:
    """A platform with FMU binaries: folders in FMI 2.0 (empty: none) and 3.0, compiler's target, library suffix."""

    folder_2: str
    folder_3: str
    target: str
    suffix: str


PLATFORMS = (
    Platform("linux64", "x86_64-linux", "x86_64-linux-gnu.2.17", ".so"),
    Platform("", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
    Platform("win64", "x86_64-windows", "x86_64-windows-gnu", ".dll"),
    Platform("darwin64", "x86_64-darwin", "x86_64-macos", ".dylib"),
    Platform("", "aarch64-darwin", "aarch64-macos", ".dylib"),
)
#: Names of processors as in `Platform.folder_3`, by their names in Python.
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
_FLAGS = ("-shared", "-std=gnu11", "-O2", "-ffp-contract=fast", "-fvisibility=hidden", "-fno-sanitize=undefined", "-s")


@dataclass(frozen=True)
class Contents:
    """All files of an FMU except the binaries: `texts` by name in the archive, and resources/system.pmr, `system`.

    `described` has the attributes of the model in its description.
    """

    texts: dict[str, str]
    system: bytes
    described: ModelAttributes


def selected_platforms(platforms: str | None, version: str) -> tuple[Platform, ...]:
    """Platforms that ``--platforms`` selects for a version of FMI.

    ``all`` selects every platform; ``host`` or None selects this machine's, or every platform if no binary fits this
    machine.  Raises InputError for any other text.
    """
    if platforms not in (None, "host", "all"):
        raise InputError("command line", "--platforms", platforms, "host or all is allowed")
    host = f"{_MACHINES.get(this.machine().lower(), '')}-{this.system().lower()}"
    of_host = tuple(of for of in PLATFORMS if of.folder_3 == host and _platform_folder(of, version))
    return PLATFORMS if platforms == "all" else of_host or PLATFORMS


def write_fmu(
    npz_path: str | Path,
    target: str | Path,
    version: str = "3",
    platforms: Sequence[Platform] = PLATFORMS,
    sources: bool = False,
    observer: UnitObserver | None = None,
) -> Path:
    """Write a saved system or reduced model as an FMU for Co-Simulation, and, if it is an ODE, for Model Exchange.

    Parameters
    ----------
    npz_path : str or Path
        File of the system, with the scene stored in it.  Its paths and loads become inputs of the FMU; outputs of its
        bodies and forces of its contacts become outputs.  The scene has the initial state, and the excitation of the
        reference trajectory.
    target : str or Path
        Archive to be written, which is returned; the binaries take its name.
    version : {"2", "3"}
        Version of FMI.
    platforms : sequence of Platform
        Platforms whose binaries are included.
    sources : bool
        Whether the C sources are included, for importers that compile them.
    observer : UnitObserver, optional
        Observer whose measurements become inputs and whose estimates become outputs; the FMU is then for
        Co-Simulation only.

    Raises
    ------
    InputError
        If `version` is another one, the file holds neither a system nor a model, a rigid contact only pushes, or a
        binary is missing; also as `pmr.simulation.SystemSimulator` and `UnitObserver.arrays`.
    """
    if version not in VERSIONS:
        raise InputError("command line", "--fmi", version, "2 or 3 is allowed")
    system, target = System.load(Path(npz_path)), Path(target)
    scene = read_scene(system, Path(npz_path).name, free=True)
    unit = fmu_contents(system, scene, target.stem, version, sources, observer)
    files: dict[str, str | bytes] = {**unit.texts, "resources/system.pmr": unit.system}
    for platform in platforms:
        if place := _platform_folder(platform, version):
            files[f"binaries/{place}/{unit.described.identifier}{platform.suffix}"] = library_bytes(platform)
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacement_file(target) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return target


def fmu_contents(
    system: System,
    scene: StoredScene,
    name: str,
    version: str,
    sources: bool = False,
    observer: UnitObserver | None = None,
) -> Contents:
    """Description, system and reference trajectory of an FMU whose binaries are called `name`.

    `version` is that of FMI, ``"2"`` or ``"3"``; `sources` says whether the C sources are included; there is no
    observer if `observer` is None.  Errors are those of `write_fmu`.
    """
    # with an observer contacts are combined as those of its own model, to the last bit
    drivers = Drivers.of(system, reactions=observer is None)
    run = reference(drivers, scene)
    start_values, further = run.start_values, dict[str, NDArray[Any]]()
    if observer is not None:
        further = dict(observer.arrays(drivers))
        start_values[-3] = observer.step
    further_variables = None if observer is None else observer.variables
    listed = variables(drivers, start_values, run.nominal, further_variables)
    names = {variable.reference: variable.name for variable in listed}
    by_reference = [names.get(reference, "") for reference in range(max(names) + 1)]
    file = system_file(drivers, by_reference, start_values, run.nominal, 0.0 if observer else run.omega, further)
    files = source_files(version) if sources else {}
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name)
    described = ModelAttributes(
        identifier=plain if re.match(r"[A-Za-z_]", plain) else f"model_{plain}",
        title=scene.title,
        token=file.token,
        model_exchange=drivers.is_differential and observer is None,
        derivatives=drivers.has_derivatives,
        sources=compiled_files(files),
        end=run.stepping.end,
        step=run.stepping.step,
    )
    texts = {"modelDescription.xml": model_description(described, listed, version)}
    texts |= {f"sources/{name}": text for name, text in files.items()}
    if version == "3" and sources:
        texts["sources/buildDescription.xml"] = build_description(described)
    texts["resources/reference_in.csv"] = inputs_csv(run, listed)
    texts["resources/reference_out.csv"] = outputs_csv(run, drivers, listed)
    return Contents(texts, file.content, described)


def source_files(version: str | None = None) -> dict[str, str]:
    """C sources of the binaries as text, by file name.

    Sources for other versions of FMI than `version` are left out; if `version` is None, all are returned.
    """
    other_versions = {f"fmi{other}.c" for other in VERSIONS if version not in (None, other)}
    files = [file for folder in _SOURCES for file in sorted(folder.glob("*.[ch]")) if file.name not in other_versions]
    return {file.name: file.read_text() for file in files}


def compiled_files(files: dict[str, str]) -> list[str]:
    """Names of those C files among `files` (texts by name) that a compiler gets: no other file includes them."""
    included = {name for text in files.values() for name in re.findall(r'#include "(\w+\.c)"', text)}
    return [name for name in files if name.endswith(".c") and name not in included]


def library_bytes(platform: Platform) -> bytes:
    """Bytes of a platform's shared library: the package's file or, without one, compiled by ziglang from its sources.

    Raises InputError if neither the file nor ziglang is installed, or with the first error line of the compiler.
    """
    file = _HERE / "binaries" / platform.folder_3 / f"pmr_fmi{platform.suffix}"
    if file.exists():
        return file.read_bytes()
    environment.check_installed("ziglang")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in source_files().items():
            Path(folder, name).write_text(text)
        library, windows = Path(folder, file.name), platform.suffix == ".dll"
        command = [sys.executable, "-m", "ziglang", "cc", "-target", platform.target, "-mcpu=baseline", *_FLAGS]
        command += [*compiled_files(source_files()), "-o", library.name, *(() if windows else ("-fPIC", "-lm"))]
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if result.returncode:
            lines = [line for line in result.stderr.splitlines() if "error" in line] or ["?"]
            raise InputError("command line", "--to", "fmu", f"no binary for {platform.folder_3}: {lines[0]}")
        return library.read_bytes()


def _platform_folder(platform: Platform, version: str) -> str:
    """Name of the platform's folder in a version of FMI.

    The name is empty if that version does not support the platform.
    """
    return platform.folder_2 if version == "2" else platform.folder_3


@dataclass(frozen=True)
class SystemFile:
    """Bytes of resources/system.pmr, and the token (a hash of the model) that tells it from other models."""

    content: bytes
    token: str


def system_file(
    drivers: Drivers,
    variable_names: Sequence[str],
    start_values: Array,
    nominal: Array,
    omega: float,
    observer: Mapping[str, NDArray[Any]] | None = None,
) -> SystemFile:
    """Pack a system, with the settings of its FMU, as the content of resources/system.pmr.

    Parameters
    ----------
    drivers : Drivers
        System and its N drivers.
    variable_names : sequence of str
        Name of the FMU's variable of each value reference; empty for a reference without a variable.
    start_values : (4 + 4 N,) array
        Start values of t, of the drivers, of their rates of order one to three, and of step, rho_inf and start.
    nominal : (2 r,) array
        Typical sizes of the r modal coordinates, then of their rates.
    omega : float
        Circular frequency in rad/s of contacts that only push (`pmr.simulation.contact_step`); 0 if there are none,
        and with an observer, whose steps are not divided.
    observer : mapping, optional
        Arrays of an observer (`UnitObserver.arrays`); then there is no Model Exchange.
    """
    settings = [omega, contact_step.TOLERANCE, contact_step.RESOLVED, contact_step.MOST_PARTS, BEYOND_ENDS]
    numbers = {name: k for k, name in enumerate(drivers.watchable_names)}
    limits = LimitCheck(watched_limits(drivers.system, numbers), numbers)
    arrays: dict[str, NDArray[Any] | str] = {
        **drivers.data.arrays,
        "unit_start": start_values,
        "unit_nominal": nominal,
        "unit_modes": drivers.data.used_modes,
        "unit_kinds": np.array(drivers.kinds()),
        "unit_settings": np.array(settings, float),
        **{f"unit_limits_{name}": array for name, array in limits.arrays.items()},
        "names_limits": lines([limit.message for limit in limits.limits]),
        "unit_exchange": np.array([drivers.is_differential and not observer]),
        "names_variables": lines(variable_names),
        **(observer or {}),
    }
    digest = hashlib.sha256(pack(arrays)).hexdigest()
    token = "-".join(digest[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32)))
    block = pack(arrays | {"names_token": f"{{{token}}}"})
    seal(block, checksum(block[LINE:]))
    return SystemFile(bytes(block), f"{{{token}}}")
