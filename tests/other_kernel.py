"""Plugin of pytest (``-p other_kernel``) that loads the kernel from the folder PMR_KERNEL, not the package's."""

import importlib.util
import os
import sys
from pathlib import Path

(library,) = Path(os.environ["PMR_KERNEL"]).glob("**/_native*.so")
spec = importlib.util.spec_from_file_location("pmr.kernel._native", library.resolve())
assert spec is not None and spec.loader is not None
sys.modules["pmr.kernel._native"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["pmr.kernel._native"])
