"""The first lines of a run's page: which limit is closest, what has no limit, and what was run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pmr.report import first_page, overview
from pmr.report.blocks import Verdict
from pmr.report.numbers import format_input
from pmr.report.sentences import LargestValue
from pmr.report.subject import acting_loads, is_alone, reduced_size, structural_model_words
from pmr.results import RunResult
from pmr.results.quantities import QUANTITIES, wall_stress
from pmr.scene.choice import model_of
from pmr.scene.hints import strength_effects
from pmr.scene.members import members

#: Keys of quantities, each with those of further rows that state a share of its limit; some never have a limit.
LIMITED_BY = {"stress": ("wall_stress", "utilisation"), "support": ("support_use",), "luffing_force": ("luffing_use",),
              "cylinder_force": (), "rope_force": (), "outrigger_force": (), "pad_pressure": ("pad_use",), "tip": (),
              "frequency": (), "buckling": ()}  # fmt: skip


def verdict(result: RunResult) -> Verdict:
    """Return the verdict on a run: all values above their limits or, if there are none, the value closest to its limit.

    In the second case, the closest is chosen with the play of pads that another run had, too.  Further values are named
    that exceed their limits with the known errors or with this play, and the one that the errors bring closest.  The
    notes say which quantities have no limit, and which effects on strength are not checked.
    """
    rows = first_page.largest_values(result)
    limited = [row for row in rows if row.share is not None]
    above = [row for row in limited if (row.share or 0.0) > 1.0]
    if above:
        text = f"{len(above)} of {len(limited)} limits {'is' if len(above) == 1 else 'are'} exceeded."
        text += "".join(f" {said[:1].upper()}{said[1:]}." for said in map(_in_brief, above))
    elif limited:
        text = f"All {len(limited)} limits are kept. Closest: " if len(limited) > 1 else "The only limit is kept: "
        text += f"{_in_brief(limited[0])}."
        for what, share in (("all known errors", "share_with_errors"), ("another play of pads", "share_with_play")):
            if doubtful := [row.name for row in limited if (getattr(row, share) or 0.0) > 1.0]:
                text += f" With {what} these may be above their limits: {', '.join(doubtful)}."
        with_errors = max(limited, key=lambda row: row.share_with_errors or row.share or 0.0)
        if with_errors is not limited[0] and (with_errors.share_with_errors or 0.0) > limited[0].largest_share:
            text += f" Closest with all known errors: {_in_brief(with_errors)}."
    else:
        text = "Nothing was compared with a limit: the scene states none."
    return Verdict(text, tuple(_unchecked(result, rows)), bool(above))


def _in_brief(row: LargestValue) -> str:
    """Name of a row, its figure, and its place and time."""
    figure, _, notes = row.text.partition("\n")
    return "; ".join(filter(None, (f"{row.name}, {figure}", notes.partition("; ")[0])))


def _unchecked(result: RunResult, rows: Sequence[LargestValue]) -> Iterator[str]:
    """Yield a sentence on the quantities of `rows` without a limit, and one on what is not checked."""
    stated, limited = {row.key for row in rows}, {row.key for row in rows if row.share is not None}
    unlimited = [key for key, uses in LIMITED_BY.items() if key in stated and not limited & {key, *uses}]
    if unlimited:
        yield f"Without a limit: {', '.join(QUANTITIES[key].label for key in unlimited)}."
    in_walls = wall_stress(result.summary) is not None
    effects = [effect.text for effect in strength_effects(result.scene, in_walls=in_walls)]
    if result.frame is not None and "ground" not in result.summary:
        effects.append("tipping")
    if effects:
        yield f"Not checked: {', '.join(effects)}; more under What these values leave out."


def run_sentence(result: RunResult) -> str:
    """Sentence on what was run: machine, model, motion and time, masses and loads."""
    scene = result.scene
    bodies = "a body alone" if is_alone(result) else f"boom of {', '.join(scene.bodies)}"
    models = dict.fromkeys(
        structural_model_words(model_of(of), part.body.walls)
        for of, part in zip(members(scene), scene.bodies.values(), strict=True)
    )
    motions = [f"{name} {text}" for of in (overview.length_rows, overview.angle_rows) for name, text in of(result)]
    masses = [f"{of.name} {format_input(of.mass, 'kg')}" for part in scene.sections for of in part.masses]
    loads = [f"{load.name} {overview.load_text(load)}" for load in acting_loads(result)]
    parts = [f"{bodies}, modelled as {' and '.join(models)}; {reduced_size(result)} coordinates", *motions]
    parts += [f"{format_input(scene.time.end, 's')} of motion"]
    parts += [" and ".join(masses)] if masses else []
    parts += [overview.describe_hoist(scene.hoist, scene.time.end)] if scene.hoist is not None else []
    parts += [", ".join(loads)] if loads else []
    turns = scene.frame is not None and any(load.source.axes == "ground" for load in acting_loads(result))
    parts += ["x of the ground points ahead of the unslewed boom: loads along −x come from ahead"] if turns else []
    parts += [f"weight {'left out' if scene.gravity is None else 'included'}"]
    return f"Computed: {'; '.join(parts)}."
