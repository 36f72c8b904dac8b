"""What the way of a scene's bodies through a run consists of, for a body alone and for sections."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmr.compare.accuracy import order
from pmr.compare.summary import Part
from pmr.errors.environment import Clock
from pmr.fullmodel.build import Built, build_bodies
from pmr.reduction.cache import Cache
from pmr.reduction.recover.from_scene import Recovered
from pmr.results import BodyResult, Frequencies, FrequencyResponse, Response
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.petsc import Checkpoint
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motions:
    """What simulators say; responses, their seconds and states of the reduced model are known on rank 0 alone."""

    responses: Mapping[str, Response]  # by model
    seconds: Mapping[str, float]  # of each simulator, and each reference
    agreement: Mapping[str, float]  # of the simulators of the reduced model, m
    simulators: Mapping[str, str]  # of the reduced model and the full one
    missing: Mapping[str, str]  # why a reference is none
    states: Any  # of the reduced model, as `Bodies.recover` takes them; None beside rank 0
    full: Mapping[str, Array]  # this rank's rows of the full coordinates at the recovered steps, by body


@dataclass(frozen=True)
class Judged:
    """What motions say beside each other."""

    parts: Sequence[Part]
    responses: Mapping[str, Response]
    frequency_response: FrequencyResponse | None
    tip_error: Array | None  # (T, d) m
    bodies: Mapping[str, BodyResult]


class Bodies(ABC):
    """The bodies of a scene, reduced as it asks, with the step and the coordinates that hold its tolerance."""

    STAGES: ClassVar[tuple[str, ...]]  # whose seconds stand in summary.json, beside those of the simulators
    scene: Scene
    choice: order.Choice | None
    excitation: Excitation

    def __init__(self, scene: Scene, built: Mapping[str, Built], clock: Clock, caches: Mapping[str, Cache]) -> None:
        self.scene, self.built, self.clock, self.caches = scene, built, clock, caches
        self.comm = next(iter(built.values())).model.comm

    @property
    def size(self) -> int:
        """Coordinates of the full models."""
        return sum(one.model.size for one in self.built.values())

    def build(self, scene: Scene) -> Mapping[str, Built]:
        """The full models of a scene on the same ranks."""
        return build_bodies(scene, self.comm)

    @property
    @abstractmethod
    def system(self) -> System:
        """Of the reduced bodies."""

    @abstractmethod
    def frequencies(self) -> Frequencies:
        """The lowest natural frequencies on the way; collective."""

    @abstractmethod
    def simulate(self, checkpoint: Checkpoint | None) -> Motions:
        """The reduced model by all simulators, and the references; collective."""

    @abstractmethod
    def recover(self, motions: Motions) -> Mapping[str, Recovered]:
        """The fields that the scene asks for, by body; collective."""

    @abstractmethod
    def judge(self, motions: Motions, frequencies: Frequencies, seen: Mapping[str, Recovered]) -> Judged:
        """What motions and frequencies say; on rank 0."""
