r"""Amplitudes of loads and terms of a frame that moves, as sums of products of few quantities.

.. math:: c(t) = \sum_n \kappa_n \prod_{k \in n} x_k(t)

so that a run, which evaluates them at many times, a loop of one's own (`pmr.simulation.moving`) and the C source of an
FMU all have them from the same lists.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: A quantity, numbers 0, 1, 2 being axes x, y, z:
#:
#: - ``("turned", i, j)``: R_ij of the rotation from axes of the boom into those of the ground,
#: - ``("velocity", k)`` in rad/s and ``("turning", k)`` in rad/s^2: of the frame, in its axes,
#: - ``("gradient", j, k)`` in 1/s^2: A_jk of the acceleration field,
#: - ``("shaken", i)`` in m/s^2: acceleration of the pivot along an axis of the ground,
#: - ``("gravity",)`` in m/s^2,
#: - ``("reach", n, d)``: where the tail of section n is, m, or its derivative of order d,
#: - ``("over", n)`` in 1/m: one over the extension of section n,
#: - ``("load", name)``: a load, by the name of its input.
Quantity = tuple[str | int, ...]


@dataclass(frozen=True)
class Product:
    """A number times some quantities."""

    factor: float
    of: tuple[Quantity, ...]

    def times(self, factor: float, *more: Quantity) -> Product:
        """Product with another factor and further quantities."""
        return replace(self, factor=factor * self.factor, of=(*self.of, *more))


Products = tuple[Product, ...]


def evaluate(products: Products, quantity: Callable[[Quantity], Array], t: Array) -> Array:
    """Sum (T,) of products at the times t (T,) s, with values (T,) of each quantity by itself."""
    total = np.zeros_like(t)
    for product in products:
        part = np.full_like(t, product.factor)
        for quantity_of_product in product.of:
            part *= quantity(quantity_of_product)
        total += part
    return total


def of_field(field: str, number: int, pivot: Sequence[float], shaken: bool, factor: float) -> Products:
    r"""A component of the acceleration field of the section with that number, times a factor.

    ``xz`` is A_xz; ``x`` that of its tail, whose base has its own tail at the `pivot`, which is `shaken` or not,

    .. math:: g\, e_Z + \ddot u + \ddot X e_x + 2\, \omega \times \dot X e_x + A\, (p + X e_x)
    """
    along = "xyz".index(field[0])
    if len(field) == 2:
        return (Product(factor, (("gradient", along, "xyz".index(field[1])),)),)
    products = [Product(factor, (("gravity",), ("turned", 2, along)))]
    products += [Product(factor * at, (("gradient", along, k),)) for k, at in enumerate(pivot) if at]
    if shaken:
        products += [Product(factor, (("turned", axis, along), ("shaken", axis))) for axis in range(3)]
    if number:
        products.append(Product(factor, (("gradient", along, 0), ("reach", number, 0))))
        across = (None, (2, 1.0), (1, -1.0))[along]  # of the angular velocity x e_x
        if across is None:
            products.append(Product(factor, (("reach", number, 2),)))
        else:
            products.append(Product(2.0 * across[1] * factor, (("velocity", across[0]), ("reach", number, 1))))
    return tuple(products)


def of_rotation(of: str, component: str) -> Products:
    """Twice an angular velocity (`rotation`), its rate (`turning`), or w_j w_k, without w . w for j = k (`carried`)."""
    first, last = "xyz".index(component[0]), "xyz".index(component[-1])
    if of == "rotation":
        return (Product(2.0, (("velocity", first),)),)
    if of == "turning":
        return (Product(1.0, (("turning", first),)),)
    if first != last:
        return (Product(2.0, (("velocity", first), ("velocity", last))),)
    return tuple(Product(-1.0, (("velocity", k), ("velocity", k))) for k in range(3) if k != first)
