"""What an FMU is driven by: paths, loads and, where its frame moves, angles and accelerations of the base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.kernel.data import SystemData, system_data
from pmr.kernel.frame import AXES
from pmr.scene.keys import LUFFING
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.moving import GRAVITY, MovingFrame
from pmr.system.contacts import ALONE
from pmr.system.system import System

Array = NDArray[np.float64]
#: Of the base, which may go on and on.
SLEWING = "slewing"


@dataclass(frozen=True)
class Drivers:
    """A system as the kernel has it, and its N drivers: in a frame that moves the motions of this."""

    system: System
    forms: Mapping[str, ModalForm]
    frame: MovingFrame | None
    data: SystemData

    @classmethod
    def of(cls, system: System) -> Drivers:
        """Drivers of a system.

        An InputError is raised where it has terms, but no scene whose frame drives them, where its paths are not those
        of the frame in their order, or as for `modal_form`.
        """
        frame = MovingFrame.of(system)
        if frame is None:
            system.ensure_without_terms("system")
        elif frame.paths != tuple(path for path in system.paths if path != LUFFING):
            of_scene, of_pads = (", ".join(paths) or "none" for paths in (frame.paths, system.paths))
            raise InputError(
                "system", "paths", of_scene, f"paths that pads travel on are allowed in the pads' order: {of_pads}"
            )
        forms = {name: modal_form(body) for name, body in system.reduced.items()}
        return cls(system, forms, frame, system_data(system, forms, frame))

    @property
    def paths(self) -> tuple[str, ...]:
        """Names of paths that are inputs of their own: the angle that a luffing cylinder turns with is the frame's."""
        return self.data.rows.paths if self.frame is None else self.frame.paths

    @property
    def shown_paths(self) -> tuple[str, ...]:
        """Paths that are inputs: a section without contacts has none."""
        return self.paths if self.system.paths or ALONE in self.system.bodies else ()

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of loads."""
        return self.system.input_names if self.frame is None else self.frame.loads

    @property
    def motions(self) -> tuple[str, ...]:
        """Names of angles and of accelerations of the base."""
        return () if self.frame is None else (*self.frame.angles, *self.frame.axes)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all drivers in the kernel's order, which is that of paths, loads and motions."""
        return (*self.paths, *self.loads, *self.motions)

    @property
    def count(self) -> int:
        """N."""
        return len(self.names)

    @property
    def modes(self) -> int:
        """Modes r of all bodies."""
        return len(self.data.used_modes)

    @cached_property
    def load_units(self) -> tuple[str, ...]:
        """Unit of each load."""
        units = [unit.replace("^", "") for unit in self.system.input_units]
        of_inputs = dict(zip(self.system.input_names, units, strict=True))
        # a force along the ground is an input for each axis of the body
        of_parts = {name.rpartition(" ")[0]: unit for name, unit in of_inputs.items()}
        return tuple(
            "m/s2" if name == GRAVITY and self.frame else of_inputs.get(name) or of_parts[name] for name in self.loads
        )

    @property
    def first_load(self) -> int:
        """Number of the first load."""
        return len(self.paths)

    @property
    def first_motion(self) -> int:
        """Number of the first angle."""
        return self.first_load + len(self.loads)

    @property
    def is_differential(self) -> bool:
        """Whether an ordinary differential equation is left: no contact is rigid, and nothing rubs."""
        rows = self.data.rows
        return rows.friction is None and bool(np.all(rows.gives > 0.0))

    def kinds(self) -> list[int]:
        """Kind of each driver, as unit.h of the C source numbers them: other, a path, an angle, slewing."""
        of_motions = [0 if name in AXES else 3 if name == SLEWING else 2 for name in self.motions]
        return [*(1 for _ in self.paths), *(0 for _ in self.loads), *of_motions]
