"""The sources alone: no warnings, no names that others could have, the same results on every kind of processor."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pmr.kernel import build
from pmr.kernel.build import FILES, FLAGS, declarations

SOURCES = Path(__file__).parents[2] / "pmr" / "kernel" / "src"
COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="a C compiler is needed")
RUN = """
import sys
import numpy as np
from kernels import kernel_of
from nested import Nested, reduced
from pmr.kernel.kernel import code_variant
from pmr.kernel.state import Settings, State
system = reduced(Nested(3, elements=8, clearance=2e-4, compliance=1e-7), 3)
kernel, _ = kernel_of(system)
state = State(kernel, Settings(1e-3, 0.8, parts=(1, 2, 4), contact_omega=1e3))
state.start("rest", [2.0, 2.1, *np.zeros(kernel.inputs)])
rows = []
for n in range(1, 60):
    state.step([2.0 + 1e-4 * n, 2.1 + 2e-4 * n, *np.full(kernel.inputs, 2e3 * np.sin(0.05 * n))])
    rows.append([*state.z, *state.multipliers, *state.energy, *state.outputs()[0]])
np.save(sys.argv[1], np.array(rows))
print(code_variant())
"""


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("flags", [["-O1"], ["-DPMR_PLAIN", "-O0"]], ids=["vectors", "plain"])
def test_sources_compile_without_a_warning_and_export_what_the_header_declares(
    tmp_path: Path, flags: list[str]
) -> None:
    library = tmp_path / "kernel.so"
    files = [str(SOURCES / name) for name in FILES]
    command = [str(COMPILER), *FLAGS, "-Werror", "-fvisibility=default", *flags, "-fPIC", "-shared", *files]
    subprocess.run([*command, "-o", str(library), "-lm"], check=True)
    names = subprocess.run(
        ["nm", "-D", "--defined-only", str(library)], check=True, capture_output=True, text=True
    ).stdout.split()[2::3]
    own = [name for name in names if name not in ("_init", "_fini")]
    assert all(name.startswith("pmr_") for name in own)
    declared = set(re.findall(r"\b(pmr_\w+)\(", declarations((SOURCES / "pmr_kernel.h").read_text())))
    assert declared <= set(own) and len(declared) > 20


def test_tests_stop_where_the_compiled_kernel_is_older_than_its_sources(
    pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    conftest = pytestconfig.pluginmanager.get_plugin(str(Path(__file__).parents[1] / "conftest.py"))
    configure = conftest.pytest_configure
    configure()
    for file in SOURCES.glob("*.[ch]"):
        shutil.copy(file, tmp_path)
    monkeypatch.setattr(build, "SOURCES", tmp_path)
    configure()
    law = tmp_path / "law.h"
    law.write_text(law.read_text().replace("exp(-speed", "exp(-2.0 * speed"))
    with pytest.raises(pytest.exit.Exception, match="run setup.py build_ext --inplace"):
        configure()
    monkeypatch.setattr(conftest, "KERNEL_SOURCES", tmp_path / "none")  # an installed package has no sources
    configure()


def test_no_step_allocates() -> None:
    """Memory is taken where a system or a state is opened, and nowhere else."""
    text = {path.name: path.read_text() for path in SOURCES.glob("*.c")}
    taking = {name for name, source in text.items() if re.search(r"\b(malloc|calloc|realloc|alloca)\(", source)}
    assert taking == {"block.c", "system.c"}
    assert {name for name, source in text.items() if "pmr_aligned(" in source} == {"block.c", "state.c", "machine.c"}
    for name in ("state.c", "machine.c"):  # of a size that is known then
        assert text[name].count("pmr_aligned(") == 1 and "pmr_aligned(r.at)" in text[name]


@pytest.mark.slow
def test_both_kinds_of_code_in_the_library_agree(tmp_path: Path) -> None:
    """To round-off; where a processor has no AVX2 both are the same."""
    found = []
    for number, environment in enumerate(({}, {"PMR_KERNEL_BASELINE": "1"})):
        target = tmp_path / f"{number}.npy"
        path = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
        done = subprocess.run(
            [sys.executable, "-c", RUN, str(target)],
            env={**os.environ, **environment, "PYTHONPATH": path},
            check=True,
            capture_output=True,
            text=True,
        )
        found.append((done.stdout.split()[-1], np.load(target)))
    (_, one), (name, other) = found
    assert name in ("sse2", "vectors", "plain")
    np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9 * np.abs(other).max())
