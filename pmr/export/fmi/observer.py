"""An observer in an FMU: measurements in, estimates with standard deviations out, behind the variables of the model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.export.fmi.variables import Drivers, Identifiers, Role, Variable
from pmr.files.arrays import Array
from pmr.kernel.filter import FilterData

#: Sizes and numbers of a filter in the order in which source/estimator.c reads them.
SIZES = ("states", "outputs", "sensors", "inputs", "loads", "parameters", "biased", "scaled", "off", "payload")
NUMBERS = ("gravity", "gate", "refused", "alarm", "share", "following")


@dataclass(frozen=True)
class UnitObserver:
    """Filter of an observer, and the outputs and loads of the system to which its numbers refer.

    `units` has the unit of each unknown, then of each output, by name; `sensors` and `outputs` are in the filter's
    order.
    """

    data: FilterData
    step: float  # s
    outputs: tuple[str, ...]  # (q,)
    columns: NDArray[np.int32]  # (q,) among outputs of the bodies, then forces of all contacts
    orders: NDArray[np.int32]  # (q,): of rates with respect to time
    felt: Array  # (q,) m/s^2: what accelerometers feel at rest
    inputs: tuple[str, ...]  # (i,): loads of the model
    sensors: tuple[str, ...]  # (p,)
    units: Mapping[str, str]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of what is estimated beside outputs."""
        return tuple(name for name in self.units if name not in self.outputs)

    def arrays(self, drivers: Drivers) -> dict[str, NDArray[np.int32] | Array]:
        """Arrays for resources/system.pmr by name."""
        numbers, data = drivers.system.input_names, self.data
        sizes = [*(data.sizes[name] for name in SIZES), data.sizes["acceleration"], len(self.unknowns)]
        arrays: dict[str, NDArray[np.int32] | Array] = {
            "sizes": np.array(sizes, np.int32),
            "numbers": np.array([*(data.numbers[name] for name in NUMBERS), self.step]),
            "columns": self.columns,
            "orders": self.orders,
            "felt": self.felt,
            "loads": np.array([drivers.first_load_number + numbers.index(name) for name in self.inputs], np.int32),
            "x": data.x,
            "P": data.P.ravel(),
            "square": data.square,
        }
        arrays |= {name: np.asarray(array, np.int32) for name, array in data.indices.items()} | dict(data.arrays)
        return {f"observer_{name}": array for name, array in arrays.items() if len(array)}

    def variables(self, names: Identifiers, first: int) -> Iterator[Variable]:
        """Yield the observer's variables, numbered from the value reference `first` on, as in source/estimator.c.

        An input for each sensor comes first.  Estimates of the outputs follow, then their standard deviations, the same
        for the unknowns, and the innovation and the alarm of each sensor.
        """
        listed = list[Variable]()
        for name in self.sensors:
            what = f"measured {name}; NaN where nothing was measured"
            variable = Variable(names(f"measured_{name}"), 0, what, Role("input", initial=""), self._unit(name))
            listed.append(replace(variable, start=float("nan")))
        for group in (self.outputs, self.unknowns):
            for what in ("estimate", "standard deviation"):
                listed += [self._output(names, what, name, self._unit(name)) for name in group]
        listed += [self._output(names, "innovation", name, "1") for name in self.sensors]
        listed += [self._output(names, "alarm", name, "1") for name in self.sensors]
        yield from (replace(variable, reference=first + k) for k, variable in enumerate(listed))

    def _unit(self, name: str) -> str:
        """Unit of an output or unknown as FMI writes it."""
        return self.units[name].replace("^", "")

    @staticmethod
    def _output(names: Identifiers, what: str, name: str, unit: str) -> Variable:
        """Output with `what` the observer says of `name`."""
        return Variable(names(f"{what}_of_{name}"), 0, f"{what} of {name}, one step ago", unit=unit)
