"""Where what serves again is cached for a user."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

#: Files in the folder, two a measurement.
MOST_KEPT = 100


def users_folder() -> Path | None:
    """Cache folder of a user for measurements of structures: ``$PMR_CACHE``, or ``pmr`` in ``~/.cache``.

    Of files beyond `MOST_KEPT` the oldest are removed.  None where there can be no such folder.
    """
    folder = Path(os.environ.get("PMR_CACHE") or Path.home() / ".cache" / "pmr")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    with contextlib.suppress(OSError):  # what can't be listed or removed stays
        files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime)
        for file in files[:-MOST_KEPT]:
            file.unlink()
    return folder
