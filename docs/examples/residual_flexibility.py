"""
Modes alone, and with residual flexibility
==========================================

The bending moment has a kink at a support, and the kink travels with it.  A few smooth modes cannot represent it at
every position.  Residual flexibility adds the static deformation that the modes leave out, for every position of the
support.  With the same number of coordinates errors are smaller by orders of magnitude.
"""

import matplotlib.pyplot as plt

import pmr

common = ["mesh.elements=24", "simulation.simulators=['march']", "simulation.repeats=1", "reduction.estimate=false"]
ways = {
    "modes alone": ["reduction.flexibility=false"],
    "with residual flexibility": ["reduction.flexibility=true"],
}
counts = [4, 6, 8, 12]

# %%
# The full model is simulated once; each reduced one is compared with it.


def motion(*changes: str) -> pmr.RunResult:
    return pmr.run(pmr.load_scene("evolved_residual", [*common, *changes])).result


reference = motion("reduction.coordinates=6").responses["full"].displacement
errors = {}
for name, way in ways.items():
    for count in counts:
        asked = pmr.load_scene("evolved_residual", [*common, *way, f"reduction.coordinates={count}"])
        found = pmr.simulate(asked, pmr.reduce(asked).reduced).displacement
        errors[name, count] = (((found - reference) ** 2).sum() / (reference**2).sum()) ** 0.5
    print(name, *(f"{count}: {100 * errors[name, count]:.3g} %" for count in counts), sep="   ")

# %%
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for name in ways:
    axes.semilogy(counts, [100 * errors[name, count] for count in counts], "o-", label=name)
axes.set(xlabel="coordinates", ylabel="error along the beam in %", xticks=counts)
axes.legend()
plt.show()
