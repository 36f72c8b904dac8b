"""Fixtures of searches for a model and a step."""

import pytest

from pmr.compare import trials


@pytest.fixture
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """End a search at few steps, where a test asks for more than any number of them gives."""
    monkeypatch.setattr(trials, "LONGEST", 8_000)
    monkeypatch.setattr(trials, "LONGEST_OF_SEVERAL", 1_600)
