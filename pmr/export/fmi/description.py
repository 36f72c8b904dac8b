"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from pmr import __version__
from pmr.errors.text import escape_controls
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


def description_2(model: ModelAttributes, variables: Sequence[Variable]) -> str:
    """Text of modelDescription.xml of FMI 2.0."""
    root = _root_element(model, "2.0", {"guid": model.token, "numberOfEventIndicators": "0"})
    can = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
    can["providesDirectionalDerivative"] = str(model.derivatives).lower()
    steps = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "true",
        "maxOutputDerivativeOrder": "1",
    }
    for kind, more in _interfaces(model, steps):
        element = ET.SubElement(root, kind, {"modelIdentifier": model.identifier, **can, **more})
        if model.sources:
            files = ET.SubElement(element, "SourceFiles")
            for name in model.sources:
                ET.SubElement(files, "File", name=name)
    _add_units(root, variables)
    choice = ET.SubElement(ET.SubElement(root, "TypeDefinitions"), "SimpleType", name="Start")
    _add_start_kinds(ET.SubElement(choice, "Enumeration"))
    _add_experiment(root, model)
    listed, number = ET.SubElement(root, "ModelVariables"), {v.reference: k + 1 for k, v in enumerate(variables)}
    for variable in variables:
        scalar = ET.SubElement(listed, "ScalarVariable", _variable_attributes(variable))
        if variable.kind == "choice":
            ET.SubElement(scalar, "Enumeration", declaredType="Start", start=str(int(variable.start or 0)))
            continue
        real = ET.SubElement(scalar, "Real", _real_attributes(variable))
        if variable.derivative_of is not None:
            real.set("derivative", str(number[variable.derivative_of]))
    structure = ET.SubElement(root, "ModelStructure")
    for name, unknowns in zip(("Outputs", "Derivatives", "InitialUnknowns"), _model_structure(variables), strict=True):
        element = ET.SubElement(structure, name)
        for variable in unknowns:
            ET.SubElement(element, "Unknown", index=str(number[variable.reference]))
    return _xml_text(root)


def description_3(model: ModelAttributes, variables: Sequence[Variable]) -> str:
    """Text of modelDescription.xml of FMI 3.0."""
    root = _root_element(model, "3.0", {"instantiationToken": model.token})
    can = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    can["providesDirectionalDerivatives"] = str(model.derivatives).lower()
    steps = {"canHandleVariableCommunicationStepSize": "true", "maxOutputDerivativeOrder": "1"}
    for kind, more in _interfaces(model, steps):
        ET.SubElement(root, kind, {"modelIdentifier": model.identifier, **can, **more})
    _add_units(root, variables)
    _add_start_kinds(ET.SubElement(ET.SubElement(root, "TypeDefinitions"), "EnumerationType", name="Start"))
    _add_experiment(root, model)
    listed = ET.SubElement(root, "ModelVariables")
    for variable in variables:
        if variable.kind == "choice":
            start = str(int(variable.start or 0))
            attributes = {**_variable_attributes(variable), "declaredType": "Start", "start": start}
            ET.SubElement(listed, "Enumeration", attributes)
            continue
        element = ET.SubElement(listed, "Float64", {**_variable_attributes(variable), **_real_attributes(variable)})
        if variable.derivative_of is not None:
            element.set("derivative", str(variable.derivative_of))
    structure = ET.SubElement(root, "ModelStructure")
    names = ("Output", "ContinuousStateDerivative", "InitialUnknown")
    for name, unknowns in zip(names, _model_structure(variables), strict=True):
        for variable in unknowns:
            ET.SubElement(structure, name, valueReference=str(variable.reference))
    return _xml_text(root)


def build_description(model: ModelAttributes) -> str:
    """Text of sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ET.SubElement(build, "SourceFileSet", language="C11")
    for name in model.sources:
        ET.SubElement(files, "SourceFile", name=name)
    return _xml_text(root)


def _root_element(model: ModelAttributes, version: str, more: dict[str, str]) -> ET.Element:
    """Root element fmiModelDescription for a version of FMI, with the further attributes `more`."""
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.title,
            "description": "Reduced model in modal coordinates",
            "generationTool": f"pmr {__version__}",
            "variableNamingConvention": "flat",
            **more,
        },
    )


def _interfaces(model: ModelAttributes, of_steps: dict[str, str]) -> list[tuple[str, dict[str, str]]]:
    """Pairs (name of element, attributes) of interfaces: ModelExchange if supported, CoSimulation with `of_steps`."""
    interfaces: list[tuple[str, dict[str, str]]] = [("CoSimulation", of_steps)]
    return [("ModelExchange", {}), *interfaces] if model.model_exchange else interfaces


def _add_units(root: ET.Element, variables: Sequence[Variable]) -> None:
    """Add the units of the variables to the root element; for a unit outside SI only its name is added."""
    units = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(variable.unit for variable in variables if variable.unit):
        unit = ET.SubElement(units, "Unit", name=name)
        if name in UNITS:
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[name].items()})


def _add_start_kinds(choice: ET.Element) -> None:
    """Add an element Item to `choice` for each kind of start."""
    for name, value in STARTS.items():
        ET.SubElement(choice, "Item", name=name, value=str(value))


def _add_experiment(root: ET.Element, model: ModelAttributes) -> None:
    """Add log categories and the default experiment to the root element."""
    categories = ET.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusError"):
        ET.SubElement(categories, "Category", name=name)
    times = {"startTime": "0.0", "stopTime": repr(model.end), "tolerance": "1e-8", "stepSize": repr(model.step)}
    ET.SubElement(root, "DefaultExperiment", times)


def _variable_attributes(variable: Variable) -> dict[str, str]:
    """Attributes that every variable has: name, value reference, description, causality, variability, initial."""
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.description,
    }
    return attributes | {name: value for name, value in variable.role._asdict().items() if value}


def _real_attributes(variable: Variable) -> dict[str, str]:
    """Attributes of a real variable: unit, start, nominal, min and max, as far as the variable has them."""
    attributes = {} if not variable.unit else {"unit": variable.unit}
    low, high = variable.within or (None, None)
    numbers = {"start": variable.start, "nominal": variable.nominal, "min": low, "max": high}
    return attributes | {name: _number_text(value) for name, value in numbers.items() if value is not None}


def _number_text(value: float) -> str:
    """Number as XML has it."""
    return "NaN" if value != value else repr(value)


def _model_structure(variables: Sequence[Variable]) -> list[list[Variable]]:
    """Lists of variables for the ModelStructure: outputs, derivatives of states, and unknowns of the initialisation."""
    return [
        [v for v in variables if v.role.causality == "output"],
        [v for v in variables if v.derivative_of is not None],
        [v for v in variables if v.role.initial in ("approx", "calculated")],
    ]


def _xml_text(root: ET.Element) -> str:
    """Text of the XML tree; control characters and lone surrogates, which XML can't hold, are replaced."""
    for element in root.iter():
        element.attrib.update({key: escape_controls(value) for key, value in element.attrib.items()})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
