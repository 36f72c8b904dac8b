"""Build of the kernel in C, and the scenes that a wheel carries; all else stands in pyproject.toml.

The compiler of the system is taken for the system itself.  Where there is none, and for another system, which the
environment variable PMR_TARGET names (`tools.cross.TARGETS`), that of ziglang is, a requirement of the build.
"""

import os
import shutil
import sys
import sysconfig

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from tools import cross  # noqa: E402  (a build in isolation does not look for modules here)

COMPILER = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
#: The system that zig compiles for; none where the compiler of this one does.
TARGET = os.environ.get("PMR_TARGET") or (None if shutil.which(COMPILER) else cross.host())


FMI = os.path.join("pmr", "export", "fmi")


class BuildKernel(build_ext):
    """The extension module of the kernel, and the library of FMUs with the same code; by zig where that is to be."""

    def get_ext_filename(self, fullname: str) -> str:
        if TARGET is None:
            return super().get_ext_filename(fullname)
        return os.path.join(*fullname.split(".")) + cross.TARGETS[TARGET].extension

    def build_extension(self, ext) -> None:
        library = os.path.join(self.build_lib, _library(TARGET or cross.host()))
        self.mkpath(os.path.dirname(library))
        kernel = [name for name in ext.sources if name.startswith(os.path.join("pmr", "kernel", "src"))]
        units = [
            os.path.join(FMI, "source", f"{name}.c")
            for name in ("fmi2", "fmi3", "shared", "unit", "estimator", "variables")
        ]
        if TARGET is None:
            super().build_extension(ext)
            objects = self.compiler.object_filenames(kernel, output_dir=self.build_temp)
            if not all(map(os.path.exists, objects)):  # the extension module is up to date
                units, objects = kernel + units, []
            objects += self.compiler.compile(
                units, self.build_temp, include_dirs=ext.include_dirs, extra_postargs=ext.extra_compile_args
            )
            stripped = ["-Wl,-s"] if sys.platform == "linux" else []
            self.compiler.link_shared_object(objects, library, libraries=ext.libraries, extra_postargs=stripped)
            return
        output = self.get_ext_fullpath(ext.name)
        os.makedirs(os.path.dirname(output), exist_ok=True)
        cross.compile_extension(TARGET, ext.sources, output, ext.include_dirs, ext.extra_compile_args, self.build_temp)
        for system in cross.TARGETS if "PMR_TARGET" in os.environ else [TARGET]:  # a wheel has FMUs for all systems
            library = os.path.join(self.build_lib, _library(system))
            self.mkpath(os.path.dirname(library))
            cross.compile_library(system, kernel + units, library, ext.include_dirs, ext.extra_compile_args)

    def copy_extensions_to_source(self) -> None:
        super().copy_extensions_to_source()
        library = _library(TARGET or cross.host())
        self.mkpath(os.path.dirname(library))
        self.copy_file(os.path.join(self.build_lib, library), library)


def _library(system: str) -> str:
    """Where the library of FMUs for a system is, from the folder of the package on."""
    suffix = {"windows": ".dll", "darwin": ".dylib"}.get(system.rpartition("-")[2], ".so")
    return os.path.join(FMI, "binaries", system, f"pmr_fmi{suffix}")


class BuildWithWorkflows(build_py):
    """Python files, and the workflows beside them: `pmr run paper_simple` works wherever pmr is installed."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            target = os.path.join(self.build_lib, "pmr", "workflows")
            shutil.copytree("workflows", target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))


class StableWheel(bdist_wheel):
    """A wheel for all versions of Python from the lowest on that pmr runs with."""

    def finalize_options(self) -> None:
        self.py_limited_api = "cp311"
        if "PMR_TARGET" in os.environ:
            self.plat_name = cross.TARGETS[os.environ["PMR_TARGET"]].wheel
        super().finalize_options()


setup(
    cffi_modules=["pmr/kernel/build.py:ffi"],
    cmdclass={"build_ext": BuildKernel, "build_py": BuildWithWorkflows, "bdist_wheel": StableWheel},
)
