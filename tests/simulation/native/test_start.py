"""Forces of contacts at t = 0."""

import numpy as np

from pmr.simulation.native.start import EPS, multipliers_of, unconverged
from pmr.system.contacts import Contact, Place

#: Contacts that give way, and rigid ones.
SOFT, RIGID = np.array([0, 1, 3, 4]), np.array([2, 5])


def test_forces_of_contacts_that_hardly_give_way_are_as_sharp_beside_rigid_ones() -> None:
    """Contacts give way by 1e-12 m/N, as those of a body with attachment modes; rigid ones move it by 1/kg.

    A solve leaves eps times the condition of F in the forces.  In one matrix with the rigid ones that would be eps
    |C|^2 / |F|, some 1e-3.
    """
    rng, (F, forces) = np.random.default_rng(0), given(1e-12)
    C, free = rng.normal(size=(6, 10)), rng.normal(size=10)
    found = multipliers_of(C, F, free, F @ forces, np.zeros(6), None)
    error = np.linalg.norm(found[SOFT] - forces[SOFT])
    assert error <= len(F) * EPS * np.linalg.cond(F[np.ix_(SOFT, SOFT)]) * np.linalg.norm(forces)
    cancel = np.abs(C[RIGID]) @ (np.abs(free) + np.abs(C.T) @ np.abs(found))
    assert np.all(np.abs(C[RIGID] @ (free - C.T @ found)) <= 10 * len(F) * EPS * cancel)  # the rigid ones hold


def test_forces_of_a_body_at_rest_are_those_that_hold_it_where_round_off_is_all_that_gives_way() -> None:
    """Coordinates of some 1 leave eps in the motion, and eps / |F| = 0.2 N in forces that follow from it alone."""
    rng, (F, forces) = np.random.default_rng(1), given(1e-15)
    C, z = rng.normal(size=(6, 10)), rng.normal(size=10)
    z -= np.linalg.pinv(C) @ (C @ z - F @ forces)  # at which the contacts give way under these forces
    round_off = EPS * len(z) * np.abs(C) @ np.abs(z)
    found = multipliers_of(C, F, C.T @ forces, C @ z, round_off, None)
    bound = len(z) * EPS * np.linalg.cond(C) ** 2 * np.linalg.norm(forces)
    np.testing.assert_allclose(found, forces, rtol=0.0, atol=bound)
    moving = C.T @ forces + 0.1 * rng.normal(size=10)  # one that is let go there is held by what its contacts give way
    of_motion = multipliers_of(C, 1e9 * F, moving, C @ z, round_off, None)
    np.testing.assert_allclose((1e9 * F @ of_motion)[SOFT], (C @ z)[SOFT], rtol=0.0, atol=np.max(round_off))


def given(size: float) -> tuple[np.ndarray, np.ndarray]:
    """F (m, m) of some m/N, and forces (m,) in N of the contacts that give way."""
    rng, F, forces = np.random.default_rng(2), np.zeros((6, 6)), np.zeros(6)
    X = rng.normal(size=(4, 4))
    F[np.ix_(SOFT, SOFT)], forces[SOFT] = size * (X @ X.T), 1e4 * rng.normal(size=4)
    return F, forces


def test_forces_that_do_not_converge_are_named() -> None:
    """Those of terms, and friction by the sections that slide; nothing is said of buckling."""
    pads = [Contact(f"pad {k}", Place("fly", "w", 0.0), Place("base", "w", 1.0), friction=0.3) for k in range(2)]
    for terms, contacts, names in (
        (("axial", "spin"), (), "axial, spin"),
        ((), pads, "friction of fly"),
        (("axial",), pads, "axial, friction of fly"),
    ):
        said = unconverged(terms, contacts)
        assert said.startswith(f"the forces of {names} do not converge") and "buckl" not in said
