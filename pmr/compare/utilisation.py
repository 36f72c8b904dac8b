"""How much of the yield stress the largest von Mises stress takes, where and when; what sections weigh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pmr.compare.summary import Part
from pmr.scene import Scene
from pmr.scene.joints import Part as Body


def utilisation(scene: Scene, stresses: Mapping[str, Mapping[str, Any]]) -> Part:
    """``utilisation`` of summary.json by model, of bodies whose material has a yield stress.

    ``value`` is the largest stress over the yield stress of its material; ``stress`` and ``yield`` in Pa, ``t`` in s,
    ``position`` in m in the axes of the ``section``.  More than the yield stress is warned of.

    Parameters
    ----------
    stresses : mapping
        By body, what `pmr.reduction.recovery.Recovered.summary` says.
    """
    largest = dict[str, dict[str, Any]]()
    for part in scene.sections:
        figures = stresses.get(part.name, {})
        for model, peak in figures.get("stress_peak", {}).items():
            for entry in _utilisations(part, peak, figures.get("stress_by_region", {}).get(model, {})):
                if entry["value"] > largest.get(model, {"value": -1.0})["value"]:
                    largest[model] = entry
    if not largest:
        return Part()
    used = largest["reduced"]
    over = f"the largest stress is {used['value']:.3g} times the yield stress, but the model stays elastic"
    return Part({"utilisation": largest}, grave=[over] * (used["value"] > 1.0))


def masses(masses_of_bodies: Mapping[str, Any]) -> Part:
    """``masses`` of summary.json: of each body by ``name`` what `pmr.fullmodel.model.Masses.summary` says."""
    rows = [
        {"name": name, **masses_of_body.summary()}
        for name, masses_of_body in masses_of_bodies.items()
        if masses_of_body is not None
    ]
    return Part({"masses": rows} if rows else {})


def _utilisations(part: Body, peak: Mapping[str, Any], regions: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Utilisation of the whole body, and of each region that is of a material of its own."""
    body, of = part.body, {name: area.material for name, area in part.body.regions.items() if area.material is not None}
    without_material = [area for name, area in regions.items() if name not in of]
    most = (
        peak
        if peak.get("region") not in of
        else max(without_material, key=lambda material: float(material["value"]), default=None)
    )
    pairs = [(most, body.material), *((regions[name], material) for name, material in of.items() if name in regions)]
    for region, material in pairs:
        if region is not None and material.yield_stress is not None:
            yield {
                "value": region["value"] / material.yield_stress,
                "stress": region["value"],
                "yield": material.yield_stress,
                "section": part.name,
                **{key: region[key] for key in ("t", "position", "face", "region")},
            }
