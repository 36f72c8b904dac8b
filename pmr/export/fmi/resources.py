"""The system of an FMU as the file that its binary reads (source/unit.h says what stands in it beside the kernel's)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import BEYOND_ENDS
from pmr.export.fmi.drivers import Drivers
from pmr.kernel.block_file import LINE, lines, pack, seal
from pmr.kernel.kernel import checksum
from pmr.simulation import contact_step

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SystemFile:
    """Bytes of resources/system.pmr, and the token that tells the model from others."""

    content: bytes
    token: str


def system_file(
    drivers: Drivers, path_names: Sequence[str], start_values: Array, nominal: Array, omega: float
) -> SystemFile:
    """Write a system with all that its unit asks for.

    `start_values` (4 + 4 N,) are those of the variables up to the kind of start: t, the drivers, their rates of order
    one to three, step, rho_inf, start.  `nominal` (2 r,) are sizes of the modal coordinates and of their rates.
    `omega` in rad/s is that of contacts that only push (`pmr.simulation.contact_step`), 0 without any.
    """
    settings = [omega, contact_step.TOLERANCE, contact_step.RESOLVED, contact_step.MOST_PARTS, BEYOND_ENDS]
    arrays: dict[str, NDArray[Any] | str] = {
        **drivers.data.arrays,
        "unit_start": start_values,
        "unit_nominal": nominal,
        "unit_modes": drivers.data.used_modes,
        "unit_kinds": np.array(drivers.kinds()),
        "unit_settings": np.array(settings, float),
        "unit_exchange": np.array([drivers.is_differential]),
        "names_paths": lines(path_names),
    }
    digest = hashlib.sha256(pack(arrays)).hexdigest()
    token = "-".join(digest[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32)))
    block = pack(arrays | {"names_token": f"{{{token}}}"})
    seal(block, checksum(block[LINE:]))
    return SystemFile(bytes(block), f"{{{token}}}")
