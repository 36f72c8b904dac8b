"""What the columns of results are that do not say it themselves: by what their names have meant, or their order."""

from __future__ import annotations

from collections.abc import Iterator

from pmr.results.outputs import Output
from pmr.results.response import Response
from pmr.scene import Scene
from pmr.scene.built import force_of, reaction_of
from pmr.scene.choice import felt_faces, transverse
from pmr.scene.joints import OneBody
from pmr.scene.keys import ALONE, cylinder_of, named
from pmr.scene.members import member_at


def outputs_of(scene: Scene, response: Response) -> tuple[Output, ...]:
    """Meaning of all columns of a response: displacements, then forces, then all others.

    Else by what their names have meant since names were given; without names by the order of columns before that.
    """
    return response.outputs or (*_displacements(scene, response), *_forces(scene, response), *_others(scene, response))


def _displacements(scene: Scene, response: Response) -> Iterator[Output]:
    tips = {named(body, of.observe.tip_along(d)): ("tip", body, d) for body, of in scene.bodies.items() for d in "xyz"}
    beams = {named(body, f"{d} at "): ("beam", body, d) for body in scene.bodies for d in "xyz"}
    names = response.output_names or _unnamed_displacements(scene, response)
    for name, x in zip(names, response.x.tolist(), strict=True):
        start = next((start for start in beams if name.startswith(start)), None)
        kind, body, d = tips.get(name) or (beams[start] if start is not None else ("beam", "", ""))
        yield Output(name, kind, body, x, d)


def _unnamed_displacements(scene: Scene, response: Response) -> tuple[str, ...]:
    """Names of displacements before columns were named: places along each direction, then the tip along each."""
    (body,) = scene.bodies.values()
    across = transverse(member_at(scene))
    each = len(response.x) // len(across) - 1
    return (*(f"{d} at " for d in across for _ in range(each)), *(body.observe.tip_along(d) for d in across))


def _forces(scene: Scene, response: Response) -> Iterator[Output]:
    count = response.slider_force.shape[1]
    outputs_of = {name: output for body, of in scene.bodies.items() for name, output in _of_body(body, of).items()}
    for body in scene.bodies:
        name = force_of(cylinder_of(body))
        outputs_of[name] = Output(name, "cylinder", body, unit="N")
    joints = {force_of(f"{body} {end}"): body for body in scene.bodies for end in ("tail", "mouth") if body}
    for name in response.force_names or _unnamed_forces(scene) or ("",) * count:
        joint = next((start for start in joints if name.startswith(start)), None)
        if joint is not None:
            yield Output(name, "pad", joints[joint], unit="N")
        else:
            slider = Output(name, "pad" if ALONE in scene.bodies else "support", ALONE, unit="N")
            yield outputs_of.get(name) or slider


def _of_body(body: str, of: OneBody) -> dict[str, Output]:
    """Forces of its pads on the ground, outputs or rows of contacts, and of its supports that give way."""
    outputs = dict[str, Output]()
    for ring in of.pads:
        for pad, _, _ in ring.places:
            for name in (named(body, force_of(pad)), force_of(f"{body} {pad}")):
                outputs[name] = Output(name, "pad", body, unit="N")
    for support, unit in of.springs.items():
        name = named(body, force_of(support))
        outputs[name] = Output(name, "support", body, unit=unit)
    return outputs


def _unnamed_forces(scene: Scene) -> list[str]:
    """Outputs before rows, those of rows that move last; nothing where points slide."""
    (body,) = scene.bodies.values()
    faces = felt_faces(member_at(scene))
    staying = [ring for ring in body.pads if not ring.moving and ring.stiffness != "rigid"]
    ordered = [*sorted(staying, key=lambda ring: ring.unilateral), *(ring for ring in body.pads if ring.moving)]
    return [force_of(name) for ring in ordered for name, face, _ in ring.places if face in faces]


def _others(scene: Scene, response: Response) -> Iterator[Output]:
    for name, unit in zip(response.other_names, response.other_units, strict=True):
        kind = next((kind for kind in ("reaction", "friction") if name.startswith(f"{kind} of ")), "probe")
        place = name.removeprefix(reaction_of(""))
        body = next((body for body in scene.bodies if body and place.startswith(named(body, ""))), "")
        yield Output(name, kind, body, unit=unit)
