"""
An FMU with the sliding in it
=============================

A functional mock-up unit brings the reduced beam into Simulink, Dymola or OpenModelica.  This script loads it as these
programs do, through the C interface of FMI 2.0, and moves it along the path of the scene.

With FMPy one line is enough: ``fmpy simulate beam.fmu --interface-type CoSimulation``.
"""

import ctypes
import re
import zipfile
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import pmr
from pmr.export.formats import Options, write

scene = pmr.load_scene("evolved_residual", ["simulation.simulators=['march']", "time.end=6.0"])
model = pmr.reduce(scene).reduced
folder = TemporaryDirectory()
model.save(Path(folder.name, "reduced.npz"))
file = write("fmu", Path(folder.name, "reduced.npz"), Path(folder.name, "beam.fmu"), Options(fmi="2", at=None))
zipfile.ZipFile(file).extractall(folder.name)

# %%
# The description of the model lists names and numbers of the variables.

said = Path(folder.name, "modelDescription.xml").read_text()
number = dict(re.findall(r'<ScalarVariable name="([^"]+)" valueReference="(\d+)"', said))
print("inputs:", *re.findall(r'name="([^"]+)"[^>]*causality="input"', said))


class Callbacks(ctypes.Structure):
    """Of FMI 2.0: logger, allocate, free, step finished, environment."""

    _fields_ = [(name, c_void_p) for name in ("logger", "allocate", "free", "finished", "environment")]


library = ctypes.CDLL(str(next(Path(folder.name, "binaries", "linux64").iterdir())))
library.fmi2Instantiate.restype = c_void_p
guid = re.search(r'guid="([^"]*)"', said)[1].encode()
resources = Path(folder.name, "resources").resolve().as_uri().encode()  # where its data is
unit = c_void_p(library.fmi2Instantiate(b"beam", c_int(1), guid, resources, byref(Callbacks()), 0, 0))


def put(**values: float) -> None:
    """Set inputs by their names."""
    numbers = (c_uint * len(values))(*(int(number[name]) for name in values))
    assert library.fmi2SetReal(unit, numbers, c_size_t(len(values)), (c_double * len(values))(*values.values())) == 0


# %%
# Rates of the inputs say how they change within a step.

h, path, force = scene.time.step, scene.slider.path, scene.loads[0].signal
library.fmi2SetupExperiment(unit, 0, c_double(0.0), c_double(0.0), 0, c_double(0.0))
library.fmi2EnterInitializationMode(unit)
put(s=float(path.value(0.0)), F=float(force.value(0.0)))
library.fmi2ExitInitializationMode(unit)
tip, t = [0.0], np.arange(scene.time.steps + 1) * h
s, f = path.value(t), force.value(t)
numbers, seen = (c_uint * 1)(int(number["tip_z"])), (c_double * 1)()
for k in range(scene.time.steps):
    put(s=s[k], s_rate=(s[k + 1] - s[k]) / h, F=f[k], F_rate=(f[k + 1] - f[k]) / h)
    assert library.fmi2DoStep(unit, c_double(t[k]), c_double(h), 1) == 0
    library.fmi2GetReal(unit, numbers, c_size_t(1), seen)
    tip.append(seen[0])

motion = pmr.simulate(scene, model)
difference = float(np.abs(np.array(tip) - motion.tip).max())
print(f"FMU and pmr differ by less than 1e-12 m: {difference < 1e-12}")

# %%
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
axes.plot(motion.t, 1e3 * motion.tip, "k", lw=2, label="pmr")
axes.plot(t, 1e3 * np.array(tip), "--", color="tab:orange", lw=1, label="FMU")
axes.set(xlabel="t in s", ylabel="tip in mm")
axes.legend()
plt.show()
