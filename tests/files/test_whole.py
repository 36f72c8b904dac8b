from __future__ import annotations

import errno
from pathlib import Path

import pytest

from pmr.files.whole import NotWrittenError, replacement_file


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with replacement_file(file) as part:
        part.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new" and list(tmp_path.iterdir()) == [file]


def test_a_disk_that_is_only_read_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There neither a file can be made nor one that is not there be removed."""

    def refused(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(NotWrittenError, match="file could not be written: Read-only file system"):
        with replacement_file(tmp_path / "file") as part:
            refused(part)


@pytest.mark.parametrize(
    ("error", "seen"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), NotWrittenError),
        (FileNotFoundError(errno.ENOENT, "no such file"), FileNotFoundError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_whatever_goes_wrong_leaves_the_old_file_and_no_part(tmp_path: Path, error: BaseException, seen: type) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with pytest.raises(seen) as caught, replacement_file(file) as part:
        part.write_text("half")
        raise error
    assert file.read_text() == "old" and list(tmp_path.iterdir()) == [file]
    if seen is NotWrittenError:
        assert str(caught.value) == f"{file} could not be written: No space left on device"
