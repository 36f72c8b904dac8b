"""A process that works beside this one: the same answers, and nothing of it is left, however a run ends."""

from __future__ import annotations

import gc
import math
import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from waiting import PATIENCE, wait_until

from pmr.errors import aside, environment
from pmr.errors.aside import Aside, worked_aside


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process works, though this one could."""
    monkeypatch.setattr(aside, "_saves_time", lambda: True)


@pytest.mark.usefixtures("apart")
def test_answers_come_in_any_order_and_from_there() -> None:
    with worked_aside() as other:
        first, process, wrong = other.done(math.hypot, 3.0, 4.0), other.done(os.getpid), other.ask(math.sqrt, -1.0)
        large = other.ask(bytes, 1 << 20)
        assert large() == (True, bytes(1 << 20)) and wrong() == (False, None)
        assert process() == other.process.pid and first() == 5.0 == first()
        with pytest.raises(ValueError, match="math domain"):
            other.done(math.sqrt, -1.0)()  # here, where who asks sees it


@pytest.mark.usefixtures("apart")
def test_the_process_does_not_look_through_what_it_has_from_this_one_for_garbage() -> None:
    with worked_aside() as other:
        assert other.done(gc.get_threshold)()[0] > 700 and other.done(gc.get_freeze_count)() > 10_000


@pytest.mark.usefixtures("apart")
def test_work_goes_on_while_nobody_asks_for_a_large_answer(tmp_path: Path) -> None:
    with worked_aside() as other:
        other.ask(bytes, 1 << 20)  # more than the way there holds
        other.ask(os.mkdir, tmp_path / "done")
        wait_until((tmp_path / "done").exists)


@pytest.mark.parametrize("other", [Aside(), None], ids=["none", "killed"])
def test_without_the_process_all_is_done_here(other: Aside | None) -> None:
    signals = list[int]()
    before = signal.signal(signal.SIGPIPE, lambda number, _: signals.append(number))
    other = other or Aside.started()
    waiting = other.done(math.hypot, 3.0, 4.0) if other.process is None else other.done(time.sleep, PATIENCE)
    if other.process is not None:
        other.process.kill()
        other.process.join()
        waiting = other.done(math.hypot, 3.0, 4.0)
    assert other.done(os.getpid)() == os.getpid()
    assert waiting() == 5.0
    other.close()
    signal.signal(signal.SIGPIPE, before)
    assert not signals  # which would have ended this process: PETSc sets them as the system has them


@pytest.mark.usefixtures("apart")
def test_no_process_is_left() -> None:
    with worked_aside() as other:
        left = other.process
        other.there.close()  # as the system does with whatever ends its parent
        left.join(PATIENCE)
        assert left.exitcode == -signal.SIGKILL
    with pytest.raises(KeyboardInterrupt), worked_aside() as other:
        left = other.process
        other.ask(time.sleep, PATIENCE)
        raise KeyboardInterrupt
    assert left.exitcode == -signal.SIGKILL
    with worked_aside(wanted=False) as other:
        assert other.process is None


@pytest.mark.parametrize("loaded", ["", *aside.TOO_LATE])
@pytest.mark.parametrize(("launched", "cores", "threads"), [(1, 2, 1), (2, 2, 1), (1, 1, 1), (1, 2, 2)])
def test_a_process_is_copied_only_where_it_is_alone(
    monkeypatch: pytest.MonkeyPatch, loaded: str, launched: int, cores: int, threads: int
) -> None:
    modules: dict[str, Any] = {loaded: aside}
    monkeypatch.setattr(environment, "launched", lambda: launched)
    monkeypatch.setattr(environment, "cores", lambda: cores)
    monkeypatch.setattr(aside.threading, "active_count", lambda: threads)
    monkeypatch.setattr(aside, "sys", SimpleNamespace(platform="linux", modules=modules))
    assert aside._saves_time() == ((loaded, launched, cores, threads) == ("", 1, 2, 1))
