"""Matrices that Ansys writes by HBMAT: in the format of Harwell and Boeing, with a mapping file of their rows."""

from __future__ import annotations

import re
from io import StringIO
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

from pmr.files.arrays import Indices
from pmr.files.deck_content import is_label_number
from pmr.files.labelled import UnreadableError

#: Names of degrees of freedom, in the order of directions.
NAMES = ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")


def read_harwell_boeing(path: Path) -> sp.csr_matrix:
    """Read a matrix in the format of Harwell and Boeing, of one triangle (RSA) or of all entries (RUA).

    The entries are those of the file.  Right-hand sides, which HBMAT adds to a stiffness, are left out.  Raises
    UnreadableError for other types.
    """
    title, sizes, kind, formats, *lines = path.read_text(encoding="ascii").splitlines()
    if kind[:3].upper() not in ("RSA", "RUA"):
        raise UnreadableError(f"real assembled matrices, RSA or RUA, are allowed, not {kind[:3]!r}", 3)
    if int(sizes[56:70] or 0):
        lines = lines[1 : 1 + sum(int(sizes[k : k + 14]) for k in (14, 28, 42))]
    formats = re.sub(r"\d?P,?", "", formats.upper()).replace("D", "E")
    head = f"{title:<72}", f"{sizes[:56]}{0:>14}", f"RUA{kind[3:]:<67}", f"{formats[:52]:<72}"
    body = [re.sub(r"(?<=[\d.])[dD](?=[+-])", "E", line) for line in lines]
    return sp.csr_matrix(scipy.io.hb_read(StringIO("\n".join([*head, *body, ""]))))


def read_mapping(path: Path) -> Indices:
    """Read node and direction (n, 2) of each row from the mapping file of Ansys's HBMAT.

    Its lines have row, node and name of a degree of freedom.  Raises UnreadableError with the number of a line of
    another form, or for rows that are not 1, 2 and so on.
    """
    pairs = list[tuple[int, int]]()
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        parts = line.split()
        if not parts or (not pairs and not parts[0].isdigit()):
            continue  # the headings
        row = len(pairs) + 1
        if len(parts) != 3 or parts[0] != str(row) or not is_label_number(parts[1]) or parts[2] not in NAMES:
            raise UnreadableError(f"row {row}, a node and one of {', '.join(NAMES)} are allowed", number)
        pairs.append((int(parts[1]), NAMES.index(parts[2]) + 1))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
