"""The command ``pmr compile`` of earlier versions."""

from pmr.cli.console import out, say


def compile_() -> None:
    """Say that nothing is left to be compiled before a first run: pip has compiled the step.

    This command of earlier versions goes in version 0.2.
    """
    say(out, "nothing is to be compiled: the step was compiled when pmr was installed")
