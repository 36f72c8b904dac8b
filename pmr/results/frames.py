"""Results as frames of pandas."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from pmr.errors import InputError
from pmr.errors.environment import needed
from pmr.files.whole import finish_swap
from pmr.results.run import RunResult
from pmr.results.tables import tables

if TYPE_CHECKING:
    from pandas import DataFrame


def load(folder: str | Path) -> dict[str, DataFrame]:
    """Results of a run or a study in a folder, as frames of pandas by name; names of columns have the units.

    Of a run these are its tables (`pmr.results.tables`), and the histories of each simulator over the time in s, under
    the name of the simulator.  A study has ``runs`` and ``seconds``.  A collection has the frames of all its studies,
    such as ``<study>/runs``.

    Raises
    ------
    InputError
        If there are no results in the folder, or pandas is not installed.
    """
    folder, pandas = Path(folder), needed("pandas")
    finish_swap(folder)
    if not (folder / "summary.json").is_file():
        raise InputError(str(folder), "", None, "a folder that `pmr run` or `pmr study` wrote results to is allowed")
    if (folder / "runs.csv").is_file():
        return {name: pandas.read_csv(folder / f"{name}.csv") for name in ("runs", "seconds")}
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    if "studies" in summary:
        return {
            f"{study}/{name}": frame for study in summary["studies"] for name, frame in load(folder / study).items()
        }
    result = RunResult.load(folder)
    frames = {
        name: pandas.DataFrame(list(table.rows), columns=list(table.columns)) for name, table in tables(result).items()
    }
    for name, response in result.responses.items():
        index = pandas.Index(response.t, name="t [s]")
        columns = {
            column: values
            for array, names in response.columns.items()
            if (values_of := getattr(response, array)) is not None
            for column, values in zip(names, values_of.T, strict=True)
        }
        frames[name] = pandas.DataFrame(columns, index=index)
    return frames
