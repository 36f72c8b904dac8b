"""Plugin of pytest (``-p sanitized``): the kernel is tested as `make test-sanitized` built it, not the package's."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

(library,) = Path("build", "sanitized").glob("**/_native*.so")
spec = importlib.util.spec_from_file_location("pmr.kernel._native", library.resolve())
assert spec is not None and spec.loader is not None
sys.modules["pmr.kernel._native"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["pmr.kernel._native"])
