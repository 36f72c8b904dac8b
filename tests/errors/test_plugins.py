"""What other packages add: a distribution beside a script, as Python finds it."""

from pathlib import Path

import pytest
from processes import python

import pmr
from pmr.errors import environment
from pmr.fullmodel.build import full_model
from pmr.reduction.cache import model_digest

MODULE = '''
from typing import Literal
import numpy as np
from pmr.export.formats import Format
from pmr.scene.signals import SignalBase

class Decay(SignalBase):
    """A load that fades."""
    kind: Literal["decay"] = "decay"
    amount: float

    def value(self, t):
        return self.amount * np.exp(-np.asarray(t, float))

    def rate(self, t):
        return -self.value(t)

def size(model, target, options):
    target.write_text(str(model.stat().st_size))
    return target

SIZE = Format("the size of a file", "size.txt", frozenset(), size)
'''
MODEL = '''
import numpy as np
from pmr.fem.distributed import local_csr
from pmr.models import shell

class Thick:
    """Shells with walls of 12 mm, whatever the box says."""
    KINDS = shell.KINDS

    def of(self, body, mesh):
        box = body.box.model_copy(update={"wall": 0.012})
        return shell.of(body.model_copy(update={"box": box}), mesh)

thick = Thick()

def shapes(model, choice):
    """The answers to the loads of a body on soft soil, and whatever else."""
    K, M, B = (local_csr(A).toarray() for A in (model.K, model.M, model.B))
    rest = np.random.default_rng(1).normal(size=(model.size, choice.coordinates))
    return np.hstack([np.linalg.solve(K + M, B), rest])
'''
BODIES = """
import pmr
from pmr.fullmodel.build import build
from pmr.scene import Scene
heavy = build(pmr.load_scene("boom_shell", ["body.model='thick'", "mesh.size=0.2", "mesh.along=1.0"]))
light = build(pmr.load_scene("boom_shell", ["mesh.size=0.2", "mesh.along=1.0"]))
print(round(heavy.model.masses.body / light.model.masses.body, 9))
changes = ["reduction={basis='shapes', coordinates=8}", "mesh.elements=8", "time.end=0.01", "compare.against=[]"]
scene = pmr.load_scene("paper_simple", changes)
reduced = pmr.reduce(scene).reduced
again = Scene.model_validate(scene.model_dump(mode="json"))
print(reduced.size, reduced.provenance["basis"], again.reduction.basis)
"""
UNKNOWN = """
import pmr
for name, change in (("boom_shell", "body.model='thick'"), ("paper_simple", "reduction.basis='shapes'")):
    try:
        pmr.load_scene(name, [change])
    except pmr.InputError as error:
        print(error)
"""
SCENE = """
import pmr
from pathlib import Path
from pmr.errors.environment import plugin_versions
from pmr.export.formats import Options, write
scene = pmr.load_scene("boom_beam", ["loads.0.signal={kind='decay', amount=3.0}"])
print(float(scene.loads[0].signal.value(0.0)), plugin_versions())
print(write("size", Path("fading.py"), None, Options()).read_text() == str(Path("fading.py").stat().st_size))
try:
    pmr.load_scene("crane", ["frame.luffing={kind='decay', amount=1.0}"])
except pmr.InputError as error:
    print(error)
"""
REFUSED = """
import pmr
try:
    pmr.load_scene("boom_beam", ["loads.0.signal={kind='fade'}"])
except pmr.InputError as error:
    print(error)
"""


def distribution(folder: Path, signal: str) -> None:
    """A module, and what pip would leave beside it."""
    (folder / "fading.py").write_text(MODULE)
    info = folder / "fading_loads-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fading-loads\nVersion: 1.2\n")
    points = f"[pmr.signals]\n{signal}\n[pmr.exports]\nsize = fading:SIZE\n"
    (info / "entry_points.txt").write_text(points)


@pytest.mark.slow
def test_a_signal_and_a_format_of_another_package(tmp_path: Path) -> None:
    distribution(tmp_path, "decay = fading:Decay")
    done = python("-c", SCENE, cwd=tmp_path)
    *taken, refused, _ = done.stdout.split("\n")
    assert taken == ["3.0 ['fading-loads 1.2']", "True"], done.stderr
    assert "frame.luffing: an angle whose signal has a second_rate is allowed" in refused
    assert refused.endswith("; Decay has neither second_rate nor strands")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("signal", "said"),
    [
        ("fade = fading:Missing", "pmr.signals = 'fade': fading:Missing can't be imported"),
        ("fade = fading:Decay", "whose `kind` is the entry point's name is allowed"),
        ("ramp = fading:Decay", "a name that nothing else has is allowed (fading:Decay)"),
        ("decay = fading:Decay", "loads[0].signal.kind = 'fade'"),
    ],
)
def test_one_that_does_not_fit_is_refused_in_one_line(signal: str, said: str, tmp_path: Path) -> None:
    distribution(tmp_path, signal)
    done = python("-c", REFUSED, cwd=tmp_path)
    assert said in done.stdout and done.stdout.count("\n") == 1, done.stdout + done.stderr


@pytest.mark.slow
def test_a_model_and_a_basis_of_another_package(tmp_path: Path) -> None:
    """A shell of walls half as thick again, and vectors that a function makes of the full model."""
    (tmp_path / "bodies.py").write_text(MODEL)
    info = tmp_path / "bodies-0.3.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bodies\nVersion: 0.3\n")
    (info / "entry_points.txt").write_text("[pmr.models]\nthick = bodies:thick\n[pmr.bases]\nshapes = bodies:shapes\n")
    done = python("-c", BODIES, cwd=tmp_path)
    mass, basis = done.stdout.split("\n")[:2]
    assert mass == "1.5", done.stderr
    assert basis.startswith("8 vectors of shapes, orthonormal"), done.stderr
    assert basis.endswith("rad shapes")
    (info / "entry_points.txt").write_text("")
    refused = python("-c", UNKNOWN, cwd=tmp_path).stdout
    assert refused.count("\n") == 2 and "body.model = 'thick'" in refused and "reduction.basis = 'shapes'" in refused


GROUPS = ["models", "bases", "signals", "exports", "limits"]
FILES = ["extra/__init__.py", "extra/inner/helper.py", "extra/table.csv"]


def installed(folder: Path, group: str, module: str, changed: str = "") -> Path:
    """A distribution of a package with a folder and a table; its `changed` file differs."""
    for name in (*FILES, "single.py", "beside.py"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("value = 2\n" if name == changed else "value = 1\n")
    info = folder / "extra-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: extra\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[pmr.{group}]\nthing = {module}:thing\n")
    return folder


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize(
    ("module", "files"), [("extra.inner", FILES), ("single", ["single.py", "beside.py"])], ids=["package", "module"]
)
def test_stored_results_depend_on_all_files_of_a_plug_in(
    group: str, module: str, files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A basis whose code, helper or table changed was taken from the cache as it had been."""
    digests, of_studies = list[str](), list[str]()
    for number, changed in enumerate(["", *files, ""]):
        with monkeypatch.context() as one:
            one.syspath_prepend(str(installed(tmp_path / str(number), group, module, changed)))
            digests.append(environment.plugins_digest())
            of_studies.append(environment.code_digest({}))
    for seen in (digests, of_studies):
        assert seen[0] == seen[-1]  # wherever it is installed
        assert len(set(seen)) == len(files) + 1


def test_the_cache_depends_on_plug_ins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = full_model(pmr.load_scene("paper_simple", ["mesh.elements=4"]))
    before = model_digest(model)
    monkeypatch.syspath_prepend(str(installed(tmp_path, "bases", "single")))
    assert model_digest(model) != before
