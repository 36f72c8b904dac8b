"""C compiled for other systems: a program around the kernel says the same under emulators of these."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from kernels import kernel_of
from nested import Nested, reduced

from pmr.kernel.build import FILES, FLAGS
from tools.cross import TARGETS, compile_library

SOURCES = Path(__file__).parents[2] / "pmr" / "kernel" / "src"
HOST = Path(__file__).with_name("host.c")
#: Emulators that run programs of these systems.
EMULATORS = {"aarch64-linux": "qemu-aarch64-static", "x86_64-windows": "wine"}
MAGIC = {"linux": b"\x7fELF", "darwin": b"\xcf\xfa\xed\xfe", "windows": b"MZ"}


def compile_program(target: str, output: Path) -> None:
    files = [str(HOST), *(str(SOURCES / name) for name in FILES)]
    math = [] if target.endswith("windows") else ["-lm"]
    triple = TARGETS[target].triple.replace("gnu.2.17", "musl")  # which is linked into it: an emulator has no other one
    command = [sys.executable, "-m", "ziglang", "cc", "-target", triple, "-mcpu=baseline", *FLAGS]
    subprocess.run([*command, "-fno-sanitize=undefined", f"-I{SOURCES}", *files, *math, "-o", str(output)], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("target", EMULATORS)
def test_a_program_steps_alike_on_other_systems(target: str, tmp_path: Path) -> None:
    if not (emulator := shutil.which(EMULATORS[target])):
        pytest.skip(f"{EMULATORS[target]} is needed")
    kernel, _ = kernel_of(reduced(Nested(3, elements=8, clearance=2e-4, compliance=1e-7), 3))
    (tmp_path / "system.bin").write_bytes(kernel.block)
    outputs = []
    for system, run in (("x86_64-linux", ()), (target, (emulator,))):
        program = tmp_path / f"{system}.exe"
        compile_program(system, program)
        settings = {"PMR_KERNEL_BASELINE": "1", "WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"}
        done = subprocess.run(
            [*run, str(program), str(tmp_path / "system.bin")],
            env=os.environ | settings, stdin=subprocess.PIPE, capture_output=True, text=True, check=True,
        )  # fmt: skip
        outputs.append(done.stdout.split())
    here, there = (np.array(output[1:], float) for output in outputs)
    assert len(here) == kernel.modes and np.abs(here).max() > 0.0
    assert there == pytest.approx(here, rel=1e-9, abs=1e-9 * np.abs(here).max())


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_a_library_for_each_system(target: str, tmp_path: Path) -> None:
    if target.endswith("windows") and os.environ.get("PMR_SWEEP") != "full":
        pytest.skip("zig makes its library for Windows first: PMR_SWEEP=full takes it")
    source, library = tmp_path / "one.c", tmp_path / f"one{TARGETS[target].library}"
    exported = "__declspec(dllexport)" if target.endswith("windows") else '__attribute__((visibility("default")))'
    source.write_text(f"#include <math.h>\n{exported} double cube_root(double x) {{ return cbrt(x); }}\n")
    compile_library(target, [source], library)
    content = library.read_bytes()
    assert content.startswith(MAGIC[target.partition("-")[2]]) and b"cube_root" in content
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.c", library.name]
