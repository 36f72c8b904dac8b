"""Other programs are asked only when that is what was asked for: ``pytest -m peers``."""

from __future__ import annotations

import pytest


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if "peers" not in config.getoption("-m"):
        for item in items:
            if "peers" in item.keywords:
                item.add_marker(pytest.mark.skip(reason="comparisons with other programs run with -m peers"))
