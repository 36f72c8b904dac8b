"""What an FMU is driven by: paths, loads and, where its frame moves, angles and accelerations of the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.export.fmi.blocks import Arrangement
from pmr.simulation.moving import AXES, GRAVITY, OF_BASE, OF_FRAME, ONE, MovingFrame
from pmr.system.body import kinds_of

Array = NDArray[np.float64]
#: Kinds of quantities as drive.h numbers them.
_KINDS = ("one", "turned", "velocity", "turning", "gradient", "driver", "reach", "over")


@dataclass(frozen=True)
class Drivers:
    """Inputs of the unit in their order, n of them; without a path, or a load, one that is unused."""

    rows: Arrangement
    frame: MovingFrame | None

    @classmethod
    def of(cls, rows: Arrangement) -> Drivers:
        """Of a system; an InputError is raised where it has terms, but no scene whose frame drives them."""
        frame = MovingFrame.of(rows.system)
        if frame is None:
            rows.system.ensure_without_terms("system")
        elif missing := [path for path in frame.paths if path not in rows.paths]:
            raise InputError(
                "system", "paths", missing[0], f"a path that pads travel on is allowed: {', '.join(rows.paths)}"
            )
        return cls(rows, frame)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of loads."""
        return self.rows.system.input_names if self.frame is None else self.frame.loads

    @property
    def motions(self) -> tuple[str, ...]:
        """Names of angles and of accelerations of the base."""
        return () if self.frame is None else (*self.frame.angles, *self.frame.axes)

    @cached_property
    def load_units(self) -> tuple[str, ...]:
        """Of each load."""
        system = self.rows.system
        known = dict(zip(system.input_names, (unit.replace("^", "") for unit in system.input_units), strict=True))
        # a force along the ground is an input for each axis of the body
        of_parts = {name.rpartition(" ")[0]: unit for name, unit in known.items()}
        return tuple(
            "m/s2" if name == GRAVITY and self.frame else known.get(name) or of_parts[name] for name in self.loads
        )

    @property
    def first_load(self) -> int:
        """The number of the first load."""
        return max(len(self.rows.paths), 1)

    @property
    def first_motion(self) -> int:
        """The number of the first angle."""
        return self.first_load + (len(self.loads) if self.frame is not None else max(len(self.loads), 1))

    @property
    def count(self) -> int:
        """N."""
        return self.first_motion + len(self.motions)

    def numbered(self, names: Sequence[str]) -> list[int]:
        """Numbers of drivers by their names; -1 where there is none."""
        known = {name: k for k, name in enumerate(self.rows.paths)}
        known |= {name: self.first_load + k for k, name in enumerate(self.loads)}
        known |= {name: self.first_motion + k for k, name in enumerate(self.motions)}
        return [known.get(name, -1) for name in names]

    @property
    def macros(self) -> dict[str, object]:
        """Of model.h."""
        found: dict[str, object] = {"DRIVERS": self.count, "FRAME": int(self.frame is not None)}
        if self.frame is not None:
            found |= {"QUANTITIES": len(self.frame.quantities), "TIP_SECTION": len(self.frame.scene.sections) - 1}
        return found

    @property
    def arrays(self) -> dict[str, Array]:
        """Of model.c by their declarations: what a frame makes of the drivers."""
        if (frame := self.frame) is None:
            return {}
        scene, last = frame.scene, self.rows.parts[-1]
        kinds = list(kinds_of(last.body))
        tip = [kinds.index(kind) if kind in kinds else None for kind in ("tip x", "tip y", "tip z")]
        assert scene.frame is not None
        return {
            "const int angle_drivers[ANGLES]": np.array(self.numbered((*OF_FRAME, *OF_BASE))),
            "const int section_paths[]": np.array([-1, *self.numbered(scene.names[1:])]),
            "const double tip_place[3]": np.array(scene.frame.place) + [scene.sections[-1].length, 0.0, 0.0],
            "const int tip_outputs[3]": np.array([-1 if k is None else last.outputs.start + k for k in tip]),
            "const int quantities[QUANTITIES][3]": np.array([self._quantity(*one) for one in frame.quantities]),
            "const double factors[]": frame.factors,
            "const int products[][3]": frame.numbers,
            "const int first_product[INPUTS + TERMS + 1]": frame.first,
        }

    def _quantity(self, kind: str | int, *of: str | int) -> list[int]:
        """As drive.h has them; without a gravity it is none of the drivers, and -1."""
        if (kind,) == ONE:
            return [0, 0, 0]
        if kind in (GRAVITY, "load", "shaken"):
            name = GRAVITY if kind == GRAVITY else AXES[int(of[0])] if kind == "shaken" else str(of[0])
            return [_KINDS.index("driver"), self.numbered([name])[0], 0]
        return [_KINDS.index(str(kind)), *map(int, of), *[0] * (2 - len(of))]
