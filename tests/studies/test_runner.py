from __future__ import annotations

import pytest

from pmr.cli import study as cli_study
from pmr.errors.text import duration_text
from pmr.studies.call import Progress


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (90.0, "2 min"), (3599.0, "60 min"), (9000.0, "2.5 h")]
)
def test_seconds_are_said_as_people_say_them(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_progress_in_one_line() -> None:
    assert Progress(0, 0, 9, 1.0, None).text == "0 of 9 tasks done after 1 s"
    assert Progress(3, 2, 9, 60.0, 120.0).text == "3 of 9 tasks done, 2 failed or skipped after 1 min, about 2 min left"
    assert Progress(1, 0, 9, 1.0, None, ("row1", "row2")).text == "1 of 9 tasks done after 1 s; now row1, row2"
    assert Progress(9, 0, 9, 60.0, 0.0).text == "9 of 9 tasks done after 1 min"


def test_a_log_gets_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now = 100.0
    monkeypatch.setattr("pmr.cli.study.time.monotonic", lambda: now)
    with cli_study._show_progress() as watch:
        for _ in range(100):
            now += 1.0
            watch(Progress(1, 0, 2, now - 100.0, now))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [
        f"1 of 2 tasks done after {text}" for text in ("30 s", "1 min", "2 min")
    ]
