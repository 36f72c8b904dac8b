"""Limits of a load chart that no run states: overturning of the machine, and limits that users define themselves.

A user defines a limit by a function of an installed package, or by an arithmetic expression in the study file.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, cast

import numpy as np

from pmr.errors import InputError, environment, similar_name_hint
from pmr.files.arrays import Array
from pmr.results.quantities import support_names
from pmr.scene import Scene
from pmr.scene.built import force_name, reaction_name
from pmr.scene.choice import motion_directions, transverse_axes
from pmr.scene.ground import MachineMass
from pmr.scene.keys import qualified_name
from pmr.scene.mechanism import AT_PIVOT
from pmr.scene.members import members
from pmr.scene.rotation import boom_rotation
from pmr.simulation.statics.loaded import LoadedStates
from pmr.simulation.statics.postures import HOOK, MACHINE_WEIGHT, PostureMatrices
from pmr.system.from_scene import force_names

Amounts = Mapping[str, Any]  # numbers by name, and tables of numbers
Value = Callable[[Amounts], float]

#: Longest expression, in characters, so that expressions are not nested deeper than Python can follow.
LONGEST = 1000
OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., float]] = {
    "abs": abs, "max": max, "min": min, "sqrt": lambda x: float(np.sqrt(x)), "sin": lambda x: float(np.sin(x)),
    "cos": lambda x: float(np.cos(x)), "hypot": lambda *x: float(np.linalg.norm(x)),
}  # fmt: skip


def compile_expression(text: str, names: tuple[str, ...], tables: tuple[str, ...]) -> Value:
    """Compile the expression `text` to a function that returns its value from a mapping of amounts.

    Allowed are numbers, + - * / **, `FUNCTIONS`, `names`, and entries of `tables` as table["name"].  Raises ValueError
    with one line on what is not allowed.  The returned function raises KeyError for an entry that a table lacks; it may
    also raise ValueError or ArithmeticError.
    """
    if len(text) > LONGEST:
        raise ValueError(f"at most {LONGEST} characters are allowed")
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError("it is no arithmetic expression") from None
    try:
        return _compile_node(tree, names, tables)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def entry_names(text: str, table: str) -> list[str]:
    """Return the names of the entries of `table` that the expression `text` uses, each as often as it uses it.

    `text` is an expression that `compile_expression` accepts.
    """
    subscripts = [node for node in ast.walk(ast.parse(text, mode="eval")) if isinstance(node, ast.Subscript)]
    of_table = [node for node in subscripts if isinstance(node.value, ast.Name) and node.value.id == table]
    return [str(node.slice.value) for node in of_table if isinstance(node.slice, ast.Constant)]


def _compile_node(node: ast.expr, names: tuple[str, ...], tables: tuple[str, ...]) -> Value:
    """Compile one node of an expression and all nodes below that to a function, as `compile_expression` does.

    `names` and `tables` are those that the expression may use.  Raises ValueError for a node that is not allowed.
    """
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
        constant = _as_float(node.value)
        return lambda at: constant
    if isinstance(node, ast.Name) and (name := node.id) in names:
        return lambda at: float(at[name])
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in tables:
        if isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, str):
            table, entry = node.value.id, node.slice.value
            return lambda at: float(at[table][entry])
    elif isinstance(node, (ast.BinOp, ast.UnaryOp)) and type(node.op) in OPERATORS:
        parts = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
        return _operation(OPERATORS[type(node.op)], [_compile_node(part, names, tables) for part in parts])
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS:
        if node.args and not node.keywords:
            return _operation(FUNCTIONS[node.func.id], [_compile_node(part, names, tables) for part in node.args])
    listed = ", ".join([*names, *(f'{part}["name"]' for part in tables), *(f"{function}()" for function in FUNCTIONS)])
    raise ValueError(f"{ast.unparse(node)!r} is not allowed: numbers, + - * / **, {listed} are")


def _as_float(number: float) -> float:
    """Return a number as a finite float; raise a ValueError for a number that is too large or NaN.

    Numbers do not stay integers, as a power of integers may have so many digits that they fill the memory.
    """
    try:
        value = float(number)
    except OverflowError:  # only for integers: the float 1e400 is infinite
        value = math.inf
    if not math.isfinite(value):
        raise ValueError("a number in it is too large: up to 1.8e308 is allowed")
    return value


def _operation(function: Callable[..., float], parts: list[Value]) -> Value:
    """Return a function of amounts that applies an operator or a function, `function`, to the values of `parts`.

    The returned function raises a ValueError for a complex value.
    """

    def apply(at: Amounts) -> float:
        """Return the value for the amounts `at`; raises ValueError if it is complex."""
        value = function(*(part(at) for part in parts))
        if isinstance(value, complex):
            raise ValueError("a power of a negative number is not a real number")
        return value

    return apply


@dataclass(frozen=True)
class AtRest:
    """The boom in equilibrium under a load: the argument of functions that packages offer as ``pmr.limits``."""

    load: float  # kg
    luffing: float  # rad
    slewing: float  # rad
    outputs: Mapping[str, float]  # by name: the tip along the boom's axes, probes, forces of supports and at the pivot
    forces: Mapping[str, float]  # N or N m of pads and cylinders by name, positive where they push
    supports: Mapping[str, float]  # N or N m by contact name, such as "base pin x": forces of supports, signs of runs


LimitFunction = Callable[[AtRest], float]


def plugin_function(limit: str, name: str | None) -> LimitFunction:
    """Return the function of the entry point `name`; `limit` is the name of the limit, for messages.

    Raises InputError if the name is None, if no package offers it, or if what is offered is no function.
    """
    offered = environment.plugin_objects("pmr.limits", frozenset())
    function: Any = offered.get(name or "")
    if function is None:
        choices = f"one of {', '.join(sorted(offered))}" if offered else "none: no package offers any"
        raise InputError("study", f"limits.{limit}.function", name, f"{choices} is allowed")
    if not callable(function):
        raise environment.plugin_error("pmr.limits", name or "")
    return cast(LimitFunction, function)


def expression_function(text: str) -> LimitFunction:
    """Compile `text`, an expression in ``load``, ``luffing``, ``slewing``, ``output["name"]`` and ``force["name"]``.

    Raises ValueError with what is not allowed in it.
    """
    value: Value = compile_expression(text, ("load", "luffing", "slewing"), ("output", "force"))

    def evaluate(at: AtRest) -> float:
        """Return the expression's value in the state `at`."""
        numbers = {"load": at.load, "luffing": at.luffing, "slewing": at.slewing}
        return value(numbers | {"output": at.outputs, "force": {**at.forces, **at.supports}})

    return evaluate


def names_in_tables(scene: Scene) -> dict[str, list[str]]:
    """Return the names in the tables ``output`` and ``force`` of expressions on a scene, which need no model.

    The keys are ``output`` and ``force``.  A probe is listed by its name alone; in an expression, what it measures
    follows after a space.
    """
    outputs, supports = list[str](), list[str]()
    for (body, part), member in zip(scene.bodies.items(), members(scene), strict=True):
        if member.number == len(scene.sections) - 1:
            outputs += [qualified_name(body, part.observe.tip_along(axis)) for axis in transverse_axes(member)]
        outputs += [qualified_name(body, part.observe.tip_along(d)) for d in part.observe.rotations]
        outputs += [qualified_name(body, probe.name) for probe in part.probes]
        for support in part.supports:
            rows = [support.row_name(d) for d in support.held_directions if d in motion_directions(member)]
            if support.stiffness == "rigid":
                supports += [reaction_name(qualified_name(body, row)) for row in rows]
            else:
                supports += [qualified_name(body, force_name(row)) for row in rows]
    if scene.frame is not None:
        at_pivot = [*motion_directions(members(scene)[0]), *(["cylinder"] if scene.frame.cylinder else [])]
        outputs += [reaction_name(f"{AT_PIVOT} {axis}") for axis in at_pivot]
    forces = [name for names in force_names(scene).values() for name in names if name not in supports]
    return {"output": [*outputs, *supports], "force": forces}


def check_names(limit: str, text: str, scene: Scene) -> None:
    """Raise InputError for a name that the expression `text` of a limit uses and the scene lacks."""
    for table, columns in names_in_tables(scene).items():
        for name in entry_names(text, table):
            if not any(name == column or (table == "output" and name.startswith(f"{column} ")) for column in columns):
                allowed = f"{similar_name_hint(name, columns)}{table} has {', '.join(columns)}"
                raise InputError("study", f"limits.{limit}.expression", name, allowed)


def amounts_of_states(
    limit_function: LimitFunction, key: str, text: str | None, at: PostureMatrices, k: int
) -> Callable[[LoadedStates], Array]:
    """Return a function from p states to the values (p,) of the user's `limit_function`, for posture `k` of `at`.

    The returned function raises InputError with `key` and `text` (the limit function's name or the expression) if the
    limit function fails or returns NaN.
    """
    luffing, slewing = float(at.place.luffing[k]), float(at.place.slewing[k])

    def amount(load: float, *tables: Mapping[str, float]) -> float:
        """Return the limit function's value under `load` in kg, from `tables` by name: outputs, forces and supports.

        Raises InputError if the function fails or returns NaN.
        """
        try:
            value = float(limit_function(AtRest(load, luffing, slewing, *tables)))
        except KeyError as error:
            name, names = str(error.args[0]), list(chain(*tables))
            allowed = f"it asks for {name!r}: {similar_name_hint(name, names)}{', '.join(names)} are allowed"
            raise InputError("study", key, text, allowed) from None
        except (ArithmeticError, TypeError, ValueError) as error:
            raise InputError("study", key, text, f"it failed: {error!r}") from None
        if np.isnan(value):
            raise InputError("study", key, text, "it returned no number")
        return value

    def amounts(states: LoadedStates) -> Array:
        """Return the limit function's values (p,) in all states."""
        supports = [k for k in at.columns.support_columns() if k < len(at.output_names)]
        of_supports = [support_names(at.columns, k)[1] for k in supports]
        tables = (
            [dict(zip(names, row, strict=True)) for row in of.tolist()]
            for names, of in (
                (at.output_names, states.outputs),
                (at.force_names, states.forces),
                (of_supports, states.outputs[:, supports]),
            )
        )
        return np.array(list(map(amount, states.load.tolist(), *tables)))

    return amounts


AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class TippingMoments:
    r"""Moments about the e edges of the polygon a machine stands on, at one posture; positive moments tip the machine.

    The machine tips over an edge with the unit vector n under the load P in kg for which

    .. math::
        \gamma\, \frac{P\; \hat n \cdot (p + u) \times F_1}{-\hat n \cdot (M - P\, (p + u) \times F_1 + M_m)} = 1

    Here P F_1 is the force of the load, which acts at the tip p, displaced by u.  M is the moment of boom and load: of
    the force and the moment with which the boom presses on its machine at the pivot, as in a run
    (`pmr.simulation.reactions`).  M_m is the moment of the machine's weight, and :math:`\gamma` the limit's factor.
    All vectors are in the axes of the base, which may be inclined.  Edges run anticlockwise.
    """

    machine: Array  # (e,) N m: moment of the machine's weight
    boom: Array  # (e, o): moment of boom and load together, by a unit of each of o outputs
    tip_moment: Array  # (e,) N m/kg: moment of 1 kg of the load at the undeformed tip
    tip_derivative: Array  # (e, o): change of `tip_moment` by a unit of each output

    @classmethod
    def compute(cls, edges: Array, resting: Array, at: PostureMatrices, k: int, amounts: Array) -> TippingMoments:
        """Compute the moments at the k-th posture of `at`, about e edges.

        `edges` (e, 6) are rows whose products with a force and its moment about the pivot are the moments about the
        edges (`pmr.scene.ground.edge_rows`).

        `resting` (6,) is the weight of the machine's masses with its moment about the pivot; `amounts` (w,) are the
        amounts by which the w components ``at.loads`` (weights, load, loads of the scene) act.  Raises InputError if a
        force or moment at the pivot is not among the outputs.
        """
        turned = boom_rotation(at.place.luffing[k : k + 1], at.place.slewing[k : k + 1])[0]
        about = np.hstack([edges[:, :3] @ turned, edges[:, 3:] @ turned])  # rows for forces in the boom's axes
        pull = amounts[at.loads.names.index(HOOK)] * at.hook_force(k)
        moment = np.cross(pull, about[:, 3:])  # rows for displacements of the tip
        return cls(
            machine=edges @ resting,
            boom=about @ pivot_rows(at),
            tip_moment=about[:, :3] @ pull + moment @ at.place.hook[k],
            tip_derivative=moment @ tip_rows(at.output_names, at.output_kinds),
        )

    def share(self, states: LoadedStates, factor: float) -> Array:
        """Return the share (p,) of the resisting moment that `factor` times the load uses, about the worst edge.

        The share is infinite in those of the p states in which no moment resists.
        """
        load = states.load[:, None] * (self.tip_moment + states.outputs @ self.tip_derivative.T)
        held = load - self.machine - states.outputs @ self.boom.T
        return np.asarray(np.where(held > 0.0, factor * load / np.where(held > 0.0, held, 1.0), np.inf).max(axis=1))

    def overturning_load(self, states: LoadedStates, factor: float) -> float:
        """Return the load in kg that stands for boom and load: P + abs(m_b) / (`factor` abs(m_l)).

        P is the acting load, m_l the moment of 1 kg of the load about the worst edge, and m_b the moment of the boom
        about this edge without the load.  `states` hold one state.
        """
        load = states.load[0] * (self.tip_moment + states.outputs[0] @ self.tip_derivative.T)
        boom = states.outputs[0] @ self.boom.T - load
        held = -self.machine - boom
        worst = int(np.argmax(factor * load / np.where(held > 0.0, held, np.nan)))
        return float(states.load[0] * (1.0 + abs(boom[worst]) / (factor * abs(load[worst]))))


def weight_of_masses(masses: Sequence[MachineMass], at: PostureMatrices, k: int, amounts: Array) -> Array:
    """Return the weight of `masses` of the machine and its moment about the pivot (6,) at the k-th posture of `at`.

    The moment is in N m, and both are in the axes of the base.  `amounts` (w,) are the amounts by which the w
    components ``at.loads`` act.  The machine's weight is one of these components.
    """
    turned = boom_rotation(at.place.luffing[k : k + 1], at.place.slewing[k : k + 1])[0]
    weight, up = amounts[at.loads.names.index(MACHINE_WEIGHT)] * at.gravity, turned @ at.place.up[k]
    resting, (c, s) = np.zeros(6), (np.cos(at.place.slewing[k]), np.sin(at.place.slewing[k]))
    for part in masses:
        x, y, z = part.at
        force = -part.mass * weight * up
        place = np.array([c * x - s * y, s * x + c * y, z] if part.slews else part.at)
        resting += np.concatenate([force, np.cross(place, force)])
    return resting


def pivot_rows(at: PostureMatrices) -> Array:
    """Return the rows (6, o) that select force and moment at the pivot from the o outputs of the postures `at`.

    The rows are in the order of `AXES`.  For a planar boom the rows of y, rx and rz are zero.  Raises InputError if any
    other direction is not among the outputs.
    """
    columns, count = at.columns.pivot_columns(), len(at.output_names)
    planar = not {"y", "rx", "rz"} & set(columns)
    missing = [axis for axis in AXES if axis not in columns and not (planar and axis in ("y", "rx", "rz"))]
    if missing:
        allowed = f"a scene whose run has force and moment at the pivot is allowed: {', '.join(missing)} is not known"
        raise InputError("study", "limits", "overturning", allowed)
    rows = np.zeros((6, count))
    for number, axis in enumerate(AXES):
        if axis in columns:
            rows[number, columns[axis]] = 1.0
    return rows


def tip_rows(names: tuple[str, ...], kinds: tuple[str, ...]) -> Array:
    """Return the rows (3, o) that select the tip's displacement along the boom's x, y and z from o outputs.

    `names` and `kinds` (o,) are the outputs' names and kinds.  A direction without an output has a row of zeros.
    """
    tips = [name if kind == "tip" else "" for name, kind in zip(names, kinds, strict=True)]
    return np.array([[name.endswith(axis) for name in tips] for axis in "xyz"], dtype=float)
