"""A beam's axis as a polyline: nodes, element frames, and the step from element to global coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Polyline:
    """Straight segments, each divided evenly.

    Attributes
    ----------
    nodes : (N, 3) array, m
        Along the axis; corners are nodes.
    frames : (N - 1, 3, 3) array
        Rows of each element's matrix are its unit vectors: along the axis, y, z of the section.
    segment : (N - 1,) integer array
        The segment of each element.
    """

    nodes: Array
    frames: Array
    segment: Indices

    @cached_property
    def stations(self) -> Array:
        """Distance of the nodes from the first one along the axis (N,) m."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.nodes, axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Of the whole axis, m."""
        return float(self.stations[-1])

    @property
    def local_cells(self) -> Indices:
        """Element ends (N - 1, 2) as numbers of local nodes: a corner is one local node for each of its segments."""
        first = np.arange(len(self.segment)) + self.segment
        return np.stack([first, first + 1], axis=1)

    @property
    def local_stations(self) -> Array:
        """Distance of each local node along the axis (l,) m."""
        count = len(self.segment) + int(self.segment[-1]) + 1
        at = np.empty(count)
        at[self.local_cells[:, 0]], at[self.local_cells[:, 1]] = self.stations[:-1], self.stations[1:]
        return at

    def transformation(self) -> sp.csr_matrix:
        r"""T (6 l, 6 N): element coordinates u, phi, v, v', w, w' of each local node from the global u, theta.

        .. math:: u = e_1 \cdot U, \; \phi = e_1 \cdot \Theta, \; v = e_2 \cdot U, \; v' = e_3 \cdot \Theta,
                  \; w = e_3 \cdot U, \; w' = -e_2 \cdot \Theta
        """
        blocks = []
        for element, ends in enumerate(self.local_cells):
            e1, e2, e3 = self.frames[element]
            for end, node in enumerate(ends):
                blocks.append((node, element + end, e1, e2, e3))
        rows, columns, entries = [], [], []
        seen = set()
        for local, node, e1, e2, e3 in blocks:
            if local in seen:
                continue
            seen.add(local)
            for i, (vector, rotation) in enumerate(
                [(e1, False), (e1, True), (e2, False), (e3, True), (e3, False), (-e2, True)]
            ):
                rows += [6 * local + i] * 3
                columns += list(6 * node + 3 * rotation + np.arange(3))
                entries += list(vector)
        shape = (6 * len(self.local_stations), 6 * len(self.nodes))
        T = sp.csr_matrix((entries, (rows, columns)), shape=shape)
        T.eliminate_zeros()
        return T


def divided(points: Array, up: Array, elements: int) -> Polyline:
    """A polyline through `points` (p, 3) m with about `elements` elements, at least one a segment."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    counts = np.maximum(1, np.round(elements * lengths / lengths.sum())).astype(int)
    nodes, frames = [points[:1]], []
    for start, step, length, count in zip(points[:-1], steps, lengths, counts, strict=True):
        nodes.append(start + step * (np.arange(1, count + 1) / count)[:, None])
        e1 = step / length
        e3 = up - (up @ e1) * e1
        e3 /= np.linalg.norm(e3)
        frames.append(np.tile([e1, np.cross(e3, e1), e3], (count, 1, 1)))
    return Polyline(np.concatenate(nodes), np.concatenate(frames), np.repeat(np.arange(len(counts)), counts))
