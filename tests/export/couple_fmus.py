"""couple_fmus.py WHOLE A B [DIVISIONS...]: couples the unpacked FMUs A and B of two subsystems by the terminals that
they have in common, and compares them with the FMU WHOLE of the scene that has both. It prints for each communication
step h the largest error of a state over the largest such state, and the energy that the coupling loses, in three ways:
inputs that hold over a step; inputs within a step, extrapolated from earlier outputs; and inputs within a step, which
are interpolated between outputs of the other FMU and repeated until they stay."""
import ctypes
import glob
import sys
import xml.etree.ElementTree as tree

STEPS, SWEEPS, SETTLED, POINTS = 40, 8, 1e-10, 6
Reference, Value = ctypes.c_uint32, ctypes.c_double
Update = ctypes.CFUNCTYPE(None, ctypes.c_void_p, Value, ctypes.c_bool, ctypes.c_bool, ctypes.c_bool, ctypes.c_bool,
                          ctypes.POINTER(ctypes.c_bool), ctypes.POINTER(Value))


class Fmu:
    """An instance of an FMU for Co-Simulation. inputs(time) gives the inputs within a step; None: they hold."""

    def __init__(self, folder):
        self.description = tree.parse(f"{folder}/modelDescription.xml").getroot()
        name = self.description.get("modelName")
        self.library = ctypes.CDLL(glob.glob(f"{folder}/binaries/*/{name}.so")[0])
        self.dt = float(self.description.find("DefaultExperiment").get("stepSize"))
        self.variables = {v.get("name"): v for v in self.description.find("ModelVariables")}
        terminals = tree.parse(f"{folder}/terminalsAndIcons/terminalsAndIcons.xml").getroot().iter("Terminal")
        self.members = {(t.get("name"), m.get("memberName")): m.get("variableName") for t in terminals for m in t}
        self.inputs, self.trace, self.input, self.output = None, [], [], []
        self.update = Update(self.within)
        self.library.fmi3InstantiateCoSimulation.restype = ctypes.c_void_p
        token = self.description.get("instantiationToken").encode()
        self.instance = ctypes.c_void_p(self.library.fmi3InstantiateCoSimulation(
            b"x", token, None, False, False, False, False, (Reference * 1)(1), ctypes.c_size_t(1), None, None,
            self.update))
        self.call("EnterInitializationMode", False, Value(0), Value(0), False, Value(0))
        self.state = ctypes.c_void_p()

    def call(self, function, *arguments):
        if getattr(self.library, f"fmi3{function}")(self.instance, *arguments) != 0:
            sys.exit(f"FAILED: fmi3{function}")

    def causality(self, name):
        return self.variables[name].get("causality")

    def references(self, names):
        return (Reference * len(names))(*(int(self.variables[n].get("valueReference")) for n in names))

    def get(self, names):
        values = (Value * len(names))()
        n = ctypes.c_size_t(len(names))
        self.call("GetFloat64", self.references(names), n, values, n)
        return list(values)

    def set(self, names, values):
        n = ctypes.c_size_t(len(names))
        self.call("SetFloat64", self.references(names), n, (Value * len(names))(*values), n)

    def within(self, environment, time, set_requested, get_allowed, *rest):
        if self.inputs is not None and get_allowed:
            self.trace.append((time, self.get(self.output)))
        if self.inputs is not None and set_requested:
            self.set(self.input, self.inputs(time))

    def step(self, time, length):
        flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
        self.trace = []
        self.call("DoStep", Value(time), Value(length), True, *flags, ctypes.byref(Value()))
        self.trace.append((time + length, self.get(self.output)))


def polynomial(points, time):
    """The polynomial through the points (time, values) nearest to a time, at that time (Lagrange)."""
    points = sorted(points, key=lambda p: abs(p[0] - time))[:POINTS]
    weights = []
    for i, (ti, _) in enumerate(points):
        weight = 1.0
        for j, (tj, _) in enumerate(points):
            weight *= 1.0 if i == j else (time - tj) / (ti - tj)
        weights.append(weight)
    return [sum(w * p[1][k] for w, p in zip(weights, points)) for k in range(len(points[0][1]))]


def energy_of(pair):
    return sum(f.get([n for n in f.variables if n.endswith(".energy")])[0] for f in pair)


def take_step(pair, history, way, time, h):
    """Takes a step of both FMUs. history: of each the outputs (time, values) that the other one extrapolates."""
    for f, other in (pair, pair[::-1]):
        f.set(f.input, other.get(other.output))
        f.call("GetFMUState", ctypes.byref(f.state))
    guess, before = history, []
    for sweep in range(SWEEPS if way == "repeated" else 1):
        for f, points in zip(pair, guess[::-1]):
            f.inputs = None if way == "held" else lambda t, p=points: polynomial(p, t)
            f.call("SetFMUState", f.state)
            f.step(time, h)
            f.inputs = None
        guess = [f.trace for f in pair]
        ends = [x for f in pair for x in f.trace[-1][1]]
        if before and max(abs(x - y) for x, y in zip(ends, before)) < SETTLED:
            break
        before = ends
    kept = (lambda trace: trace[1:]) if way == "repeated" else (lambda trace: trace[-1:])
    return [(old + kept(f.trace))[-4:] for old, f in zip(history, pair)]


def couple(folders, divisions, way, starts):
    """Returns the states after each step of the scene, and the largest change of the energy."""
    pair = [Fmu(f) for f in folders]
    for fmu, other in (pair, pair[::-1]):
        # A member of a terminal is an input of one FMU and an output of the other.
        joined = [(name, other.members[member]) for member, name in fmu.members.items() if member in other.members
                  and fmu.causality(name) == "input" and other.causality(other.members[member]) == "output"]
        fmu.input, other.output = (list(names) for names in zip(*joined))
        if set(fmu.input) != {n for n in fmu.variables if fmu.causality(n) == "input"}:
            sys.exit("FAILED: an input is in no terminal")
        fmu.own = [n for n in starts if fmu.variables.get(n, {}).get("initial") == "exact"]
        fmu.set(fmu.own, [starts[n] for n in fmu.own])
    for fmu, other in (pair, pair[::-1]):
        fmu.set(fmu.input, other.get(other.output))
        fmu.call("ExitInitializationMode")
    h, history = pair[0].dt / divisions, [[(0.0, f.get(f.output))] for f in pair]
    states, energy = [], []
    for k in range(STEPS * divisions + 1):
        energy.append(energy_of(pair))
        if k % divisions == 0:
            states.append(dict(zip((n for f in pair for n in f.own), (x for f in pair for x in f.get(f.own)))))
        if k < STEPS * divisions:
            history = take_step(pair, history, way, k * h, h)
    return states, max(abs(e - energy[0]) for e in energy)


def main():
    whole = Fmu(sys.argv[1])
    starts = {n: float(v.get("start")) for n, v in whole.variables.items() if v.get("initial") == "exact"}
    whole.call("ExitInitializationMode")
    truth = [dict(zip(starts, whole.get(list(starts))))]
    for k in range(STEPS):
        whole.step(k * whole.dt, whole.dt)
        truth.append(dict(zip(starts, whole.get(list(starts)))))
    largest = {n: max(abs(t[n]) for t in truth) for n in starts}
    print("way         h/dt   error, %   lost energy, J")
    for way, divisions in [(w, int(d)) for w in ("held", "extrapolated", "repeated") for d in sys.argv[4:] or ["1"]]:
        states, lost = couple(sys.argv[2:4], divisions, way, starts)
        error = max(abs(s[n] - t[n]) / largest[n] for s, t in zip(states, truth) for n in starts)
        print(f"{way:12}1/{divisions:<4}{100 * error:9.2g}   {lost:9.2g}", flush=True)
        if way == "repeated" and not error < 1e-3:
            sys.exit("FAILED: inputs within a step")


if __name__ == "__main__":
    main()
