from __future__ import annotations

import os

import blas
import numpy as np
import pytest
import scipy.linalg

from pmr import environment
from pmr.fem.compat import PETSc


def test_the_code_digest_changes_with_sources_and_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    files = {"run.py": "a = 1", "report/page.py": "b = 2", "cli.py": "c = 3"}
    whole = environment.code_digest(files)
    assert environment.code_digest(dict(reversed(files.items()))) == whole
    without = environment.code_digest(files, ("report/",))
    assert without not in (whole, environment.code_digest(files, ("report/", "cli")))
    assert without == environment.code_digest(files | {"report/page.py": "b = 4"}, ("report/",))
    assert whole != environment.code_digest(files | {"report/page.py": "b = 4"})
    monkeypatch.setattr(environment, "_NUMERICAL", ("numpy",))
    assert environment.code_digest(files) != whole


@pytest.mark.mpi
def test_every_blas_computes_by_the_kernel_that_was_asked_for() -> None:
    """One that the library doesn't have would be passed over in silence, and one kernel tested twice."""
    asked = os.environ.get("OPENBLAS_CORETYPE")
    assert scipy.linalg.det(np.eye(2)) == 1.0 and PETSc.Sys.getVersion()  # NumPy's, SciPy's and PETSc's are loaded
    assert not asked or {library.kernel for library in blas.loaded()} == {asked}
