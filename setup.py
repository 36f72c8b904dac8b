"""Build of the kernel in C, and the scenes that a wheel carries; all else stands in pyproject.toml.

Where no compiler is, the one of ziglang, a requirement of the build, is taken.
"""

import os
import platform
import shutil
import sys
import sysconfig

from setuptools import setup
from setuptools.command.build_ext import build_ext
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


FMI = os.path.join("pmr", "export", "fmi")


class BuildWithUnits(build_ext):
    """The kernel's extension module, and the library of FMUs: the interface in C, with the same object code."""

    def build_extension(self, ext) -> None:
        super().build_extension(ext)
        sources = [os.path.join(FMI, "source", f"{name}.c") for name in ("fmi2", "fmi3", "shared", "unit", "variables")]
        kernel = [name for name in ext.sources if name.startswith(os.path.join("pmr", "kernel", "src"))]
        objects = self.compiler.object_filenames(kernel, output_dir=self.build_temp)
        if not all(map(os.path.exists, objects)):
            sources, objects = kernel + sources, []
        objects += self.compiler.compile(
            sources, self.build_temp, include_dirs=ext.include_dirs, extra_postargs=ext.extra_compile_args
        )
        library = os.path.join(self.build_lib, self.library)
        self.mkpath(os.path.dirname(library))
        self.compiler.link_shared_object(objects, library, libraries=ext.libraries)

    def copy_extensions_to_source(self) -> None:
        super().copy_extensions_to_source()
        self.mkpath(os.path.dirname(self.library))
        self.copy_file(os.path.join(self.build_lib, self.library), self.library)

    @property
    def library(self) -> str:
        """Where the library of this system is, from the folder of the package on."""
        system, processor = platform.system().lower(), platform.machine().lower()
        folder = "-".join(({"amd64": "x86_64", "arm64": "aarch64"}.get(processor, processor), system))
        suffix = {"windows": ".dll", "darwin": ".dylib"}.get(system, ".so")
        return os.path.join(FMI, "binaries", folder, f"pmr_fmi{suffix}")


setup(
    cffi_modules=["pmr/kernel/build.py:ffi"],
    cmdclass={"build_ext": BuildWithUnits, "build_py": BuildWithWorkflows},
)
