"""Messages are counted exactly: a program whose messages are known, and the page of made-up records."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from waiting import PATIENCE

from benchmarks import messages, page_of_scale
from benchmarks.messages_run import KINDS
from benchmarks.ranks import Bounds, record_of

KNOWN = """
import ctypes, json, sys
counting = ctypes.CDLL(sys.argv[1], ctypes.RTLD_GLOBAL).pmr_messages
import numpy as np
from mpi4py import MPI
comm, before, after = MPI.COMM_WORLD, (ctypes.c_longlong * 5)(), (ctypes.c_longlong * 5)()
other, doubles = 1 - comm.rank, np.zeros(100)
answer = np.zeros(100)
counting(before)
comm.Sendrecv(doubles, other, recvbuf=answer, source=other)  # 800 bytes
sending = comm.Send_init(doubles[:50], other)
receiving = comm.Recv_init(answer[:50], other)
for _ in range(3):  # 400 bytes each
    receiving.Start(), sending.Start(), receiving.Wait(), sending.Wait()
comm.Isend(doubles[:1], comm.rank).Free(), comm.Recv(answer[:1], comm.rank)  # to itself: none
comm.Allreduce(doubles[:3], answer[:3])  # 24 bytes
comm.Alltoallv([doubles[:5], ([2, 3] if comm.rank else [3, 2])], [answer[:5], ([2, 3] if comm.rank else [3, 2])])  # 16
kind = MPI.DOUBLE.Create_vector(4, 1, 2).Commit()
comm.Alltoallw([doubles, ([1, 1], [0, 400]), [kind, kind]], [answer, ([1, 1], [0, 400]), [kind, kind]])  # 32
MPI.COMM_SELF.Allreduce(doubles, answer)  # alone: none
counting(after)
found = comm.gather([b - a for a, b in zip(before, after)])
if comm.rank == 0:
    print(json.dumps({"found": found}))
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("mpicc") is None, reason="no MPI compiler")
def test_what_is_sent_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "known.py").write_text(KNOWN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    record = record_of("known", [str(messages.library(tmp_path))], 2, Bounds(PATIENCE))
    assert record["found"] == [[4, 800 + 3 * 400, 3, 24 + 16 + 32, 0]] * 2, json.dumps(record)


def test_the_page_shows_the_rank_with_most() -> None:
    def rank(columns: int, sent: int) -> dict:
        counts = dict.fromkeys(KINDS, 0) | {"messages": 10, "message_bytes": sent, "collectives": 4}
        return {"stages": {"modes": [*counts.values(), 1, columns]}, "loaded_MB": 100.0, "peak_MB": 180.0}

    record = {"cells": 0.1, "size": 20_000, "ranks": 4, "each": [rank(90, 5000), rank(94, 7000)]}
    assert messages.total(record, "columns") == 94 and messages.sent(record) == 7000
    # Ten messages and four collective calls of two rounds each.
    assert messages.seconds(record, 1e-3, 1e6) == pytest.approx(18e-3 + 7e-3, rel=1e-12)
    grid = page_of_scale.shares({"records": [record]}, "x").blocks[0].grids[0]
    assert grid.rows[0][:4] == ("free modes", "94", "10", "4")
