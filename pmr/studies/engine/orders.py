"""What goes to a worker's child process and what comes back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Order:
    """A task as text: what to call, with what, and where results are.

    `code` is the digest of the sources that it was planned for; empty where any will do.
    """

    key: str
    digest: str
    address: str
    arguments: Mapping[str, Any]
    needs: Mapping[str, str]  # name for the function -> digest
    store: str
    code: str = ""


@dataclass(frozen=True)
class Answer:
    """How it went; the result itself is in the store.

    `reason` is one line, the same wherever the task fails; `detail` is what helps to find out why.
    """

    status: Literal["done", "failed"]
    seconds: float
    reason: str = ""
    detail: str = ""
