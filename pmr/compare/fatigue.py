"""Damage by load cycles at the probes of a run, on the S-N line and with the spectrum that a scene gives."""

from __future__ import annotations

from pmr.compare.summary import Part
from pmr.results import Response
from pmr.results.extremes import cycles
from pmr.results.fatigue import SNLine
from pmr.scene import Scene


def part(scene: Scene, response: Response) -> Part:
    r"""``fatigue`` of summary.json, a row for each probe's stress, the worst one first; nothing unless it is asked for.

    .. math:: D = \sum_l n_l \sum_i D_i(f_l\, \Delta\sigma_i)

    over the lines of the spectrum, which come n_l times with the share f_l of the stresses, and the run's rainflow
    cycles (`pmr.results.fatigue`), of each component by itself.  ``life`` is how often the whole spectrum may
    come until D is 1; None for ever.
    """
    settings = scene.fatigue
    if settings is None:
        return Part()
    line = SNLine(settings.slope, settings.reference, settings.cut_off or 0.0)
    damage_of_probe = dict[str, float]()
    for output in response.outputs:
        if output.kind == "probe" and output.unit == "Pa":
            counted = cycles(response.t, response.other(output.name))
            done = [step.cycles * line.damage(step.factor * counted[:, 0], counted[:, 2]) for step in settings.lines]
            damage_of_probe[output.name] = sum(done)
    worst_first = sorted(damage_of_probe, key=lambda name: -damage_of_probe[name])
    rows = [
        {
            "name": n,
            "damage": damage_of_probe[n],
            "life": 1.0 / damage_of_probe[n] if damage_of_probe[n] > 0.0 else None,
        }
        for n in worst_first
    ]
    failed = [
        f"{n} fails by fatigue: its damage is {damage_of_probe[n]:.3g}, and 1 is allowed" for n in worst_first[:1]
    ]
    return Part({"fatigue": rows}, grave=failed if max(damage_of_probe.values(), default=0.0) > 1.0 else [])
