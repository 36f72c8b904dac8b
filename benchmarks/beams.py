"""Models of the paper's beam in all the sizes that the benchmarks need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr import scene as scenes
from pmr.fullmodel.build import full_model
from pmr.pipeline import reduce
from pmr.scene import Scene
from pmr.scene.signals import SignalBase, Sine
from pmr.simulation import Excitation
from pmr.simulation.modal import ModalForm, modal_form
from pmr.system.body import FullBody, project
from pmr.system.reduced_model import ReducedModel

Array = NDArray[np.float64]
WORKFLOWS = Path(__file__).resolve().parents[1] / "workflows"
#: Crane with rigid walls and pads that hold both ways, as the workflow `crane` was when it was first measured.
CRANE = WORKFLOWS.parent / "tests" / "machines" / "crane.toml"
STRETCHES = 8
CASES = {"simple": "paper_simple.toml", "evolved": "paper_evolved.toml"}


class Later(SignalBase):
    """Signal that starts in the middle of another one: its value at t is that of `signal` at t + `begin`."""

    signal: SignalBase
    begin: float

    def value(self, t: ArrayLike) -> Array:
        """Values at the times t in s."""
        return self.signal.value(np.asarray(t) + self.begin)

    def rate(self, t: ArrayLike) -> Array:
        """Rates at the times t in s."""
        return self.signal.rate(np.asarray(t) + self.begin)


def shorter(excitation: Excitation, share: float) -> Excitation:
    """Shorten an excitation to the share `share` of its steps, from the beginning."""
    stepping = excitation.stepping
    steps = max(1, round(share * stepping.steps))
    return excitation.with_stepping(replace(stepping, end=steps * stepping.step))


def stretches(excitation: Excitation, share: float) -> list[Excitation]:
    """Split an excitation into `STRETCHES` short ones, spread evenly, that make up the share `share` of it.

    Each starts from rest.  For a share of 1 the excitation itself is the only one.
    """
    if share == 1.0:
        return [excitation]
    step, part = excitation.stepping.step, excitation.stepping.end / STRETCHES
    length = max(1, round(share * excitation.stepping.steps / STRETCHES)) * step
    begins = [(k + 0.5) * part - 0.5 * length for k in range(STRETCHES)]
    stepping = replace(excitation.stepping, end=length)
    return [Excitation(_later(excitation.paths, t), _later(excitation.loads, t), stepping) for t in begins]


def _later(signals: Mapping[str, SignalBase], begin: float) -> dict[str, SignalBase]:
    """Signals that start at `begin` s."""
    return {name: Later(signal=signal, begin=begin) for name, signal in signals.items()}


@cache
def scene(name: str, *settings: str) -> Scene:
    """Load a scene of `workflows/`, with settings as ``--set`` takes them."""
    return scenes.load(WORKFLOWS / name, list(settings))


def drive(name: str) -> Excitation:
    """Excitation of a case of the paper."""
    return Excitation.from_scene(scene(CASES[name]))


def sliding(steps: int) -> Excitation:
    """Load of the evolved case while the slider moves to and fro in every step, so that all steps cost the same."""
    case = drive("evolved")
    end = steps * case.stepping.step
    path = Sine(amplitude=1.25, frequency=1.0 / end, offset=2.5)
    return Excitation({"slider": path}, case.loads, replace(case.stepping, end=end))


@cache
def full(name: str = "evolved", elements: int | None = None, *settings: str) -> FullBody:
    """Full model of a case; of 50 elements, 153 coordinates, unless `elements` says otherwise."""
    more = () if elements is None else (f"mesh.elements={elements}",)
    body = full_model(scene(CASES[name], *more, *settings)).gather()
    assert body is not None
    return body


@cache
def dense(name: str) -> ReducedModel:
    """Full model of a case with dense matrices, as the paper simulates it."""
    body = full(name)
    return project(body, np.eye(body.size))


@cache
def reduced(name: str) -> ReducedModel:
    """Reduced model of the paper: 20 coordinates, of which the pin's rows hold two."""
    return reduce(scene(CASES[name])).reduced


@cache
def plain(coordinates: int) -> ReducedModel:
    """Reduced model of the evolved case on POD vectors, without the rows that these satisfy."""
    settings = (f"reduction.coordinates={coordinates}", "reduction.basis=eigenmodes")
    return reduce(scene(CASES["evolved"], *settings)).reduced


@cache
def flexible(coordinates: int) -> ReducedModel:
    """Reduced model of the evolved case on free modes, with the residual flexibility of the truncated ones."""
    return reduce(scene("evolved_residual.toml", f"reduction.coordinates={coordinates}")).reduced


@cache
def modal(elements: int = 50, sliders: int = 1) -> ModalForm:
    """Full beam of the evolved case in modal form, held by `sliders` sliders 0.2 m apart."""
    offsets = "[" + ", ".join(f"{0.2 * k:g}" for k in range(sliders)) + "]"
    return modal_form(full("evolved", elements, f"slider.offsets={offsets}", "compare.against=['full']"))


def leading(form: ModalForm, modes: int) -> ModalForm:
    """Truncate a modal form to its lowest modes."""
    return ModalForm(form.body.leading(modes), form.X[:, :modes], form.inverse[:modes], form.rows)
