"""Words for a start or a step that fails."""

from pmr.simulation.refusals import describe_divergence
from pmr.system.contacts import Contact, Place


def test_forces_that_do_not_converge_are_named() -> None:
    """Those of terms, and friction by the sections that slide; nothing is said of buckling."""
    pads = [Contact(f"pad {k}", Place("fly", "w", 0.0), Place("base", "w", 1.0), friction=0.3) for k in range(2)]
    for terms, contacts, names in (
        (("axial", "spin"), (), "axial, spin"),
        ((), pads, "friction of fly"),
        (("axial",), pads, "axial, friction of fly"),
    ):
        said = describe_divergence(terms, contacts, 100)
        assert said.startswith(f"the forces of {names} do not converge") and "buckl" not in said
