"""What other packages add: a distribution beside a script, as Python finds it."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import python

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
SCENE = """
import pmr
from pathlib import Path
from pmr.errors.plugins import versions
from pmr.export.formats import Options, write
scene = pmr.load_scene("boom_beam", ["loads.0.signal={kind='decay', amount=3.0}"])
print(float(scene.loads[0].signal.value(0.0)), versions())
print(write("size", Path("fading.py"), None, Options()).read_text() == str(Path("fading.py").stat().st_size))
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
    assert done.stdout.split("\n")[:2] == ["3.0 ['fading-loads 1.2']", "True"], done.stderr


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
