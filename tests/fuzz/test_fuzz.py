"""Whatever is in a file: it runs to results that can be, or it is refused in one line with exit code 2, in a minute.

`PMR_SWEEP=full` judges all mutations, which takes an hour; otherwise the first of each kind.  One of them alone, by its
number: ``python -m fuzz.worker scenes 136 137`` in this folder's parent.
"""

import os

import pytest
from fuzz import faults
from fuzz.drive import summary, verdicts

ALL = {"scenes": 3000, "studies": 500, "models": 500, "meshes": 200, "names": 100, "structures": 600, "booms": 400}
FIRST = {"scenes": 12, "studies": 20, "models": 20, "meshes": 7, "names": 1, "structures": 8, "booms": 2}
COUNTS = ALL if os.environ.get("PMR_SWEEP") == "full" else FIRST


def test_every_kind_of_fault_is_seen_and_the_rest_goes_on() -> None:
    found = list(verdicts("faults", len(faults.KINDS)))
    assert [verdict.kind for verdict in found] == faults.KINDS
    assert [verdict.number for verdict in found] == list(range(len(faults.KINDS)))
    assert "--- 2: traceback" in summary(found) and "KeyError" in summary(found)


@pytest.mark.slow
@pytest.mark.parametrize("kind", COUNTS)
def test_every_mutation_runs_or_is_refused_in_one_line(kind: str) -> None:
    found = list(verdicts(kind, COUNTS[kind]))
    print(summary(found))
    assert len(found) == COUNTS[kind]
    assert all(verdict.is_sound for verdict in found), summary(found)
    assert sum("grows without bound" in verdict.detail for verdict in found) <= len(found) / 50  # a remarkable thing
    kinds = {verdict.kind for verdict in found}
    assert "ran" in kinds and ("refused" in kinds or kind == "names")  # neither all nor nothing; a name is no reason
