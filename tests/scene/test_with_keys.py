import pmr


def test_keys_of_tables_change_in_the_copy_and_nowhere_else() -> None:
    scene = pmr.load_scene("boom_three")
    changed = scene.with_keys(time={"step": 0.125}, recovery=None)
    assert changed.time == scene.time.model_copy(update={"step": 0.125})
    assert changed == scene.model_copy(update={"time": changed.time, "recovery": None})
    assert scene.time.step != 0.125


def test_keys_of_a_body_change_the_only_body() -> None:
    scene = pmr.load_scene("boom_beam")
    changed = scene.with_keys(reduction={"coordinates": 3})
    assert changed.sections[0].reduction.coordinates == 3
    assert changed.reduction.basis == scene.reduction.basis


def test_each_section_gets_keys_by_its_own_values() -> None:
    scene = pmr.load_scene("boom_three")
    finer = scene.vary_sections(lambda part: {"mesh": {"elements": part.mesh.elements + len(part.name)}}, title="finer")
    assert [part.mesh.elements for part in finer.sections] == [
        part.mesh.elements + len(part.name) for part in scene.sections
    ]
    assert finer.title == "finer"
    assert finer.sections[0].body == scene.sections[0].body
