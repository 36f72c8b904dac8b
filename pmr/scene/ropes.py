"""Which sections hang on ropes or chains that other ones drive, and what these bear of them."""

from __future__ import annotations

from pmr.scene.scene import Scene


def borne(scene: Scene) -> dict[str, dict[str, float]]:
    r"""Shares of what sections need along the boom that a rope or cylinder bears, by the section it moves.

    :math:`T_j = F_j + \sum_{k\ \mathrm{follows}\ j} r_k T_k`, of each section that follows another one or is followed.
    """
    names = scene.names[1:]
    follows = {name: scene.joint(k).follows for k, name in enumerate(names, 1)}
    joined = [name for name in names if follows[name] is not None or name in follows.values()]

    def of(name: str) -> dict[str, float]:
        found = {name: 1.0}
        for other in joined:
            if follows[other] == name:
                ratio = scene.joint(scene.names.index(other)).ratio
                for one, share in of(other).items():
                    found[one] = found.get(one, 0.0) + ratio * share
        return found

    return {name: of(name) for name in joined}
