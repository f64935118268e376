"""Random laws of elements, and a builder of systems from them.

All laws are of order one in normalised variables: a store of size Z0 has the energy E0 g(z/Z0). Each domain has an
effort e0, a flow f0 and a time tau common to the system, so that displacements are f0 tau, momenta e0 tau, and energies
e0 f0 tau. What is drawn are these sizes, the shapes and the structure.
"""
import math

import numpy as np

from generic import Conduction, Friction, Input, Sensor, System, Variable

T0 = 293.15

# unit of displacement, of momentum; range of the flow in SI; what a logger shows: (name, unit, SI size) of flow and effort
DOMAINS = {
    "translation": ("m", "kg m/s", (0.05, 3), [("v", "m/s", 1), ("v", "mm/s", 1e-3)], None),
    "rotation": ("rad", "kg m^2/s", (0.5, 30), [("w", "rad/s", 1), ("n", "rpm", math.pi / 30)], None),
    "electric": ("C", "Wb", (0.02, 20), [("i", "A", 1), ("i", "mA", 1e-3)], [("u", "V", 1)]),
    "hydraulic": ("m^3", "Pa s", (1e-5, 5e-3), [("Q", "m^3/s", 1), ("Q", "l/min", 1e-3 / 60)], [("P", "Pa", 1), ("P", "bar", 1e5), ("h", "m", 9810)]),
}
ENERGY = {"translation": (0.01, 100), "rotation": (0.01, 100), "electric": (1e-3, 10), "hydraulic": (0.1, 1e3)}
TIME = {"translation": (0.01, 0.5), "rotation": (0.01, 0.5), "electric": (1e-4, 0.1), "hydraulic": (0.02, 3)}
PREFIXES = {"m": [("m", 1e-3), ("c", 1e-2)], "C": [("m", 1e-3), ("u", 1e-6)], "Wb": [("m", 1e-3)], "J/K": [("k", 1e3), ("m", 1e-3)],
            "mol": [("m", 1e-3), ("k", 1e3)]}
OTHERS = {"m^3": [("l", 1e-3)], "rad": [("deg", math.pi / 180)], "kg m/s": [("g m/s", 1e-3)], "kg m^2/s": [("mN m s", 1e-3)]}


class Draw:
    """Random numbers."""
    def __init__(self, rng):
        self.rng = rng

    def uniform(self, a, b):
        return float(self.rng.uniform(a, b))

    def log(self, a, b):
        return float(np.exp(self.rng.uniform(np.log(a), np.log(b))))

    def whole(self, a, b):
        return int(self.rng.integers(a, b + 1))

    def one(self, items):
        return items[int(self.rng.integers(len(items)))]

    def chance(self, p):
        return bool(self.rng.uniform() < p)

    # Energies of one normalised variable, convex unless `any`.

    def store(self, shapes=("square", "hard", "soft", "skew", "exp")):
        a, b, c = self.uniform(0.5, 1.6), self.uniform(0.2, 1.5), self.uniform(-0.5, 0.5)
        shape = self.one(shapes)
        return {
            "square": lambda x: a * x**2 / 2,
            "hard": lambda x: a * x**2 / 2 + b * x**4 / 4,
            "soft": lambda x: a * (np.sqrt(1 + 2 * b * x**2) - 1) / b,
            "skew": lambda x: a * x**2 / 2 + c * a * x**3 / 3 + (0.15 * a + b) * x**4 / 4,
            "exp": lambda x: a * (np.exp(c * x) - 1 - c * x) / c**2,
            "cosh": lambda x: a * (np.cosh(b * x) - 1) / b**2,
            "sine": lambda x: a * (1 - np.cos(x)),
            "well": lambda x: -a * x**2 / 2 + (0.5 + b) * x**4 / 4,
            "gas": lambda x: a * ((1 + 0.4 * x) ** -0.4 - 1 + 0.16 * x) / (0.16 * 0.4 * 1.4),  # a cushion, 1 + 0.4 x its volume
        }[shape]

    # Resistances of a normalised flow; always positive.

    def resistance(self, temperature=True):
        """rho(f, T)"""
        a, b, d, alpha = self.log(0.02, 0.4), self.uniform(0.3, 2), self.uniform(0.05, 0.3), self.uniform(-0.012, 0.012)
        shape = self.one(("linear", "linear", "linear", "square", "cubic", "dry", "falling"))
        law = {
            "linear": lambda f: a + 0 * f,
            "square": lambda f: 0.3 * a + a * b * np.sqrt(f**2 + 1e-3),
            "cubic": lambda f: a * (1 + b * f**2),
            "dry": lambda f: a * (0.4 + 0.5 * b / np.sqrt(f**2 + d**2)),
            "falling": lambda f: a * (0.3 + b / (1 + (f / (2 * d)) ** 2)),
        }[shape]
        if not temperature or not self.chance(0.5):
            return lambda f, T: law(f)
        return self.one((lambda f, T: law(f) * np.exp(alpha * (T - T0)), lambda f, T: law(f) * np.maximum(1 + alpha * (T - T0), 0.05)))


class Body:
    """The heat of a body: temperature and energy as functions of the entropy, which is 0 at T0."""
    def __init__(self, draw, capacity):
        self.capacity, self.constant = capacity, draw.chance(0.5)
        self.power = draw.uniform(0.6, 3.0)  # T ~ (1 + s/(C a))^a: the capacity grows with T^(1/a)

    def temperature(self, s):
        c, a = self.capacity, self.power
        return T0 * np.exp(s / c) if self.constant else T0 * (1 + s / (c * a)) ** a

    def energy(self, s):
        c, a = self.capacity, self.power
        return c * T0 * (np.exp(s / c) - 1) if self.constant else c * T0 * a / (a + 1) * ((1 + s / (c * a)) ** (a + 1) - 1)

    def entropy(self, T):
        c, a = self.capacity, self.power
        return c * np.log(T / T0) if self.constant else c * a * ((T / T0) ** (1 / a) - 1)


class Builder:
    """Assembles a system. `logger` replaces bodies without a thermometer by surroundings of a constant temperature."""
    def __init__(self, rng, kind, logger):
        self.draw, self.logger, self.system = Draw(rng), logger, System(kind)
        self.tau = self.E0 = 1.0
        self.flow = {}  # of domains
        self.stores = {}  # variable: (domain, "x" or "p")
        self.sinks = {}  # part: entropy
        self.begin = []  # functions (rng, count, z)
        self.thermometers = self.draw.chance(0.5)
        self.shown = {}  # what a logger shows of each domain: one unit for all
        self.celsius = self.draw.chance(0.5)

    def scales(self, *domains):
        """Draws the energy and the time of the system, and the flow of each domain."""
        d = self.draw
        self.E0 = d.log(max(ENERGY[x][0] for x in domains), min(ENERGY[x][1] for x in domains))
        self.tau = d.log(max(TIME[x][0] for x in domains), min(TIME[x][1] for x in domains))
        for x in domains:
            self.flow[x] = d.log(*DOMAINS[x][2])
            if x == "rotation":
                self.flow[x] = d.uniform(0.3, 1.2) / self.tau
        return self

    def unit(self, unit, size):
        """The unit of a column: SI, or one with a prefix that suits the size."""
        prefixed = [(p + unit, f) for p, f in PREFIXES.get(unit, [])] + OTHERS.get(unit, [])
        fitting = [(u, f) for u, f in prefixed if 0.1 < size / f < 1e4] if not 0.05 < size < 50 or self.draw.chance(0.2) else []
        return self.draw.one(fitting) if fitting and self.draw.chance(0.6) else (unit, 1.0)

    def add(self, part, group, unit, size, sensor=None, amplitude=None, like=None, start=None):
        """A variable; those of one group share a unit. It starts uniformly in +-amplitude sizes."""
        s = self.system
        same = [v for v in s.variables if (v.part, v.group) == (part, group)]
        other = same[0] if same else s.variables[like] if like is not None else None
        text, si = (other.unit, other.si) if other is not None else self.unit(unit, size)
        i = len(s.variables)
        s.variables.append(Variable(part, group, text, unit, si, size, sensor))
        amplitude = 1.0 if amplitude is None else amplitude
        self.begin.append(start or (lambda rng, count, z: rng.uniform(-amplitude, amplitude, count) * size))
        return i

    def sizes(self, domain):
        """Sizes of displacement and momentum, flow and effort."""
        f0 = self.flow[domain]
        e0 = self.E0 / (self.tau * f0)
        return f0 * self.tau, e0 * self.tau, f0, e0

    def sensor(self, domain, role):
        """A sensor of the flow or the effort of a domain, in a unit that suits its size."""
        _, _, f0, e0 = self.sizes(domain)
        shown, size = (DOMAINS[domain][3], f0) if role == "p" else (DOMAINS[domain][4], e0)
        if (domain, role) not in self.shown:
            fitting = [x for x in shown if 0.05 < size / x[2] < 2000] or shown[:1]
            self.shown[domain, role] = self.draw.one(fitting)
        name, unit, si = self.shown[domain, role]
        return Sensor(name, unit, True, 1 / si)

    def x(self, part, group, domain, shapes=None, amplitude=None, energy=True):
        """A spring, a capacitor, a vessel."""
        size = self.sizes(domain)[0]
        sensor = self.sensor(domain, "x") if DOMAINS[domain][4] else Sensor(group, DOMAINS[domain][0], False)
        i = self.add(part, group, DOMAINS[domain][0], size, sensor, amplitude)
        self.stores[i] = (domain, "x")
        if energy:
            self.energy(self.draw.store(shapes or ("square", "hard", "soft", "skew", "exp")), i)
        return i

    def p(self, part, group, domain, shapes=None, amplitude=None, energy=True):
        """A mass, a coil, a column of fluid."""
        size = self.sizes(domain)[1]
        i = self.add(part, group, DOMAINS[domain][1], size, self.sensor(domain, "p"), amplitude)
        self.stores[i] = (domain, "p")
        if energy:
            shapes = shapes or (("square", "square", "hard", "cosh") if domain == "electric" else ("square",))
            self.energy(self.draw.store(shapes), i)
        return i

    def energy(self, law, *index):
        """E0 law(z/Z0)"""
        sizes = [self.system.variables[i].size for i in index]
        self.system.energies.append((list(index), lambda *z: self.E0 * law(*(v / s for v, s in zip(z, sizes)))))

    def pair(self, p, x, c=1.0):
        """The flow of p fills x, times c: exactly 1 or -1 within a domain, a transducer between domains."""
        (dp, _), (dx, _) = self.stores[p], self.stores[x]
        if dp != dx:
            v = self.system.variables
            c *= v[p].size * v[x].size / (self.E0 * self.tau) * self.draw.uniform(0.5, 1.3)
        self.system.pairs.append((x, p, c, []))

    def body(self, part, group="s", rise=None, start=(285.0, 315.0), sensed=None):
        """A body with an entropy; `rise` is what the energy E0 would warm it."""
        d = self.draw
        rise = rise or d.log(0.3, 8)
        law = Body(d, self.E0 / rise)
        s = self.system
        low, high = start
        i = self.add(part, group, "J/K", law.capacity * 0.05, None,
                     start=lambda rng, count, z: law.entropy(rng.uniform(low, high, count)))
        sensed = self.thermometers if sensed is None else sensed
        s.bodies[i] = law
        if self.logger and not sensed:  # large surroundings
            s.energies.append(([i], lambda z: T0 * z))
            self.begin[-1] = lambda rng, count, z: np.zeros(count)
        else:
            s.energies.append(([i], law.energy))
        if sensed:
            s.variables[i].sensor = Sensor("T", "degC" if self.celsius else "K", True, 1.0, -273.15 if self.celsius else 0.0)
        self.sinks.setdefault(part, i)
        return i

    def friction(self, along, sinks=None, law=None, share=None, scale=1.0, reads=()):
        """A loss along flows (or efforts, for displacements) [(variable, +-1)]. It heats the bodies of the parts."""
        d, v = self.draw, self.system.variables
        i = along[0][0]
        domain, role = self.stores[i]
        x0, p0, f0, e0 = self.sizes(domain)
        if sinks is None:
            parts = [v[j].part for j, _ in along]
            own = [self.sinks[p] for p in dict.fromkeys(parts) if p in self.sinks]
            sinks = own or ([self.sinks["*"]] if "*" in self.sinks else [])
            if not sinks:
                raise ValueError("nothing takes up the heat")
            if len(sinks) == 2 and d.chance(0.5):
                sinks = sinks[:1]
        shares = [1.0] if len(sinks) == 1 else [w := d.uniform(0.3, 0.7), 1 - w]
        rho = law or d.resistance()
        size, base = (f0, e0 / f0) if role == "p" else (e0, f0 / e0)
        s = sinks[0]
        self.system.frictions.append(Friction(list(along), lambda f, z, dE: scale * base * rho(f / size, dE[s]),
                                              list(zip(sinks, shares)), list(reads)))

    def conduct(self, a, b, slow=None):
        d, bodies = self.draw, self.system.bodies
        capacity = min(bodies[a].capacity, bodies[b].capacity)
        g, beta = capacity / (self.tau * (slow or d.log(3, 60))), d.uniform(-0.008, 0.008)
        G = d.one((lambda Ta, Tb: g, lambda Ta, Tb: g * np.exp(beta * ((Ta + Tb) / 2 - T0)),
                   lambda Ta, Tb: g * (Ta**2 + Tb**2) * (Ta + Tb) / (4 * T0**3)))
        self.system.conductions.append(Conduction(a, b, G))

    def conductions(self, chance=0.8):
        """Conduction from body to body."""
        bodies = sorted(self.system.bodies)
        for a, b in zip(bodies, bodies[1:]):
            if self.draw.chance(chance):
                self.conduct(a, b)

    def give(self, title):
        """The finished system: names of columns, times, starts."""
        d, s = self.draw, self.system
        s.title = title
        s.dt = self.tau * d.uniform(0.08, 0.25)
        s.dt = float(f"{s.dt:.1e}")
        s.nstate = d.whole(120, 260)
        begin = self.begin

        def start(rng, count):
            z = np.zeros((len(begin), count))
            for i, law in enumerate(begin):
                z[i] = law(rng, count, z)
            return z
        s.start = start
        s.prepare()
        return s
