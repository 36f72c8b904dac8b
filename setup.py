"""Build of the kernel in C, and the scenes that a wheel carries; all else stands in pyproject.toml.

Where no compiler is, the one of ziglang, a requirement of the build, is taken.
"""

import os
import platform
import shutil
import sys
import sysconfig

from setuptools import setup
from setuptools.command.build_py import build_py

compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
if not shutil.which(compiler):
    # for any processor of its kind: zig compiles for the one it runs on by default
    own = {"x86_64": " -mcpu=x86_64", "aarch64": " -mcpu=generic"}.get(platform.machine(), "")
    os.environ["CC"] = f"{sys.executable} -m ziglang cc{own}"
    os.environ["LDSHARED"] = f"{sys.executable} -m ziglang cc{own} -shared"
    os.environ["LDCXXSHARED"] = os.environ["LDSHARED"]


class BuildWithWorkflows(build_py):
    """Python files, and the workflows beside them: `pmr run paper_simple` works wherever pmr is installed."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            target = os.path.join(self.build_lib, "pmr", "workflows")
            shutil.copytree("workflows", target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))


setup(cffi_modules=["pmr/kernel/build.py:ffi"], cmdclass={"build_py": BuildWithWorkflows})
