"""The paper's beam in all the sizes that the benchmarks ask for."""

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
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.signals import SignalBase, Sine
from pmr.simulation import Excitation
from pmr.simulation.modal import ModalForm, modal_form
from pmr.system.body import FullBody, projected

Array = NDArray[np.float64]
WORKFLOWS = Path(__file__).resolve().parents[1] / "workflows"
STRETCHES = 8
CASES = {"simple": "paper_simple.toml", "evolved": "paper_evolved.toml"}


class Later(SignalBase):
    """A signal from some time on: its value at t is that of another one at t + begin."""

    signal: SignalBase
    begin: float

    def value(self, t: ArrayLike) -> Array:
        return self.signal.value(np.asarray(t) + self.begin)

    def rate(self, t: ArrayLike) -> Array:
        return self.signal.rate(np.asarray(t) + self.begin)


def shorter(excitation: Excitation, share: float) -> Excitation:
    """The beginning of it."""
    stepping = excitation.stepping
    steps = max(1, round(share * stepping.steps))
    return excitation.with_stepping(replace(stepping, end=steps * stepping.step))


def stretches(excitation: Excitation, share: float) -> list[Excitation]:
    """All of it, or eight stretches that make up a share, spread evenly, each from rest."""
    if share == 1.0:
        return [excitation]
    step, part = excitation.stepping.step, excitation.stepping.end / STRETCHES
    length = max(1, round(share * excitation.stepping.steps / STRETCHES)) * step
    begins = [(k + 0.5) * part - 0.5 * length for k in range(STRETCHES)]
    stepping = replace(excitation.stepping, end=length)
    return [Excitation(_later(excitation.paths, t), _later(excitation.loads, t), stepping) for t in begins]


def _later(signals: Mapping[str, SignalBase], begin: float) -> dict[str, SignalBase]:
    return {name: Later(signal=signal, begin=begin) for name, signal in signals.items()}


@cache
def scene(name: str, *settings: str) -> Scene:
    """A scene of `workflows/`, with settings as ``--set`` takes them."""
    return scenes.load(WORKFLOWS / name, list(settings))


def drive(name: str) -> Excitation:
    """What moves the beam in a case of the paper."""
    return Excitation.of(scene(CASES[name]))


def sliding(steps: int) -> Excitation:
    """The evolved case's load while the slider moves to and fro in every step, so that none is cheaper than another."""
    case = drive("evolved")
    end = steps * case.stepping.step
    path = Sine(amplitude=1.25, frequency=1.0 / end, offset=2.5)
    return Excitation({"slider": path}, case.loads, replace(case.stepping, end=end))


@cache
def full(name: str = "evolved", elements: int | None = None, *settings: str) -> FullBody:
    """The full model of a case, 153 coordinates unless `elements` says otherwise."""
    more = () if elements is None else (f"mesh.elements={elements}",)
    body = full_model(scene(CASES[name], *more, *settings)).gather()
    assert body is not None
    return body


@cache
def dense(name: str) -> ReducedModel:
    """The full model with dense matrices, as the paper simulates it."""
    body = full(name)
    return projected(body, np.eye(body.size))


@cache
def reduced(name: str) -> ReducedModel:
    """The paper's reduced model: 20 coordinates, two of which its pin's rows hold."""
    return reduce(scene(CASES[name])).reduced


@cache
def plain(coordinates: int) -> ReducedModel:
    """The evolved case on that many POD vectors, rows that they satisfy left out."""
    settings = (f"reduction.coordinates={coordinates}", "reduction.basis=eigenmodes")
    return reduce(scene(CASES["evolved"], *settings)).reduced


@cache
def flexible(coordinates: int) -> ReducedModel:
    """The evolved case on free modes, with the residual flexibility of the rest."""
    return reduce(scene("evolved_residual.toml", f"reduction.coordinates={coordinates}")).reduced


@cache
def modal(elements: int = 50, sliders: int = 1) -> ModalForm:
    """A full beam in modal form, held by several sliders 0.2 m apart."""
    offsets = "[" + ", ".join(f"{0.2 * k:g}" for k in range(sliders)) + "]"
    return modal_form(full("evolved", elements, f"slider.offsets={offsets}", "compare.against=['full']"))


def leading(form: ModalForm, modes: int) -> ModalForm:
    """The lowest modes alone."""
    return ModalForm(form.body.leading(modes), form.X[:, :modes], form.inverse[:modes], form.rows)
