"""A system of bodies: what joins them, their frequencies, and their equilibrium."""

from dataclasses import replace

import numpy as np
import pytest
from complementarity import by_least_squares
from nested import FROM_END, LENGTH, Box, Nested, full, full_section, plain, reduced, reduced_section
from on_pads import beam_on_pads, modes_on_pads
from oracle import flexible, rich_body

from pmr import InputError, System
from pmr.errors import BEYOND_ENDS
from pmr.simulation.statics.equilibrium import Equilibrium, equilibrium
from pmr.system.assembly import Assembly
from pmr.system.contacts import ALONE, SLIDER, Contact, Place
from pmr.system.rows import Rows, fixed_row, sparse_row

#: Hz, retracted to 5.4 m of overlap and extended to 1.5 m, of a separate planar code.
FREQUENCIES = {
    (2, 5.4): (5.865, 36.98, 60.52), (2, 1.5): (2.908, 17.35, 57.16), (3, 5.4): (4.975, 29.05, 39.74),
    (3, 1.5): (1.577, 8.429, 23.71), (4, 5.4): (4.400, 22.50, 33.54),
}  # fmt: skip


def coordinates(system: System, overlap: float) -> np.ndarray:
    return system.side_coordinates({path: LENGTH - overlap for path in system.paths})


@pytest.mark.parametrize(("count", "overlap"), FREQUENCIES)
def test_frequencies_to_four_digits(count: int, overlap: float) -> None:
    system, small = full(Nested(count)), reduced(Nested(count), 3)
    found = Assembly(system).frequencies(coordinates(system, overlap), 3)
    assert [float(f"{f:.4g}") for f in found] == list(FREQUENCIES[count, overlap])
    assert Assembly(small).frequencies(coordinates(small, overlap), 3) == pytest.approx(found, rel=1e-4)


def test_rows_of_many_places_are_those_of_each_and_take_no_matrix_of_the_bodies() -> None:
    system = reduced(Nested(3), 3)
    assembly, x = Assembly(system), np.stack([coordinates(system, overlap) for overlap in (5.4, 3.0, 1.5)])
    together = assembly.contact_rows_over_time(x)
    for k, at in enumerate(x):
        one = assembly.contact_rows(at)
        for name in ("C", "F", "H", "X"):
            found, expected = getattr(together, name)[k], getattr(one, name)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max(initial=1e-300))
    assert not {"M", "D", "K", "B", "outputs"} & set(vars(assembly))


def test_modes_are_those_of_the_frequencies() -> None:
    """M-orthonormal, of no motion that rigid contacts hold, and in balance but for the forces of these."""
    system = full(Nested(3, elements=12))
    system = replace(system, contacts=(replace(system.contacts[0], compliance=0.0), *system.contacts[1:]))
    assembly, x = Assembly(system), coordinates(system, 3.0)
    rows = assembly.contact_rows(x)
    omega, phi = assembly.modes(rows, 4)
    assert omega == pytest.approx(2.0 * np.pi * assembly.frequencies(x, 4), rel=1e-6)
    np.testing.assert_allclose(phi.T @ assembly.M @ phi, np.eye(4), atol=1e-9)
    assert np.abs(rows.C[0] @ phi).max() < 1e-12 * np.abs(phi).max() * np.abs(rows.C[0]).sum()
    soft = rows.select(np.any(rows.F != 0.0, axis=1))
    springs = soft.C @ phi
    stored = phi.T @ assembly.K @ phi + springs.T @ np.linalg.solve(soft.F, springs)
    np.testing.assert_allclose(stored, np.diag(omega**2), rtol=1e-6, atol=1e-6 * omega[-1] ** 2)


def test_four_sections_extended() -> None:
    """The other code stopped a few millimetres short: its figures, 1.000 4.857 13.30 Hz, are those of 1.507 m."""
    system = full(Nested(4))
    found = Assembly(system).frequencies(coordinates(system, 1.507), 3)
    assert found == pytest.approx((1.000, 4.857, 13.30), rel=7e-4)


#: MathWorks' boom lift: outer sizes of base, mid and fly; the tip mass fits its first frequency with rigid overlaps.
LIFT = [
    Box(5.090, 0.2515, 0.3216, 6.35e-3, 70e9, 2700.0, 60, clamped=True),
    Box(4.785, 0.2007, 0.2666, 6.35e-3, 70e9, 2700.0, 60),
    Box(4.478, 0.1626, 0.2307, 6.43e-3, 70e9, 2700.0, 60, tip_mass=182.0),
]
#: Overlap as a share of the fly, first frequency in Hz with two rigid pads at the ends of each overlap.
RIGID_PADS = [
    (0.05, 0.8888), (0.10, 0.9407), (0.15, 0.9978), (0.20, 1.0609), (0.25, 1.1306), (0.30, 1.2082), (0.35, 1.2948),
]  # fmt: skip


@pytest.mark.parametrize(("share", "frequency"), RIGID_PADS)
def test_a_published_boom_lift_on_rigid_pads(share: float, frequency: float) -> None:
    """Rigid contacts in full order; a stiffness of 1e12 N/m in its place with two elastic modes a section."""
    overlap, names, contacts = share * LIFT[2].length, ("base", "mid", "fly"), []
    for outer, inner, one in zip(names[:-1], names[1:], LIFT[:-1], strict=True):
        contacts += [
            Contact(f"tail {inner}", Place(inner, "w"), Place(outer, "w", one.length - overlap)),
            Contact(f"mouth {outer}", Place(inner, "w", overlap), Place(outer, "w", one.length)),
        ]
    system = System({name: full_section(one) for name, one in zip(names, LIFT, strict=True)}, tuple(contacts))
    assert Assembly(system).frequencies(system.side_coordinates({}), 1)[0] == pytest.approx(frequency, rel=1e-4)
    small = {name: reduced_section(one, 2) for name, one in zip(names, LIFT, strict=True)}
    stiff = System(small, tuple(replace(contact, compliance=1e-12) for contact in contacts))
    assert Assembly(stiff).frequencies(stiff.side_coordinates({}), 1)[0] == pytest.approx(frequency, rel=2e-4)


def loads(system: System, gravity: float, tip: float) -> np.ndarray:
    return np.array([tip if name.endswith(".F") else gravity for name in system.input_names])


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("overlap", [5.4, 2.03])
def test_statics_are_exact_with_the_fewest_modes(count: int, overlap: float) -> None:
    """With residual flexibility, that between rows on two paths among it; plain modes are not."""
    boom, lines = Nested(count), []
    for system in (full(boom), reduced(boom, 1), plain(boom, 1)):
        assembly, x, f = Assembly(system), coordinates(system, overlap), loads(system, 9.81, -2e3)
        state, rows = equilibrium(assembly, x, f), assembly.contact_rows(x)
        lines.append(assembly.outputs @ state.q + assembly.direct @ f - rows.X @ state.forces)
    largest = np.abs(lines[0]).max()
    assert np.abs(lines[1] - lines[0]).max() < 1e-6 * largest
    assert np.abs(lines[2] - lines[0]).max() > 1e-3 * largest


def test_contacts_carry_the_weight() -> None:
    """Forces and moments of each section from the pads at its ends, in closed form; full and reduced."""
    overlap, g, F = 3.3, 9.81, -2e3
    for system in (full(Nested(3, elements=10)), reduced(Nested(3), 2)):
        found = equilibrium(Assembly(system), coordinates(system, overlap), loads(system, g, F)).forces
        forces = dict(zip(system.contact_names, found, strict=True))
        weight = {name: -one.mass_per_length * LENGTH * g for name, one in zip("12", Nested(3).boxes[1:], strict=True)}
        for name, outer in (("1", "0"), ("2", "1")):
            tail, mouth, at = forces[f"tail {name}"], forces[f"mouth {outer}"], overlap - FROM_END
            up, moment = weight[name], weight[name] * LENGTH / 2.0
            if name == "2":
                up, moment = up + F - 250.0 * g, moment + (F - 250.0 * g) * LENGTH
            else:
                up += forces["tail 2"] + forces["mouth 1"]
                moment += forces["tail 2"] * (FROM_END + LENGTH - overlap) + forces["mouth 1"] * (LENGTH - FROM_END)
            # lambda pushes the inner section down where it has come up
            assert tail + mouth == pytest.approx(up, rel=1e-9)
            assert tail * FROM_END + mouth * at == pytest.approx(moment, rel=1e-9)


@pytest.mark.parametrize("tip", [-2e3, 9e4])
@pytest.mark.parametrize("clearance", [0.0, 1e-3])
def test_pads_that_only_push_against_non_negative_least_squares(tip: float, clearance: float) -> None:
    boom = Nested(3, elements=10, clearance=clearance, compliance=1e-7)
    found: list[Equilibrium] = []
    for system in (full(boom), reduced(boom, 1)):
        x, f = coordinates(system, 2.4), loads(system, 9.81, tip)
        found.append(equilibrium(Assembly(system), x, f))
    assert found[0].forces.min() >= 0.0 and 0 < found[0].closed.sum() < len(found[0].forces)
    expected = by_least_squares(full(boom), x, f)
    largest = np.abs(expected).max()
    assert np.abs(found[0].forces - expected).max() < 1e-9 * largest
    assert np.abs(found[1].forces - found[0].forces).max() < 1e-9 * largest
    assert np.array_equal(found[0].closed, found[1].closed)


def test_a_section_that_nothing_holds_has_no_equilibrium() -> None:
    for system in (full(Nested(2, elements=10)), full(Nested(2)), reduced(Nested(2), 3)):
        for count in (0, 1):
            loose = System(system.bodies, system.contacts[:count])
            with pytest.raises(InputError, match="together hold every motion of the bodies"):
                equilibrium(Assembly(loose), loose.side_coordinates({"1": 1.0}), loads(loose, 9.81, 0.0))


PLACE = Place("1", "w", 0.15)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"direction": 0.5}, "contacts.pad.direction = 0.5: 1 or -1"),
        ({"compliance": -1.0}, "contacts.pad.compliance"),
        ({"clearance": -1e-3}, "contacts.pad.clearance"),
        ({"outer": Place("1", "w", 0.2)}, "another body than the inner one"),
        ({"friction": -0.1}, "contacts.pad.friction = -0.1: 0 or more is allowed"),
        ({"friction": np.nan}, "contacts.pad.friction"),
        ({"friction": 0.2, "static_friction": 0.1}, "contacts.pad.static_friction = 0.1: 0.2 or more is allowed"),
        ({"stribeck_speed": 0.0}, "contacts.pad.stribeck_speed = 0.0: more than 0 m/s is allowed"),
        ({"kind": "suport"}, "contacts.pad.kind = 'suport': pad, cylinder, support, straight are allowed"),
        ({"bears": (("rope", np.nan),)}, "contacts.pad.bears = .*: finite shares are allowed"),
        ({"arm": np.nan}, "contacts.pad.arm = nan: a finite number, in m, is allowed"),
        ({"shear_stiffness": np.inf}, "contacts.pad.shear_stiffness = inf: more than 0 N/m is allowed"),
    ],
)
def test_contacts_that_mean_nothing(change: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Contact("pad", **({"inner": PLACE} | change))


@pytest.mark.parametrize(
    ("contacts", "said"),
    [
        ([Contact("a", PLACE), Contact("a", PLACE)], "names that differ"),
        ([Contact("a", replace(PLACE, body="9"))], "contacts.a.body = '9': 0, 1 are allowed"),
        ([Contact("a", replace(PLACE, row="v"))], "contacts.a.row = 'v': w are allowed on 1"),
        ([Contact("a", PLACE, friction=0.2)], "friction = 0.2: 0 is allowed, or a place that travels on the path '1'"),
        ([Contact("a", replace(PLACE, path="0"), Place("0", "w"), friction=0.2)], "travels on the path '1'"),
    ],
)
def test_systems_that_do_not_fit(contacts: list, said: str) -> None:
    bodies = reduced(Nested(2, elements=10), 2).bodies
    with pytest.raises(InputError, match=said):
        System(bodies, tuple(contacts))


def test_places_beyond_a_body_and_paths_that_are_missing() -> None:
    system = reduced(Nested(2, elements=10), 2)
    with pytest.raises(InputError, match="0 to 6 m are allowed on 0"):
        system.side_coordinates({"1": 6.0})
    end = LENGTH - FROM_END  # of a place on the outer section, which measured paths overshoot
    beyond = system.side_coordinates({"1": end + 0.9 * BEYOND_ENDS * LENGTH})
    np.testing.assert_allclose(beyond, [FROM_END, LENGTH, 0.0, end], rtol=0.0, atol=1e-14)
    with pytest.raises(InputError, match="contacts.tail 1.path = '1': a path for it is needed; given: none"):
        system.side_coordinates({})


def test_a_support_of_several_coordinates_is_a_contact() -> None:
    system = full(Nested(2, elements=10))
    body = system.bodies["1"]
    held = fixed_row("axle", sparse_row([3, 7], [1.0, -2.0], body.size), (0.0, LENGTH))
    bodies = dict(system.bodies) | {"1": replace(body, rows=Rows((*body.rows.rows, held), body.size))}
    with pytest.raises(InputError, match="the row axle always holds 1: a contact of it with the ground is needed"):
        System(bodies, system.contacts)
    joined = System(bodies, (*system.contacts, Contact("axle", Place("1", "axle"))))
    x, f = joined.side_coordinates({"1": 1.0}), loads(joined, 9.81, 0.0)
    a = Assembly(joined)
    q = equilibrium(a, x, f).q[a.coordinate_slices["1"]]
    assert q[3] - 2.0 * q[7] == pytest.approx(0.0, abs=1e-10 * np.abs(q).max())


def test_a_body_alone_with_tables_over_its_path_is_a_system() -> None:
    """Two sliders and a support with residual flexibility: rows, what they give way by, and what loads move."""
    model = replace(flexible(rich_body(), 6), pads=np.array([2e-6, 3e-6]))
    system, s = System.of(model), np.array([1.7, 2.3])
    tables, rows = model.flexibility, Assembly(system).contact_rows_over_time(system.side_coordinates({"slider": s}))
    assert tables is not None and model.carriers is None
    for k, at in enumerate(s):
        np.testing.assert_array_equal(rows.C[k], model.C(at))
        np.testing.assert_allclose(rows.F[k], tables.rows(at) + np.diag(model.row_compliance), rtol=1e-14)
        np.testing.assert_array_equal(rows.H[k], tables.inputs(at))
        np.testing.assert_array_equal(rows.X[k], tables.outputs(at))
    np.testing.assert_array_equal(Assembly(system).direct, tables.direct)
    assert system.ranges == {"slider": model.domain}


def test_paths_lead_as_far_as_the_rows_that_travel_on_them() -> None:
    """Ahead with a pad at the tail, backwards with one at the mouth."""
    system = reduced(Nested(3, elements=10), 2)
    for low, high in system.ranges.values():
        assert (low, high) == (pytest.approx(-FROM_END), pytest.approx(LENGTH - FROM_END))


def test_bodies_without_carriers_are_refused() -> None:
    bodies = dict(reduced(Nested(2, elements=10), 2).bodies)
    bodies["1"] = replace(bodies["1"], carriers=None)
    with pytest.raises(InputError, match="bodies.1: a model with carriers"):
        System(bodies, ())


def test_a_body_alone_needs_no_carriers_as_long_as_its_places_share_one_path() -> None:
    body = modes_on_pads(beam_on_pads(1e-3), 4)
    assert body.carriers is None
    system = System.of(body)
    assert system.on_one_path and system.side_coordinates({SLIDER: 3.0}).tolist() == [body.domain[0]] * 2 + [3.0] * 2
    with pytest.raises(InputError, match="contacts.mouth bottom.place = 99"):
        system.side_coordinates({SLIDER: 99.0})
    contacts = (*system.contacts[:2], replace(system.contacts[2], inner=Place(ALONE, body.row_names[2], path="other")))
    with pytest.raises(InputError, match="bodies.: a model with carriers"):
        System({ALONE: body}, (*contacts, system.contacts[3]))
