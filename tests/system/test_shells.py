"""Shells that slide in each other on pads of finite size: a system of bodies on any structural model."""

from __future__ import annotations

import numpy as np
import pytest
from boxes import box

from pmr.fullmodel.model import FullModel
from pmr.fullmodel.pads import Pad, Pads
from pmr.fullmodel.structural import structural_model
from pmr.fullmodel.structure import Action, Clamp, Structure, Weight
from pmr.models.shell import Shell
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.structures import Plate, ShellBody
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact, Place
from pmr.system.system import System

LENGTH, REACH = 2.0, 0.16  # m; of a section, and from its ends to the centres of pads
FACES = ("bottom", "top", "left", "right")


def section(clamped: bool) -> FullModel:
    """A box with a row on each wall, where a pad may be centred."""
    shell = Shell(ShellBody(plate=Plate(thickness=8e-3)), box(LENGTH, along=6, around=2))
    pads = Pads(moving=tuple(Pad(face, face, length=0.3, width=0.1) for face in FACES), travel=(REACH, LENGTH - REACH))
    return structural_model(
        Structure(
            shell,
            clamps=(Clamp("tail"),) if clamped else (),
            loads=(Weight(), *([] if clamped else [Action("F", "tip", "z")])),
            outputs=(Action("tip", "tip", "z"),),
            pads=pads,
        )
    )


def contacts() -> tuple[Contact, ...]:
    """Two pads of 1e8 N/m on each wall: at the inner one's tail and at the outer one's mouth."""
    end = LENGTH - REACH
    return tuple(
        contact
        for face in FACES
        for contact in (
            Contact(f"tail {face}", Place("inner", face, REACH), Place("outer", face, REACH, "e"), compliance=1e-8),
            Contact(f"mouth {face}", Place("inner", face, end, "e", -1.0), Place("outer", face, end), compliance=1e-8),
        )
    )


@pytest.mark.slow
def test_two_shells_of_thousands_of_coordinates_with_twenty() -> None:
    outer, inner = section(True), section(False)
    full = System({"outer": outer.gather(), "inner": inner.gather()}, contacts())
    small = System(
        {
            "outer": section_model(FreeBody(outer), modal_basis(free_modes(outer, 8)), {}, 8),
            "inner": section_model(FreeBody(inner), modal_basis(free_modes(inner, 12)), {}, 12),
        },
        contacts(),
    )
    whole, x = Assembly(full), {"e": 0.8}
    assert whole.size > 2000 and Assembly(small).size == 20
    found = Assembly(small).frequencies(small.side_coordinates(x), 4)
    # pads in the middle of walls hold neither roll nor motion along the axis, which no load reaches
    expected = whole.frequencies(full.side_coordinates(x), 6)
    assert np.all(expected[:2] < 0.1) and found == pytest.approx(expected[2:], rel=1e-2)
