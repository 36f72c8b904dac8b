"""Compiled forms: a form is compiled once, however many other forms a process has compiled before."""

from __future__ import annotations

import pytest

from pmr import load_scene
from pmr.fem.compat import MPI, VERSION
from pmr.fullmodel.assembly import Assembler
from pmr.fullmodel.from_scene import structure_of
from pmr.scene.members import members


@pytest.mark.slow
def test_a_form_has_the_same_signature_before_and_after_another_one_is_compiled(tmp_path) -> None:
    """FFCx changes the element of a mesh while it compiles, unless the element says everything from the start."""
    dolfinx = pytest.importorskip("dolfinx")
    (member,) = members(load_scene("boom_beam"))
    model = structure_of(member, MPI.COMM_SELF).model
    space = Assembler(model, model.domain(MPI.COMM_SELF)).space
    forms = model.forms(space)
    before = forms.stiffness.signature()
    options = "jit_params" if VERSION < (0, 6) else "jit_options"
    dolfinx.fem.form(forms.mass, **{options: {"cache_dir": tmp_path}})
    assert model.forms(space).stiffness.signature() == before
