"""Where what serves again is cached for a user."""

from __future__ import annotations

import os
from pathlib import Path

from pmr.files import whole


def test_the_oldest_files_go_and_no_folder_is_no_error(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PMR_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(whole, "MOST_KEPT", 2)
    folder = whole.user_cache_folder()
    assert folder == tmp_path / "kept"
    for age, name in enumerate("cba"):
        (folder / f"{name}.npz").touch()
        os.utime(folder / f"{name}.npz", (age, age))
    assert whole.user_cache_folder() is not None and sorted(file.name for file in folder.iterdir()) == [
        "a.npz",
        "b.npz",
    ]
    (tmp_path / "file").touch()
    monkeypatch.setenv("PMR_CACHE", str(tmp_path / "file" / "kept"))
    assert whole.user_cache_folder() is None
