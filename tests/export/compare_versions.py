"""compare_versions.py SECOND THIRD: the unpacked FMUs of one scene under FMI 2.0 and 3.0 have the same variables, and
the same bits after each step of Co-Simulation. A derivative of an input, which FMI 2.0 has instead of updates within a
step, does what an input that follows it within a step does."""
import ctypes
import glob
import sys
import xml.etree.ElementTree as tree

from couple_fmus import Fmu, Value

Reference, STEPS = ctypes.c_uint, 20


class Callbacks(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("logger", "allocate", "free", "finished", "environment")]


class Second:
    def __init__(self, folder):
        root = tree.parse(f"{folder}/modelDescription.xml").getroot()
        self.variables = {v.get("name"): v for v in root.find("ModelVariables")}
        self.order = list(self.variables)
        self.structure = root.find("ModelStructure")
        path = glob.glob(f"{folder}/binaries/*/{root.get('modelName')}.so")[0]
        self.library = ctypes.CDLL(path)
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        assert self.library.fmi2Instantiate(b"x", 1, b"another", None, ctypes.byref(Callbacks()), 0, 0) is None
        self.callbacks = Callbacks()
        self.instance = ctypes.c_void_p(self.library.fmi2Instantiate(
            b"x", 1, root.get("guid").encode(), None, ctypes.byref(self.callbacks), 0, 0))
        self.call("SetupExperiment", 0, Value(0), Value(0), 0, Value(0))
        self.call("EnterInitializationMode")
        self.call("ExitInitializationMode")

    def call(self, function, *arguments):
        if getattr(self.library, f"fmi2{function}")(self.instance, *arguments) != 0:
            sys.exit(f"FAILED: fmi2{function}")

    def references(self, names):
        return (Reference * len(names))(*(int(self.variables[n].get("valueReference")) for n in names))

    def get(self, names):
        values = (Value * len(names))()
        self.call("GetReal", self.references(names), ctypes.c_size_t(len(names)), values)
        return list(values)

    def set(self, names, values):
        self.call("SetReal", self.references(names), ctypes.c_size_t(len(names)), (Value * len(names))(*values))

    def slope(self, names, values):
        n = len(names)
        self.call("SetRealInputDerivatives", self.references(names), ctypes.c_size_t(n), (ctypes.c_int * n)(*[1] * n),
                  (Value * n)(*values))

    def step(self, time, length):
        self.call("DoStep", Value(time), Value(length), 1)


def check_structure(second):
    """Positions count from 1, and each unknown and each dependency is one of a variable that may stand there."""
    kinds = {"Outputs": ("output",), "Derivatives": ("local",), "InitialUnknowns": ("output", "local")}
    for element in second.structure:
        for unknown in element:
            v = second.variables[second.order[int(unknown.get("index")) - 1]]
            assert v.get("causality") in kinds[element.tag], v.attrib
            for k in unknown.get("dependencies").split():
                known = second.variables[second.order[int(k) - 1]]
                assert known.get("initial") == "exact" or known.get("causality") in ("input", "parameter"), known.attrib
    for v in second.variables.values():
        state = v.find("Real").get("derivative")
        assert state is None or v.get("name") == f"der({second.order[int(state) - 1]})", v.attrib


def main():
    second, third = Second(sys.argv[1]), Fmu(sys.argv[2])
    third.call("ExitInitializationMode")
    assert list(second.variables) == list(third.variables), "other variables"
    check_structure(second)
    names = [n for n in second.order if n != "time"]
    inputs = [n for n in names if second.variables[n].get("causality") == "input"]
    third.input = inputs
    for k in range(STEPS):
        begin = [x * (1 + 0.02 * k) for x in second.get(inputs)]
        slope = [0.3 * x for x in begin]
        for f in (second, third):
            f.set(inputs, begin)
        if k % 2 == 1 and inputs:
            second.slope(inputs, slope)
            third.inputs = lambda t, k=k, u=begin, s=slope: [a + b * (t - k * third.dt) for a, b in zip(u, s)]
        second.step(k * third.dt, third.dt)
        third.step(k * third.dt, third.dt)
        third.inputs = None
        for f in (second, third):
            f.set(inputs, begin)
        for name, a, b in zip(names, second.get(names), third.get(names)):
            if a != b:
                sys.exit(f"FAILED: step {k}, {name}: {a!r} with FMI 2.0, {b!r} with 3.0")
    print(f"{len(names)} variables, {len(inputs)} inputs, {STEPS} steps: the same bits")


main()
