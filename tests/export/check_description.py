"""check_description.py FOLDER...: the XML files of unpacked FMUs say what FMI 3.0 asks for: known elements
and attributes in the order of the schema, references that exist, and a structure that lists every output,
every derivative and every initial unknown once."""
import ctypes
import glob
import os
import re
import sys
import xml.etree.ElementTree as tree

ORDER = ["ModelExchange", "CoSimulation", "UnitDefinitions", "DefaultExperiment", "ModelVariables",
         "ModelStructure"]
INTERFACE = {"modelIdentifier", "canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives",
             "providesAdjointDerivatives"}
CO_SIMULATION = {"canHandleVariableCommunicationStepSize", "fixedInternalStepSize", "hasEventMode",
                 "providesIntermediateUpdate"}
VARIABLE = {"name", "valueReference", "causality", "variability", "initial", "unit", "start", "derivative",
            "nominal", "min", "max", "description", "intermediateUpdate"}
POWERS = {"kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset"}

# Structured names (FMI 3.0, 2.4.7.5.1).
QUOTED = r"'(?:[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
PART = rf"(?:[A-Za-z_][A-Za-z0-9_]*|{QUOTED})(?:\[[0-9]+(?:,[0-9]+)*\])?"
NAME = re.compile(rf"{PART}(?:\.{PART})*|der\({PART}(?:\.{PART})*(?:,[0-9]+)?\)")
# Combinations of causality, variability and initial that a description uses (2.4.7.4).
COMBINATIONS = {("independent", "continuous", None), ("output", "continuous", "exact"),
                ("output", "continuous", "calculated"), ("local", "continuous", "calculated"),
                ("input", "continuous", None), ("parameter", "tunable", None)}

KINDS = ["Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
         "String", "Binary", "Clock"]
# Importers look for all functions of the standard, whatever the FMU can do (2.3).
FUNCTIONS = [f"{do}{kind}" for do in ("Get", "Set") for kind in KINDS] + [
    f"{do}{what}{form}" for do in ("Get", "Set") for what in ("Interval", "Shift") for form in ("Decimal", "Fraction")
] + """GetVersion SetDebugLogging InstantiateModelExchange InstantiateCoSimulation InstantiateScheduledExecution
    FreeInstance EnterInitializationMode ExitInitializationMode EnterEventMode Terminate Reset
    GetNumberOfVariableDependencies GetVariableDependencies GetFMUState SetFMUState FreeFMUState SerializedFMUStateSize
    SerializeFMUState DeserializeFMUState GetDirectionalDerivative GetAdjointDerivative EnterConfigurationMode
    ExitConfigurationMode EvaluateDiscreteStates UpdateDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep
    SetTime SetContinuousStates GetContinuousStateDerivatives GetEventIndicators GetContinuousStates
    GetNominalsOfContinuousStates GetNumberOfEventIndicators GetNumberOfContinuousStates EnterStepMode
    GetOutputDerivatives DoStep ActivateModelPartition""".split()


def check_functions(folder, name):
    paths = glob.glob(os.path.join(folder, "binaries", "*", f"{name}.so"))
    assert len(FUNCTIONS) == 75 and len(paths) == 1
    library = ctypes.CDLL(os.path.abspath(paths[0]))
    absent = [f for f in FUNCTIONS if not hasattr(library, f"fmi3{f}")]
    assert not absent, absent


def check_variables(variables, units):
    references = {v.get("valueReference"): v for v in variables}
    assert len(references) == len(variables), "a value reference occurs twice"
    assert len({v.get("name") for v in variables}) == len(variables), "a name occurs twice"
    for v in variables:
        assert v.tag == "Float64" and set(v.attrib) <= VARIABLE, v.attrib
        assert NAME.fullmatch(v.get("name")), v.get("name")
        assert (v.get("causality"), v.get("variability"), v.get("initial")) in COMBINATIONS, v.attrib
        assert v.get("unit") in units, v.get("unit")
        causality, initial = v.get("causality"), v.get("initial")
        assert (v.get("start") is not None) == (causality in ("input", "parameter") or initial == "exact"), v.attrib
        if v.get("derivative") is not None:
            state = references[v.get("derivative")]
            assert v.get("name") == f"der({state.get('name')})"
            assert state.get("variability") == "continuous"
    assert [v.get("name") for v in variables if v.get("causality") == "independent"] == ["time"]
    return references


def check_structure(structure, references):
    listed = {tag: [e.get("valueReference") for e in structure.findall(tag)]
              for tag in ("Output", "ContinuousStateDerivative", "InitialUnknown")}
    order = [e.tag for e in structure]
    assert order == sorted(order, key=list(listed).index), "elements in another order"
    wanted = {"Output": [r for r, v in references.items() if v.get("causality") == "output"],
              "ContinuousStateDerivative": [r for r, v in references.items() if v.get("derivative")],
              "InitialUnknown": [r for r, v in references.items() if v.get("initial") == "calculated"]}
    for tag, found in listed.items():
        assert sorted(found) == sorted(wanted[tag]), tag
    # What an unknown may depend on (2.4.8): states and inputs, and parameters at the start.
    known = {r for r, v in references.items() if v.get("initial") == "exact" or v.get("causality") == "input"}
    parameters = {r for r, v in references.items() if v.get("causality") == "parameter"}
    for e in structure:
        on = e.get("dependencies").split()
        assert on == sorted(set(on), key=int), on
        assert set(on) <= known | (parameters if e.tag == "InitialUnknown" else set()), on


def check(folder):
    root = tree.parse(os.path.join(folder, "modelDescription.xml")).getroot()
    assert root.tag == "fmiModelDescription" and root.get("fmiVersion") == "3.0"
    assert root.get("instantiationToken") and root.get("modelName")
    assert root.get("license") and root.get("copyright") and root.get("version")
    bounded = [v for v in root.find("ModelVariables") if v.get("max") is not None]
    assert bounded and all(float(v.get("min")) <= float(v.get("start")) <= float(v.get("max")) for v in bounded)
    assert [e.tag for e in root] == ORDER, [e.tag for e in root]
    me, cs, units, experiment, variables, structure = root
    assert set(me.attrib) == INTERFACE and set(cs.attrib) == INTERFACE | CO_SIMULATION
    assert set(experiment.attrib) == {"startTime", "stopTime", "stepSize"}
    names = [u.get("name") for u in units]
    assert len(names) == len(set(names)), "a unit occurs twice"
    for base in units.iter("BaseUnit"):
        assert set(base.attrib) <= POWERS and all(int(p) for p in base.attrib.values())
    references = check_variables(list(variables), set(names))
    check_structure(structure, references)
    check_functions(folder, root.get("modelName"))

    build = tree.parse(os.path.join(folder, "sources", "buildDescription.xml")).getroot()
    assert build.tag == "fmiBuildDescription"
    for library in build.iter("Library"):
        assert library.get("external") == "true", "a library that the FMU does not hold"
    for source in build.iter("SourceFile"):
        assert os.path.exists(os.path.join(folder, "sources", source.get("name"))), source.get("name")
    terminals = tree.parse(os.path.join(folder, "terminalsAndIcons", "terminalsAndIcons.xml")).getroot()
    assert terminals.tag == "fmiTerminalsAndIcons"
    known = {v.get("name") for v in variables}
    members = list(terminals.iter("TerminalMemberVariable"))
    assert members and all(m.get("variableName") in known for m in members)
    unit = {u.get("name"): (u.find("BaseUnit").attrib if u.find("BaseUnit") is not None else None) for u in units}
    if "kg.m/s" in unit:
        assert unit["m/s"] == {"m": "1", "s": "-1"}, unit["m/s"]  # a velocity, from J by kg m/s
    assert all(" " not in name and "^" not in name for name in unit), unit
    assert unit["W/K"] == {"kg": "1", "m": "2", "s": "-3", "K": "-1"}


for fmu in sys.argv[1:]:
    check(fmu)
