"""A body alone with second order in studies: followed where it is, refused in one line where it is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.studies import shared
from pmr.studies.kinds.scenes import Study, run_case

CANTILEVER = Path(__file__).parents[1] / "pipeline" / "cantilever.toml"


def test_kinds_that_do_not_follow_it_refuse_a_body_alone_with_second_order() -> None:
    with pytest.raises(InputError, match=r"frame.second_order = True: false is allowed in a study of a body") as said:
        shared.refuse_second_order(scenes.load_any(CANTILEVER, []))
    assert "\n" not in str(said.value)
    shared.refuse_second_order(scenes.load_any(CANTILEVER, ["frame.second_order=false"]))


@pytest.mark.slow
def test_runs_of_scenes_follow_it() -> None:
    plan = Study(kind="scenes", title="columns", scenes=(CANTILEVER,)).plan()
    assert [task.function for task in plan.runs] == [run_case]
    record = run_case(plan.runs[0].arguments, {}).record
    assert record["coordinates.reduced"] == 14  # two of them without inertia
