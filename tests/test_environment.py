from __future__ import annotations

import pytest

from pmr import environment


def test_the_code_digest_changes_with_sources_and_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = environment.code_digest()
    assert environment.code_digest() == whole
    without = environment.code_digest(leave_out=("report/",))
    assert without not in (whole, environment.code_digest(leave_out=("report/", "cli")))
    monkeypatch.setattr(environment, "_NUMERICAL", ("numpy",))
    assert environment.code_digest() != whole
