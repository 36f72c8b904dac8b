"""Schemas for editors: complete, up to date, and of one opinion with what reads the files.
Every key of a scene says what it is, and every number its unit and what can be computed with.
"""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import BaseModel

from pmr import InputError
from pmr import scene as scenes
from pmr.cli.app import scene_kinds
from pmr.cli.info import scene_schema, study_schema
from pmr.scene import Scene
from pmr.scene.hoist import Hoist
from pmr.scene.keys import SceneTable
from pmr.scene.scene import BodyFile

ROOT = Path(__file__).parents[2]
WORKFLOWS = ROOT / "workflows"
#: Nothing that can be run: what others extend.
BASES = {WORKFLOWS / "paper_base.toml"}
FILES = sorted({*WORKFLOWS.rglob("*.toml"), *(ROOT / "pmr" / "cli" / "templates").glob("*.toml")} - BASES)
SCENE, STUDY = (jsonschema.Draft7Validator(json.loads(text)) for text in (scene_schema(), study_schema()))

WRONG = """
titel = "boom"
title = 3
body.model = "plate"
body.lenght = 5.0
body.box.lenght = 5.0
body.box.length = -5.0
body.box.wall = "thin"
body.box.frames = 1.0
body.material.poisson = 0.5
body.material.young = 0.0
body.material.density = true
body.thickness = 0
mesh.elements = 0
mesh.elements = 2.5
mesh.cells = "bricks"
mesh.size = -0.1
supports = 3
supports = [{ kind = "glued" }]
supports = [{ directions = ["up"] }]
supports = [{ stiffness = "soft" }]
pads = [{ name = "tail" }]
pads = [{ name = "tail", faces = { under = [0.0] } }]
pads = [{ name = "tail", faces = { bottom = [0.0] }, moving = "yes" }]
slider.path = { kind = "sine", amplitude = 1.0 }
slider.path = { kind = "sine", amplitude = 1.0, frequency = -1.0 }
slider.path = { kind = "wave", amplitude = 1.0 }
slider.path = { kind = "ramp", times = [0.0], values = [1.0] }
slider.path = { kind = "table" }
slider.path = "forward"
loads = [{ name = "F", on = "tip" }]
loads = [{ name = "F", direction = "w", signal = 1.0 }]
masses = [{ name = "payload", on = "tip" }]
masses = [{ name = "payload", on = "tip", mass = -1.0 }]
gravity.direction = [0.0, 1.0]
gravity.rise = -1.0
gravity.inclination = 120.0
gravity = { inclination = 30.0, direction = [0.0, 0.0, -1.0] }
damping = { ratio = 0.01, frequencies = [1.0] }
damping = { ratio = 0.01, frequencies = [1.0, 2.0], mass = 1.0 }
time.end = "long"
time.step = 0.0
time.rho_inf = 1.5
reduction.coordinates = 0
reduction.basis = "modes"
reduction.flexibility = 1
simulation.simulators = []
simulation.simulators = ["marsh"]
compare.against = ["fully"]
accuracy.tolerance = 2.0
recovery.every = 0
observe.count = 0
""".strip().splitlines()


@pytest.mark.parametrize("name", ["scene", "study"])
def test_schemas_beside_the_workflows_are_those_of_the_code(name: str) -> None:
    """`make schemas` writes them."""
    written = json.loads((WORKFLOWS / "schemas" / f"{name}.json").read_text())
    assert written == {"scene": SCENE, "study": STUDY}[name].schema
    jsonschema.Draft7Validator.check_schema(written)


def keys(schema: Any, part: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every key that a schema knows, with what it says of it."""
    for name, own in {"": schema, **schema.get("$defs", {})}.items():
        for key, value in own.get("properties", {}).items():
            yield f"{name}.{key}", value


def numbers(value: Any) -> Iterator[dict[str, Any]]:
    """The numbers that a key may hold, whole ones aside."""
    if isinstance(value, dict):
        if value.get("type") == "number":
            yield value
        for one in value.values():
            yield from numbers(one)
    elif isinstance(value, list):
        for one in value:
            yield from numbers(one)


@pytest.mark.parametrize("model", [BodyFile, Scene])
def test_every_key_has_a_description_a_unit_and_a_default_or_must_be_given(model: type[BodyFile | Scene]) -> None:
    known = model.model_json_schema()
    found = list(keys(known))
    assert len(found) > 150
    assert [name for name, value in found if not value.get("description")] == []
    without = [name for name, value in found for one in numbers(value) if not (one | value).get("unit")]
    assert [name for name in without if name not in (".newton", "Simulation.newton")] == []
    for part in (known, *known["$defs"].values()):
        for key, value in part.get("properties", {}).items():
            given = key in part.get("required", []) or ("anyOf" in part and {"required": [key]} in part["anyOf"])
            assert "default" in value or given or "values" in part["properties"], key


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_what_comes_with_the_package_is_valid(file: Path) -> None:
    data = tomllib.loads(file.read_text())
    (STUDY if "kind" in data else SCENE).validate(data)


@pytest.mark.parametrize("line", WRONG)
def test_what_pydantic_refuses_an_editor_refuses(line: str) -> None:
    data = tomllib.loads((WORKFLOWS / "boom.toml").read_text())
    assert SCENE.is_valid(data)
    key, _, value = line.partition(" = ")
    with pytest.raises(InputError):
        scenes.load(WORKFLOWS / "boom.toml", [f"{key}={value}"])
    *tables, last = key.split(".")
    table = data
    for name in tables:
        table = table.setdefault(name, {})
    table[last] = tomllib.loads(f"value = {value}")["value"]
    assert not SCENE.is_valid(data)


@pytest.mark.parametrize("kind", scene_kinds())
def test_files_that_extend_others_need_not_be_complete(kind: str) -> None:
    for text in ("masses.payload.mass = 3.0", "loads.gust.signal.amplitude = 2.0", "body.box.length = 7.0", ""):
        assert SCENE.is_valid(tomllib.loads(f"extends = '{kind}'\n{text}"))
    for text in ("masses.payload.mas = 3.0", "loads.gust.signal.amplitud = 2.0", "body.box.length = -7.0", "bodi = 1"):
        assert not SCENE.is_valid(tomllib.loads(f"extends = '{kind}'\n{text}"))


def test_a_table_that_is_left_out_is_what_an_empty_one_gives() -> None:
    kinds, defaults = [SceneTable], dict[str, BaseModel]()
    for kind in kinds:  # grows while it is read
        kinds += kind.__subclasses__()
        for name, field in kind.model_fields.items():
            if isinstance(field.default, BaseModel):
                defaults[f"{kind.__name__}.{name}"] = field.default
    assert len(defaults) > 15
    for name, default in defaults.items():
        assert default == type(default)(), name


def test_the_default_height_of_a_hoist_s_pivot_is_that_of_the_ground_and_its_description_says_so() -> None:
    feet = "{name='a', at=[1.0, 1.0]}, {name='b', at=[1.0, -1.0]}, {name='c', at=[-1.0, 0.0]}"
    ground = f"{{height=1.6, outriggers=[{feet}]}}"
    hoist = "hoist.pivot_height=0.0"
    for keys, height in ((["frame.ground=" + ground, hoist], 1.6), (["hoist.pivot_height=2.0"], 2.0), ([hoist], 0.0)):
        assert scenes.load_any(WORKFLOWS / "hoist.toml", keys).pivot_height == height
    description = Hoist.model_fields["pivot_height"].description
    assert description is not None and "frame.ground.height" in description
