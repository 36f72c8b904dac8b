"""Run comparisons with other programs only on request: ``pytest -m peers``."""

import pytest


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip comparisons with other programs unless the option ``-m`` names them."""
    if "peers" not in config.getoption("-m"):
        for item in items:
            if "peers" in item.keywords:
                item.add_marker(pytest.mark.skip(reason="comparisons with other programs run with -m peers"))
