"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from pmr import __version__
from pmr.errors import escape_controls
from pmr.export.fmi.variables import STARTS, Variable, rate_unit

#: Exponents of the SI base units of each unit, and its factor where that is not 1.
_UNITS: dict[str, dict[str, float]] = {
    "1": {},
    "s": {"s": 1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "mm": {"m": 1, "factor": 0.001},
    "rad": {"rad": 1},
    "K": {"K": 1},
    "m3": {"m": 3},
    "N/m": {"kg": 1, "s": -2},
    "kg": {"kg": 1},
}
UNITS = _UNITS | {
    rate_unit(unit, order): was | {"s": was.get("s", 0) - order} for unit, was in _UNITS.items() for order in (1, 2, 3)
}


@dataclass(frozen=True)
class ModelAttributes:
    """Attributes of a whole model in its description."""

    identifier: str  #: C identifier: the name of the binaries
    title: str
    token: str  #: Hash that distinguishes the model from others
    model_exchange: bool  #: Whether there is a Model Exchange interface in addition to Co-Simulation
    derivatives: bool  #: Whether there are directional derivatives
    sources: Sequence[str]
    end: float  #: s, of the reference trajectory
    step: float  #: s, of the reference trajectory


def model_description(model: ModelAttributes, variables: Sequence[Variable], version: str) -> str:
    """Text of modelDescription.xml of FMI 2.0 or 3.0, with the given `variables`; `version` is ``"2"`` or ``"3"``."""
    is_3 = version == "3"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": model.title,
            "description": "Reduced model in modal coordinates",
            "generationTool": f"pmr {__version__}",
            "variableNamingConvention": "flat",
            **({"instantiationToken": model.token} if is_3 else {"guid": model.token, "numberOfEventIndicators": "0"}),
        },
    )
    state, plural = ("FMUState", "s") if is_3 else ("FMUstate", "")
    can = {f"canGetAndSet{state}": "true", f"canSerialize{state}": "true"}
    can[f"providesDirectionalDerivative{plural}"] = str(model.derivatives).lower()
    steps = {"canHandleVariableCommunicationStepSize": "true"} | ({} if is_3 else {"canInterpolateInputs": "true"})
    interfaces: dict[str, dict[str, str]] = {"ModelExchange": {}} if model.model_exchange else {}
    interfaces["CoSimulation"] = steps | {"maxOutputDerivativeOrder": "1"}
    for kind, more in interfaces.items():
        element = ET.SubElement(root, kind, {"modelIdentifier": model.identifier, **can, **more})
        if model.sources and not is_3:
            files = ET.SubElement(element, "SourceFiles")
            for name in model.sources:
                ET.SubElement(files, "File", name=name)
    _add_units(root, variables)
    types = ET.SubElement(root, "TypeDefinitions")
    choice = ET.SubElement(types, "EnumerationType" if is_3 else "SimpleType", name="Start")
    choice = choice if is_3 else ET.SubElement(choice, "Enumeration")
    for name, value in STARTS.items():
        ET.SubElement(choice, "Item", name=name, value=str(value))
    categories = ET.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusError"):
        ET.SubElement(categories, "Category", name=name)
    times = {"startTime": "0.0", "stopTime": repr(model.end), "tolerance": "1e-8", "stepSize": repr(model.step)}
    ET.SubElement(root, "DefaultExperiment", times)
    listed, number = ET.SubElement(root, "ModelVariables"), {v.reference: k + 1 for k, v in enumerate(variables)}
    for variable in variables:
        kind, attributes = "Float64" if is_3 else "Real", _real_attributes(variable)
        if variable.kind == "choice":
            kind, attributes = "Enumeration", {"declaredType": "Start", "start": str(int(variable.start or 0))}
        if (of := variable.derivative_of) is not None:
            attributes["derivative"] = str(of if is_3 else number[of])
        if is_3:
            ET.SubElement(listed, kind, _variable_attributes(variable) | attributes)
        else:
            ET.SubElement(ET.SubElement(listed, "ScalarVariable", _variable_attributes(variable)), kind, attributes)
    structure = ET.SubElement(root, "ModelStructure")
    groups = {"Output": "Outputs", "ContinuousStateDerivative": "Derivatives", "InitialUnknown": "InitialUnknowns"}
    for (single, group), unknowns in zip(groups.items(), _model_structure(variables), strict=True):
        element = structure if is_3 else ET.SubElement(structure, group)
        for variable in unknowns:
            if is_3:
                ET.SubElement(element, single, valueReference=str(variable.reference))
            else:
                ET.SubElement(element, "Unknown", index=str(number[variable.reference]))
    return _xml_text(root)


def build_description(model: ModelAttributes) -> str:
    """Text of sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ET.SubElement(build, "SourceFileSet", language="C11")
    for name in model.sources:
        ET.SubElement(files, "SourceFile", name=name)
    return _xml_text(root)


def _add_units(root: ET.Element, variables: Sequence[Variable]) -> None:
    """Add the units of the variables to the root element; for a unit outside SI only its name is added."""
    units = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(variable.unit for variable in variables if variable.unit):
        unit = ET.SubElement(units, "Unit", name=name)
        if name in UNITS:
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[name].items()})


def _variable_attributes(variable: Variable) -> dict[str, str]:
    """Attributes that every variable has, by their names in the FMI.

    The attributes are ``name``, ``valueReference`` and ``description``, and ``causality``, ``variability`` and
    ``initial`` as far as the variable's role sets them.
    """
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.description,
    }
    return attributes | {name: value for name, value in variable.role._asdict().items() if value}


def _real_attributes(variable: Variable) -> dict[str, str]:
    """Attributes of a real variable by their names: ``unit``, ``start``, ``nominal``, ``min`` and ``max``.

    Attributes that the variable does not set are left out.
    """
    attributes = {} if not variable.unit else {"unit": variable.unit}
    low, high = variable.within or (None, None)
    numbers = {"start": variable.start, "nominal": variable.nominal, "min": low, "max": high}
    return attributes | {name: _number_text(value) for name, value in numbers.items() if value is not None}


def _number_text(value: float) -> str:
    """Number in the form of XML: ``NaN``, or all digits."""
    return "NaN" if value != value else repr(value)


def _model_structure(variables: Sequence[Variable]) -> list[list[Variable]]:
    """Lists of variables for the ModelStructure: outputs, derivatives of states, and unknowns of the initialisation."""
    return [
        [v for v in variables if v.role.causality == "output"],
        [v for v in variables if v.derivative_of is not None],
        [v for v in variables if v.role.initial in ("approx", "calculated")],
    ]


def _xml_text(root: ET.Element) -> str:
    """Text of the XML tree below `root`; control characters and lone surrogates, which XML can't hold, are replaced."""
    for element in root.iter():
        element.attrib.update({key: escape_controls(value) for key, value in element.attrib.items()})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
