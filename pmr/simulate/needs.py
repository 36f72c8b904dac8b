"""What a body on its way asks of a simulator (`pmr.scene.simulators` has what each can do)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.rows import Rows
from pmr.scene.simulators import Needs
from pmr.simulate.excitation import Excitation
from pmr.simulate.start import row_flexibility
from pmr.system.body import SlidingBody

Mask = NDArray[np.bool_]


def needs_of(body: SlidingBody, s: float) -> Needs:
    """Of a body with its slider at s m, wherever it goes."""
    rigid = row_flexibility(body, s)[1]
    needs = _of_rows(body.row_names, ~np.isnan(body.row_clearance), rigid)
    return replace(needs, kept_inertia=body.flexibility is not None and body.flexibility.keeps_inertia)


def needs_on(body: SlidingBody, excitation: Excitation) -> Needs:
    """Of a reduced body, or a full one on one process, that is excited."""
    s = float(excitation.s[0, 0])
    rigid = row_flexibility(body, s)[1]
    return _excited(needs_of(body, s), [body.row_names[k] for k in body.moving if rigid[k]], excitation)


def needs_of_rows(rows: Rows, excitation: Excitation) -> Needs:
    """Of a full model with these rows that is excited."""
    rigid = rows.compliance == 0.0
    needs = _of_rows(rows.names, ~np.isnan(rows.clearance), rigid)
    return _excited(needs, [rows.names[k] for k in rows.moving if rigid[k]], excitation)


def _of_rows(names: Sequence[str], pushing: Mask, rigid: Mask) -> Needs:
    chosen = (pushing, pushing & rigid, ~rigid)
    pushing_names, both, giving = (tuple(names[k] for k in np.flatnonzero(which)) for which in chosen)
    return Needs(pushing=pushing_names, rigid_pushing=both, giving=giving)


def _excited(needs: Needs, rigid_moving: Sequence[str], excitation: Excitation) -> Needs:
    travels = bool(np.any(excitation.s != excitation.s[0]))
    return replace(
        needs,
        rigid_moving=tuple(rigid_moving) if travels else (),
        paths=tuple(excitation.paths),
        rho_inf=excitation.stepping.rho_inf,
    )
