"""modelDescription.xml and buildDescription.xml of an exported model, for FMI 2.0 and 3.0."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal
from xml.etree import ElementTree as ET

from workbench import __version__
from workbench.export.model import Model
from workbench.export.units import BASE, over_time
from workbench.export.variables import Variable

FmiVersion = Literal["2.0", "3.0"]
SOURCES = ("model.c", "core.c")  # beside the interface's own file
TOOL = f"workbench {__version__}"


def interface_file(version: FmiVersion) -> str:
    """The C file of the interface."""
    return f"fmi{version[0]}.c"


def model_description(model: Model, version: FmiVersion) -> str:
    """modelDescription.xml, checked in tests against the standard's schema."""
    return _text(_version3(model) if version == "3.0" else _version2(model))


def build_description(model: Model) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for name in (interface_file("3.0"), *SOURCES):
        ET.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _number(value: float) -> str:
    return repr(float(value))


def _head(model: Model, version: FmiVersion, token: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            token: model.token,
            "description": model.description,
            "generationTool": TOOL,
            "variableNamingConvention": "structured",
        },
    )


def _version3(model: Model) -> ET.Element:
    root = _head(model, "3.0", "instantiationToken")
    slopes = "false" if model.controlled else "true"
    ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": slopes,
            "providesAdjointDerivatives": slopes,
            "canHandleVariableCommunicationStepSize": "true",
        },
    )
    _units(root, model)
    _categories(root)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="10.0", stepSize=_number(10.0 * model.step_s))
    variables = ET.SubElement(root, "ModelVariables")
    for reference, v in enumerate(model.variables):
        attributes = _common(v, reference)
        if not v.boolean:
            attributes |= _real(v)
            if v.derivative_of is not None:
                attributes["derivative"] = str(model.reference(v.derivative_of))
        ET.SubElement(variables, "Boolean" if v.boolean else "Float64", attributes)
    structure = ET.SubElement(root, "ModelStructure")
    for name in _named(model, "output"):
        ET.SubElement(structure, "Output", valueReference=str(model.reference(name)))
    for name in model.states:
        ET.SubElement(structure, "ContinuousStateDerivative", valueReference=str(model.reference(f"der({name})")))
    for name in _initial(model):
        ET.SubElement(structure, "InitialUnknown", valueReference=str(model.reference(name)))
    return root


def _version2(model: Model) -> ET.Element:
    root = _head(model, "2.0", "guid")
    simulation = ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canHandleVariableCommunicationStepSize": "true",
            "canInterpolateInputs": "false" if model.controlled else "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "providesDirectionalDerivative": "false" if model.controlled else "true",
        },
    )
    files = ET.SubElement(simulation, "SourceFiles")
    for name in (interface_file("2.0"), *SOURCES):
        ET.SubElement(files, "File", name=name)
    _units(root, model)
    _categories(root)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="10.0", stepSize=_number(10.0 * model.step_s))
    variables = ET.SubElement(root, "ModelVariables")
    for reference, v in enumerate(model.variables):
        scalar = ET.SubElement(variables, "ScalarVariable", _common(v, reference, start=False))
        if v.boolean:
            ET.SubElement(scalar, "Boolean", start=_start(v) or "false")
            continue
        attributes = _real(v)
        if v.start is not None:
            attributes["start"] = _number(v.start)
        if v.derivative_of is not None:
            attributes["derivative"] = str(model.reference(v.derivative_of) + 1)
        ET.SubElement(scalar, "Real", attributes)
    structure = ET.SubElement(root, "ModelStructure")
    _unknowns2(structure, "Outputs", model, _named(model, "output"))
    _unknowns2(structure, "Derivatives", model, (f"der({name})" for name in model.states))
    _unknowns2(structure, "InitialUnknowns", model, _initial(model))
    return root


def _unknowns2(structure: ET.Element, element: str, model: Model, names: Iterable[str]) -> None:
    block = ET.SubElement(structure, element)
    for index in sorted(model.reference(name) + 1 for name in names):
        ET.SubElement(block, "Unknown", index=str(index))


def _named(model: Model, causality: str) -> list[str]:
    return [v.name for v in model.variables if v.causality == causality]


def _initial(model: Model) -> list[str]:
    """What is to be computed before the first step: outputs, calculated parameters, states and their derivatives."""
    wanted = {*_named(model, "output"), *_named(model, "calculatedParameter"), *model.states}
    wanted |= {f"der({name})" for name in model.states}
    return [v.name for v in model.variables if v.name in wanted]


def _start(v: Variable) -> str | None:
    if v.start is None:
        return None
    return ("true" if v.start else "false") if v.boolean else _number(v.start)


def _common(v: Variable, reference: int, start: bool = True) -> dict[str, str]:
    attributes = {
        "name": v.name,
        "valueReference": str(reference),
        "description": v.meaning,
        "causality": v.causality,
        "variability": v.variability,
    }
    if v.causality in ("output", "local", "calculatedParameter"):
        attributes["initial"] = "calculated"
    if v.causality == "parameter":
        attributes["initial"] = "exact"
    if start and (said := _start(v)) is not None:
        attributes["start"] = said
    return attributes


def _real(v: Variable) -> dict[str, str]:
    attributes = {}
    if unit := _unit(v):
        attributes["unit"] = unit
    if math.isfinite(v.range.lowest):
        attributes["min"] = _number(v.range.lowest)
    if math.isfinite(v.range.highest):
        attributes["max"] = _number(v.range.highest)
    return attributes


def _unit(v: Variable) -> str:
    if v.derivative_of is None:
        return v.unit
    of = Variable(v.derivative_of, "", "local", "continuous", "SHOWN", 0)
    return over_time(of.unit)


def _units(root: ET.Element, model: Model) -> None:
    used = sorted({_unit(v) for v in model.variables} - {""})
    block = ET.SubElement(root, "UnitDefinitions")
    for name in used:
        unit = ET.SubElement(block, "Unit", name=name)
        ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in BASE[name].items()})


def _categories(root: ET.Element) -> None:
    categories = ET.SubElement(root, "LogCategories")
    for name, meaning in {
        "logStatusWarning": "what is odd, and goes on",
        "logStatusDiscard": "a value that was not taken",
        "logStatusError": "what cannot go on",
    }.items():
        ET.SubElement(categories, "Category", name=name, description=meaning)
