from __future__ import annotations

import pytest
from oracle import CASES, Case, full_body, paper_basis, project, rich_body

from pmr.body import FullBody
from pmr.reduced import ReducedModel


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    """The paper's test cases."""
    return CASES[request.param]


@pytest.fixture(scope="session")
def full() -> FullBody:
    """The paper's full model: 50 elements, 153 coordinates."""
    return full_body(elements=50)


@pytest.fixture(scope="session")
def reduced(full: FullBody) -> ReducedModel:
    """The paper's reduced model: (5, 6) snapshots, 20 coordinates."""
    return project(full, paper_basis(full, snapshots=5, modes=6, coordinates=20))


@pytest.fixture(scope="session")
def rich() -> FullBody:
    """Damping, two sliders and two inputs, sparse."""
    return rich_body()
