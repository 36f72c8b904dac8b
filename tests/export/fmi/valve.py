"""FMU of valve.c: what `loop.Luffing` does, as a second unit beside a crane's."""

import subprocess
import zipfile
from pathlib import Path

from export.fmi import loop

PARAMETERS, INPUTS = ("wanted", "start"), ("tip", "force")
OUTPUTS = ("luffing", "luffing_rate", "luffing_rate_2", "luffing_rate_3")
TOKEN = "{7d7c4a0e-4f1e-4a53-9d1c-valve}"


def written(target: Path) -> Path:
    """Compile the FMU for this machine, write it to `target`, and return its path."""
    kp, ki, kd = loop.GAINS
    constants = {"WANTED_ANGLE": loop.WANTED, "KP": kp, "KI": ki, "KD": kd, "OIL": loop.OIL, "LINES": loop.LINES}
    shared, source = target.with_suffix(".so"), Path(__file__).with_name("valve.c")
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fPIC", "-shared"]
    defined = [f"-D{name}={float(value)!r}" for name, value in constants.items()]
    subprocess.run(["cc", *flags, *defined, str(source), "-o", str(shared)], check=True)
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description())
        archive.write(shared, "binaries/linux64/valve.so")
    return target


def description() -> str:
    """Description of the FMU, with variables numbered as in valve.c."""
    kinds = [('causality="parameter" variability="fixed"', name, ' start="0"') for name in PARAMETERS]
    kinds += [('causality="input"', name, ' start="0"') for name in INPUTS]
    kinds += [('causality="output"', name, "") for name in OUTPUTS]
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{k}" {kind}><Real{start}/></ScalarVariable>'
        for k, (kind, name, start) in enumerate(kinds)
    )
    first = len(PARAMETERS) + len(INPUTS) + 1
    outputs = "".join(f'<Unknown index="{first + k}"/>' for k in range(len(OUTPUTS)))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<fmiModelDescription fmiVersion="2.0" modelName="valve" guid="{TOKEN}">'
        '<CoSimulation modelIdentifier="valve" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>"
    )
