"""Numbers in sentences."""

import io
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
import pytest

from pmr import InputError
from pmr.cli import console
from pmr.errors import escape_controls, overview, similar_name_hint, two_digits, two_digits_below, warning_kind

PLAIN = ["[/red]", "[bold]x", "root:x:0", ":smile:", "$x^2$", "\\frac", "<b>&amp;", "ä ß 漢 שלום 😀 F²", "{0} %s", "_F"]
STEERING = {
    "\x1b[31m": r"\x1b[31m", "a\nb\tc\r": r"a\nb\tc\r", "\u202eabc": r"\u202eabc", "\0\x7f\x9b": r"\x00\x7f\x9b",
    "\ud800x\udcff": r"\ud800x\udcff", "\ufffe\ufeff": r"\ufffe\ufeff", "\U000e0041": r"\U000e0041",
}  # fmt: skip


@pytest.mark.parametrize("text", [*PLAIN, *STEERING])
def test_what_steers_is_spelled_out_and_other_text_stays_as_it_is(text: str) -> None:
    """In a page, on a terminal and in the line of an error."""
    plain = escape_controls(text)
    assert plain == STEERING.get(text, text)
    ElementTree.fromstring(f"<t>{escape(plain)}</t>")
    shown = io.StringIO()
    console.Output(file=shown, force_terminal=True, color_system="truecolor", **console.PLAIN).text(text)
    assert shown.getvalue() == plain + "\n"
    line = str(InputError(f"{text}.toml", f"a.{text}", text, f"no {text}"))
    assert len(line.splitlines()) == 1 and escape_controls(line) == line


BEAM = Path("workflows/paper_simple.toml").resolve()


@pytest.mark.parametrize("text", [*PLAIN, *STEERING])
def test_info_shows_a_title_as_it_is(text: str, tmp_path: Path, run_command) -> None:
    scene, quoted = tmp_path / "scene.toml", "".join(f"\\U{ord(letter):08x}" for letter in text)
    scene.write_text(f'extends = "{BEAM}"\ntitle = "{quoted}"\n', encoding="utf-8")
    done = run_command("info", str(scene))
    if any(0xD800 <= ord(letter) < 0xE000 for letter in text):  # halves of a pair are not text, says TOML
        assert done.returncode == 2 and "not valid TOML" in done.stderr
    else:
        assert done.returncode == 0 and done.stdout.splitlines()[0].split(maxsplit=1)[1].strip() == escape_controls(
            text
        )


@pytest.mark.parametrize("name", ["[/red]", ":smile:", "\x1b[31m", "\u202e", "\udcff"])
def test_a_files_name_is_shown_as_it_is(name: str, run_command) -> None:
    done = run_command("run", f"{name}.toml")
    assert done.returncode == 2 and done.stderr == f"pmr: {escape_controls(name)}.toml: no such scene file\n"


KINDS = {
    "the model is off by up to 1e+02 % beside a shell, more than 0.05": "the model is off by up to % beside a shell",
    "3 of 4 pads of the ring tail pull the body, most of all left": "of pads of the ring tail pull the body",
    "second order is left out: axial forces change the stiffness": "second order is left out",
    "the step does not resolve the highest mode (h omega = .5)": "the step does not resolve the highest mode",
}


@pytest.mark.parametrize("warning", KINDS)
def test_a_kind_of_warning_is_the_same_whatever_its_numbers(warning: str) -> None:
    assert warning_kind(warning) == KINDS[warning]


def test_an_overview_shows_the_first_names_and_the_last_one() -> None:
    shown = overview("Response at 3 times", forces=["a", "b", "c", "d"], outputs=["tip z"], others=[])
    assert shown.splitlines() == [
        "Response at 3 times",
        "  forces (4): a, b, ..., d",
        "  outputs (1): tip z",
        "  others (0)",
    ]


def test_a_name_that_comes_first_is_meant_rather_than_one_that_is_as_long() -> None:
    names = ["stress", "cylinder", "luffing", "pad"]
    assert similar_name_hint("luffing cylinder", names) == "did you mean 'luffing'? "
    assert similar_name_hint("cilinder", names) == "did you mean 'cylinder'? "
    assert similar_name_hint("angle", names) == ""


def test_large_numbers_are_decimals() -> None:
    assert [two_digits(x) for x in (122.0, 9870.0, 100.0, 0.061, 2.0, 0.0, 470.4)] == (
        ["120", "9900", "100", "0.061", "2", "0", "470"]
    )


def test_what_is_small_enough_is_not_rounded_up() -> None:
    assert [two_digits_below(x) for x in (0.0028525, 0.000286, 0.29, 1.0, 2e-3, 1e-3, 0.1, 0.3)] == (
        ["0.0028", "0.00028", "0.29", "1", "0.002", "0.001", "0.1", "0.3"]
    )
    for value in 10.0 ** np.random.default_rng(0).uniform(-9.0, 9.0, 1000):
        assert 0.9 * value < float(two_digits_below(value)) <= value * (1.0 + 1e-11)
