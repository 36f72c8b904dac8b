"""What a run of a boom of several sections leaves behind, kept in a folder like that of one body."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fields.series import Fields
from pmr.files import jsonfile, npz, records
from pmr.files.swap import finished
from pmr.results.run import Response
from pmr.scene import Boom

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FrequencyMap:
    """First natural frequency (A, B) in Hz of a reduced boom over the extensions (A,) and (B,) in m of two joints."""

    joints: tuple[str, ...]
    first: Array
    second: Array
    lowest: Array


@dataclass(frozen=True)
class BoomFrequencies:
    """Lowest natural frequencies in Hz, (S, f) by model, where a boom reaches so far, (S,) m, by such extensions.

    Every contact is closed; `extensions` (S, P) in m are in the order of the sections.  `over_joints` is there where
    two joints move each on a path of its own.
    """

    reach: Array
    extensions: Array
    models: Mapping[str, Array]
    over_joints: FrequencyMap | None = None


@dataclass(frozen=True)
class BoomResult:
    """All of one run of a boom of several sections.

    `responses` is keyed by model, ``reduced`` and, as asked, ``full``; columns of displacements are called by section
    and place, those of forces by contact.  `summary` is what summary.json holds, as for one body, and
    ``sections`` (name, coordinates, errors), ``pads`` and ``cylinders`` (name, min, max in N, when).
    """

    scene: Boom
    summary: dict[str, Any]
    responses: Mapping[str, Response]
    extensions: Array  # (T, P) m, in the order of the sections but the base
    reach: Array  # of the tip from the base's tail, (T,) m
    loads: Array  # (T, i), as the system names its inputs
    frequencies: BoomFrequencies
    fields: Mapping[str, Fields] = field(default_factory=dict)  # by section, in its own frame

    @property
    def travelling(self) -> dict[str, tuple[Fields, Array]]:
        """Fields of each section, and where its tail is along the boom at their times, m."""
        t, tails = self.responses["reduced"].t, np.cumsum(self.extensions, axis=1)
        tails = np.hstack([np.zeros((len(t), 1)), tails])
        return {
            name: (self.fields[name], np.interp(self.fields[name].t, t, tail))
            for name, tail in zip(self.scene.names, tails.T, strict=True)
        }

    def save(self, folder: Path) -> None:
        """Write scene.json, summary.json and trajectories.npz into `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.json").write_text(self.scene.model_dump_json(indent=1, exclude={"section"}), encoding="utf-8")
        (folder / "summary.json").write_text(jsonfile.text(self.summary, indent=1), encoding="utf-8")
        arrays: dict[str, NDArray[Any]] = {"extensions": self.extensions, "reach": self.reach, "loads": self.loads}
        arrays |= records.arrays(self.frequencies, "frequencies.")
        columns = {
            f"{model}.{key}": names for model, one in self.responses.items() for key, names in one.columns.items()
        }
        columns["extensions"] = [f"{name} [m]" for name in self.scene.names[1:]]
        arrays["columns"] = np.array(jsonfile.text(columns))
        for model, response in self.responses.items():
            arrays |= records.arrays(response, f"{model}.")
        npz.write(folder / "trajectories.npz", arrays)
        for name, fields in self.fields.items():
            fields.save(folder / f"fields-{name}.npz")

    @classmethod
    def load(cls, folder: Path) -> BoomResult:
        """Read what `save` wrote."""
        finished(folder)
        data = npz.read(folder / "trajectories.npz")
        models = sorted({key.split(".")[0] for key in data if key.endswith(".displacement")})
        return cls(
            scene=Boom.model_validate_json((folder / "scene.json").read_text(encoding="utf-8")),
            summary=json.loads((folder / "summary.json").read_text(encoding="utf-8")),
            responses={model: records.record(Response, data, f"{model}.") for model in models},
            extensions=data["extensions"],
            reach=data["reach"],
            loads=data["loads"],
            frequencies=records.record(BoomFrequencies, data, "frequencies."),
            fields={
                file.stem.removeprefix("fields-"): Fields.load(file) for file in sorted(folder.glob("fields-*.npz"))
            },
        )
