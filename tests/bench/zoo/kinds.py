"""The kinds of systems: each function draws one of its kind from a builder."""
import numpy as np

from draw import T0
from generic import Friction, Sensor, Unsuitable

GROUPS = {  # names of displacements and momenta
    "translation": [("x", "p"), ("pos", "mom")], "rotation": [("theta", "L"), ("phi", "h"), ("angle", "L")],
    "electric": [("q", "phi"), ("Q", "flux"), ("q", "psi")], "hydraulic": [("V", "P"), ("V", "m"), ("vol", "G")],
}
PARTS = {
    "translation": ["cart", "block", "slider", "table", "ram"], "rotation": ["disc", "shaft", "rotor", "wheel", "drum"],
    "electric": ["tank", "loop", "filter", "supply", "cell"], "hydraulic": ["vessel", "line", "reservoir", "chamber", "hose"],
}
CASES = ["housing", "air", "frame", "base", "room"]


def numbered(b, names, n):
    """n names of parts: cart1, cart2, or three different ones."""
    if n == 1 or (n <= len(names) and b.draw.chance(0.4)):
        return [str(x) for x in b.draw.rng.permutation(names)[:n]]
    name = b.draw.one(names)
    return [f"{name}{k + 1}" for k in range(n)]


def case(b):
    """A body that takes up the heat of all that has no entropy of its own."""
    part = b.draw.one(CASES)
    b.sinks["*"] = b.body(part)
    return part


def chain(b):
    """Masses or discs in a row, joined by springs and dampers."""
    d = b.draw
    domain = d.one(("translation", "translation", "rotation"))
    b.scales(domain)
    n, (gx, gp) = d.whole(1, 4), d.one(GROUPS[domain])
    whole = n > 1 and d.chance(0.35)
    absolute = n > 1 and (whole or d.chance(0.4))
    wall = n == 1 or d.chance(0.75) or absolute
    names = ["train"] * n if whole else numbered(b, PARTS[domain], n)
    amplitude = d.uniform(0.5, 1.0)
    xs, ps = [], []
    shapes = ("square", "hard", "soft", "skew", "exp") + (("well",) if n == 1 else ())
    for k, part in enumerate(names):
        spring = wall or k > 0
        law = d.store(shapes)
        if spring:
            x = b.x(part, gx, domain, amplitude=amplitude, energy=not whole)
            if whole:
                b.energy(*((lambda u, v, law=law: law(u - v), x, xs[-1]) if k else (law, x)))
            elif absolute and k:
                b.system.variables[x].relative_to = xs[-1]
                b.system.variables[x].unit, b.system.variables[x].si = b.system.variables[xs[0]].unit, b.system.variables[xs[0]].si
        xs.append(x if spring else None)
        ps.append(b.p(part, gp, domain, amplitude=amplitude))
        if spring:
            b.pair(ps[k], x)
            if k and not whole:
                b.pair(ps[k - 1], x, -1.0)
    if d.chance(0.08):
        return b.give(f"{n} in a row, without friction")
    own = whole or d.chance(0.7)
    if own:
        for part in dict.fromkeys(names):
            b.body(part)
    else:
        case(b)
    done = False
    for k in range(n):
        if d.chance(0.6) or (k == n - 1 and not done):
            b.friction([(ps[k], 1.0)])
            done = True
        if k and own and d.chance(0.6):
            b.friction([(ps[k], 1.0), (ps[k - 1], -1.0)])
            done = True
    b.conductions()
    return b.give(f"{n} in a row on springs with friction")


def network(b, domains, n, title):
    """A tree of stores in which displacements and momenta alternate; transducers lead from domain to domain."""
    d = b.draw
    b.scales(*dict.fromkeys(domains))
    whole = d.chance(0.3) and len(set(domains)) == 1
    groups = {x: d.one(GROUPS[x]) for x in domains}
    left = list(domains[1:])
    used, nodes = {}, []  # nodes: [variable, domain, role, part, degree]

    def node(domain, role, part):
        if part is None:
            base = d.one(PARTS[domain])
            used[base] = used.get(base, 0) + 1
            part = base if used[base] == 1 else f"{base}{used[base]}"
        name = groups[domain][role == "p"]
        count = sum(x[1:4] == [domain, role, part] for x in nodes)
        if count and not vectors:
            name += str(count + 1)
        i = b.p(part, name, domain) if role == "p" else b.x(part, name, domain, shapes=convex)
        nodes.append([i, domain, role, part, 0])
        return nodes[-1]

    vectors = d.chance(0.5)
    convex = ("square", "hard", "soft", "skew", "exp", "gas")
    node(domains[0], "p" if left else d.one("px"), None)
    while len(nodes) < n or left:
        parent = d.one([x for x in nodes if x[4] < 3])
        if left and parent[2] == "p" and (d.chance(0.5) or len(nodes) >= n - 1):
            # A coil drives a mass or a rotor (a motor); these drive a spring or a vessel (a pinion, a piston, a pump).
            domain = left.pop(0)
            child = node(domain, "p" if parent[1] == "electric" else "x", None if d.chance(0.85) else parent[3])
        else:
            mechanical = parent[1] in ("translation", "rotation")
            if mechanical and parent[2] == "x" and parent[4] >= 2:
                continue
            child = node(parent[1], "x" if parent[2] == "p" else "p", parent[3] if whole or d.chance(0.45) else None)
        p, x = (child, parent) if child[2] == "p" else (parent, child)
        b.pair(p[0], x[0], d.one((1.0, -1.0)))
        parent[4] += 1
        child[4] += 1
        if len(nodes) > n + 3:
            raise Unsuitable("grew too far")
    parts = list(dict.fromkeys(x[3] for x in nodes))
    for part in parts:
        if d.chance(0.5):
            b.body(part)
    if not b.sinks or d.chance(0.2):
        case(b)
    done = 0
    for i, domain, role, part, _ in nodes:
        sink = part in b.sinks or "*" in b.sinks
        chance = 0.75 if role == "p" else 0.25 if domain in ("electric", "hydraulic") else 0.0
        if sink and d.chance(chance):
            b.friction([(i, 1.0)], scale=1.0 if role == "p" else 0.4)
            done += 1
    for one in nodes:
        for two in nodes:
            fluid = one[1] in ("electric", "hydraulic") and one[2] == "x"
            if one[0] < two[0] and one[1:3] == two[1:3] and fluid and d.chance(0.3):
                if one[3] in b.sinks or two[3] in b.sinks or one[3] == two[3] and "*" in b.sinks:
                    b.friction([(one[0], 1.0), (two[0], -1.0)], scale=0.6)
                    done += 1
    if not done:
        raise Unsuitable("no loss")
    b.conductions()
    return b.give(title)


def circuit(b):
    """Capacitors, coils and resistors."""
    return network(b, ["electric"], b.draw.whole(2, 6), "a circuit")


def hydraulics(b):
    """Vessels, pipes with inertia, orifices."""
    return network(b, ["hydraulic"], b.draw.whole(2, 6), "vessels and lines")


def drive(b):
    """Motors, generators, pistons and pumps: two or three domains."""
    d = b.draw
    domains = d.one((["electric", "rotation"], ["electric", "translation"], ["rotation", "hydraulic"], ["translation", "hydraulic"],
                     ["electric", "rotation", "hydraulic"], ["electric", "rotation", "translation"]))
    return network(b, domains, d.whole(3, 6), "a drive")


def linkage(b):
    """Links that share inertia, in the field of gravity or on springs."""
    d = b.draw
    length, mass = d.log(0.1, 2), d.log(0.05, 20)
    b.tau, b.E0 = float(np.sqrt(length / 9.81)), mass * 9.81 * length
    b.flow = {"translation": length / b.tau, "rotation": 1 / b.tau}
    which = d.one(("cart", "double", "arm", "slider", "crank", "spinner"))
    gx, gp = d.one(GROUPS["rotation"])
    mu, ratio = d.uniform(0.2, 1.2), d.uniform(0.5, 1.3)
    part, a = {"cart": "trolley", "double": "pendulum", "arm": "arm", "slider": "rod", "crank": "press", "spinner": "governor"}[which], 0.7
    spring = d.store(("square", "hard", "skew"))
    if which == "cart":
        x, t = b.x(part, "x", "translation", energy=False, amplitude=a), b.x(part, gx, "rotation", energy=False, amplitude=a)
        p, h = b.p(part, "p", "translation", energy=False, amplitude=a), b.p(part, gp, "rotation", energy=False, amplitude=0.5 * a)
        b.energy(lambda t, p, h: (mu * p**2 - 2 * mu * np.cos(t) * p * h + (1 + mu) * h**2) / (2 * mu * (1 + mu * np.sin(t) ** 2)), t, p, h)
        b.energy(lambda t: mu * (1 - np.cos(t)), t)
        b.energy(spring, x)
        moves = [(p, x), (h, t)]
    elif which in ("double", "arm"):
        one = d.chance(0.6)
        t = [b.x(part, gx if one else f"{gx}{k + 1}", "rotation", energy=False, amplitude=0.6) for k in range(2)]
        h = [b.p(part, gp if one else f"{gp}{k + 1}", "rotation", energy=False, amplitude=0.4) for k in range(2)]
        if which == "double":
            c = lambda u, v: mu * ratio * np.cos(u - v)
            m11, m22 = 1 + mu, mu * ratio**2
            b.energy(lambda u, v, g, k: (m22 * g**2 - 2 * c(u, v) * g * k + m11 * k**2) / (2 * (m11 * m22 - c(u, v) ** 2)), *t, *h)
            b.energy(lambda u: (1 + mu) * (1 - np.cos(u)), t[0])
            b.energy(lambda v: mu * ratio * (1 - np.cos(v)), t[1])
        else:  # joint angles
            m22 = mu * ratio**2
            m12 = lambda v: m22 + mu * ratio * np.cos(v)
            m11 = lambda v: 1 + mu + m22 + 2 * mu * ratio * np.cos(v)
            b.energy(lambda v, g, k: (m22 * g**2 - 2 * m12(v) * g * k + m11(v) * k**2) / (2 * (m11(v) * m22 - m12(v) ** 2)), t[1], *h)
            b.energy(spring, t[0])
            b.energy(d.store(("square", "hard", "skew")), t[1])
        moves = list(zip(h, t))
    elif which == "slider":  # a mass that slides on a swinging rod
        x, t = b.x(part, "r", "translation", energy=False, amplitude=0.3), b.x(part, gx, "rotation", energy=False, amplitude=a)
        p, h = b.p(part, "p", "translation", energy=False, amplitude=0.5), b.p(part, gp, "rotation", energy=False, amplitude=a)
        stiff = d.uniform(3, 8)
        b.energy(lambda x, h: h**2 / (2 * (mu + (1 + x) ** 2)), x, h)
        b.energy(lambda p: p**2 / 2, p)
        b.energy(lambda x, t: stiff * x**2 / 2 - (1 + x) * np.cos(t) + 1, x, t)
        moves = [(p, x), (h, t)]
    elif which == "crank":  # the inertia depends on the angle
        t, h = b.x(part, gx, "rotation", energy=False, amplitude=1.5), b.p(part, gp, "rotation", energy=False, amplitude=1.5)
        b.energy(lambda t, h: h**2 / (2 * (1 + mu * np.sin(t) ** 2)), t, h)
        b.energy(lambda t: ratio * (1 - np.cos(t)), t)
        moves = [(h, t)]
        if d.chance(0.6):  # a wheel on a shaft
            u = b.x("wheel", "twist", "rotation", amplitude=0.6)
            w = b.p("wheel", gp, "rotation", amplitude=a)
            b.pair(w, u)
            b.pair(h, u, -1.0)
            moves.append((w, None))
    else:  # a mass that swings out of a spinning shaft; the spin has no angle
        x, p = b.x(part, "r", "translation", energy=False, amplitude=0.3), b.p(part, "p", "translation", energy=False, amplitude=0.4)
        h = b.p(part, gp, "rotation", energy=False, amplitude=1.0)
        b.begin[-1] = lambda rng, count, z: rng.uniform(0.5, 1.5, count) * b.system.variables[h].size
        b.energy(lambda x, h: h**2 / (2 * (mu + (1 + x) ** 2)), x, h)
        b.energy(lambda p: p**2 / 2, p)
        stiff = d.uniform(2, 6)
        b.energy(lambda x: stiff * x**2 + x, x)
        moves = [(p, x), (h, None)]
    for p, x in moves:
        if x is not None:
            b.pair(p, x)
    parts = list(dict.fromkeys(v.part for v in b.system.variables))
    if d.chance(0.6):
        for name in parts:
            b.body(name)
    else:
        case(b)
    for p, x in moves:
        b.friction([(p, 1.0)], scale=0.4)
    b.conductions()
    return b.give(f"a {part}")


def electromagnet(b):
    """A coil or a capacitor whose inductance or capacitance depends on the place of a mass on a spring."""
    d = b.draw
    b.scales("electric", "translation")
    part, k = d.one(("actuator", "relay", "transducer")), d.uniform(0.3, 0.8) * d.one((1, -1))
    gap = d.one((lambda x: np.exp(k * x), lambda x: 1 / (0.5 + 1 / (1 + np.exp(2 * k * x))), lambda x: 1 + k * x + k**2 * x**2))
    magnetic, (gq, gphi) = d.chance(0.6), d.one(GROUPS["electric"])
    x, p = b.x(part, "x", "translation", shapes=("hard", "skew", "square")), b.p(part, "p", "translation")
    if magnetic:
        e = b.p(part, gphi, "electric", energy=False)
        other = b.x(d.one(("supply", "capacitor", part)), gq, "electric")
        b.pair(e, other, d.one((1.0, -1.0)))
    else:
        e = b.x(part, gq, "electric", energy=False)
        other = b.p(d.one(("supply", "coil", part)), gphi, "electric")
        b.pair(other, e, d.one((1.0, -1.0)))
    saturates = d.chance(0.3)
    b.energy(lambda x, e: gap(x) * (np.sqrt(1 + e**2) - 1 if saturates else e**2 / 2), x, e)
    b.pair(p, x)
    b.body(part)
    if b.system.variables[other].part != part and d.chance(0.4):
        b.body(b.system.variables[other].part)
    b.friction([(p, 1.0)])
    b.friction([(e if magnetic else other, 1.0)], sinks=[b.sinks[part]])
    b.conductions()
    return b.give("a mass moved by a field")


def nonholonomic(b):
    """A body on a runner or on wheels, which cannot slip sideways."""
    d = b.draw
    b.scales("translation", "rotation")
    # One length for both: the flow of translation is the length over the time.
    length = b.sizes("translation")[0]
    part, g = d.one(("sledge", "robot", "skate")), d.one((("r", "phi", "p", "L"), ("pos", "heading", "p", "h")))
    b.flow["rotation"] = 1 / b.tau
    x, y = (b.x(part, g[0], "translation", energy=False, amplitude=0.6) for _ in range(2))
    phi = b.x(part, g[1], "rotation", energy=False, amplitude=3.0)
    p, L = b.p(part, g[2], "translation"), b.p(part, g[3], "rotation", amplitude=0.7)
    s = b.system
    turn = d.uniform(-0.4, 0.4) * s.variables[p].size / s.variables[L].size * (0 if d.chance(0.3) else 1)
    s.pairs += [(x, p, lambda z: np.cos(z[phi]), [phi]), (y, p, lambda z: np.sin(z[phi]), [phi]), (phi, L, 1.0, [])]
    if turn:
        s.pairs.append((p, L, lambda z: turn * z[L], [L]))
    a, c = d.uniform(0.5, 1.5), d.uniform(0.5, 1.5)
    b.energy(d.one((lambda x, y: (a * x**2 + c * y**2) / 2, lambda x, y: a * (x**2 + y**2) / 2 + c * (x**2 + y**2) ** 2 / 4,
                    lambda x, y: a * np.sqrt(1 + x**2 + c * y**2))), x, y)
    if d.chance(0.4):
        b.energy(lambda t: 0.3 * (1 - np.cos(t)), phi)
    if d.chance(0.35):  # a trailer
        t, arm = b.x(part, "trailer", "rotation", energy=False, amplitude=3.0), length * d.uniform(0.5, 1.5)
        s.pairs.append((t, p, lambda z: -np.sin(z[t] - z[phi]) / arm, [t, phi]))
    ground = d.chance(0.6)
    b.body(part)
    if ground:
        low = b.body(d.one(("ice", "floor", "ground")), rise=d.log(0.1, 3))
    for i in (p, L):
        b.friction([(i, 1.0)], sinks=[b.sinks[part], low] if ground and d.chance(0.6) else [b.sinks[part]])
    b.conductions(1.0)
    return b.give("a body that cannot slip sideways")


def planar(b):
    """Masses in the plane or in space on springs, with drag, gravity, or a magnetic field."""
    d = b.draw
    b.scales("translation")
    b.tau, b.flow["translation"] = d.log(0.05, 1), d.log(0.05, 3)
    dim, n = d.one((2, 2, 3)), d.one((1, 1, 2))
    names = numbered(b, ["bob", "ball", "probe", "particle"], n)
    gx, gp = d.one((("q", "p"), ("r", "p"), ("x", "mom")))
    central, rest = d.chance(0.7), d.uniform(0.6, 1.2)
    b.thermoelastic = d.chance(0.35)
    before = None
    lost = None
    for k, part in enumerate(names):
        x = [b.x(part, gx, "translation", energy=False) for _ in range(dim)]
        p = [b.p(part, gp, "translation", energy=False, amplitude=0.6) for _ in range(dim)]
        if k and d.chance(0.6):
            for i, j in zip(x, before[0]):
                v = b.system.variables
                v[i].relative_to, v[i].unit, v[i].si = j, v[j].unit, v[j].si
        weight, stiff, power, tilt = d.uniform(0.6, 1.6), d.uniform(0.8, 2), d.one(("log", "square", "hard")), d.uniform(0.7, 1.4)
        radius = lambda *q: np.sqrt(sum(u**2 for u in q) + 1e-4)
        stretch = {"log": lambda r: np.log(r / rest), "square": lambda r: r - rest, "hard": lambda r: (r - rest) + 0.3 * (r - rest) ** 3}[power]
        low = [v for v in range(dim)]

        def begin(i, axis):  # not near the centre
            size = b.system.variables[i].size
            return lambda rng, count, z: size * (rng.uniform(0.8, 1.5, count) if axis == 0 else rng.uniform(-0.7, 0.7, count))
        if central:
            b.energy(lambda *q: stiff * stretch(radius(*q)) ** 2 / 2, *x)
            for axis in low:
                b.begin[x[axis]] = begin(x[axis], axis)
        else:
            b.energy(lambda *q: sum(stiff * tilt**axis * u**2 / 2 for axis, u in enumerate(q)) + 0.3 * sum(u**2 for u in q) ** 2, *x)
        b.energy(lambda *q: sum(u**2 for u in q) / (2 * weight), *p)
        if d.chance(0.25):
            b.energy(lambda u: 0.4 * u, x[-1])
        for i, j in zip(x, p):
            b.pair(j, i)
        if k:
            for i, j in zip(x, before[1]):
                b.pair(j, i, -1.0)
        elif d.chance(0.35):  # a magnetic field across the first two axes
            field = d.uniform(0.3, 1.2) * b.system.variables[p[0]].size ** 2 / (b.E0 * b.tau)
            b.system.pairs.append((p[0], p[1], field, []))
        s = b.body(part)
        if central and b.thermoelastic and (not b.logger or b.thermometers):  # heat that depends on the length
            law, shift = b.system.bodies[s], d.uniform(0.1, 0.5) * b.E0 / T0
            sizes = [b.system.variables[i].size for i in x]
            b.system.energies[[i for i, e in enumerate(b.system.energies) if e[0] == [s]][0]] = (
                [s] + x, lambda s, *q: law.energy(s - shift * np.log(radius(*(u / z for u, z in zip(q, sizes))))))
        if d.chance(0.8) or k == n - 1:
            lost = drag(b, p, s)
        before = (x, p)
    if d.chance(0.3):
        b.body(d.one(CASES))
    b.conductions(1.0)
    return b.give(f"{n} mass{'es' if n > 1 else ''} in {dim} dimensions")


def drag(b, p, s):
    """Drag along the velocity, by a law of the speed."""
    rho, (_, _, f0, e0) = b.draw.resistance(), b.sizes("translation")
    for i in p:
        b.friction([(i, 1.0)], sinks=[s], law=lambda f, T: 1.0)
        b.system.frictions[-1].R = lambda f, z, dE: e0 / f0 * rho(np.sqrt(sum(dE[j] ** 2 for j in p)) / f0, dE[s])
        b.system.frictions[-1].reads = list(p)


def rotor(b):
    """Rigid bodies that turn: one or two, with a wheel inside, or with a direction of gravity."""
    d = b.draw
    b.scales("rotation")
    b.flow["rotation"] = 1 / b.tau
    n = d.one((1, 1, 2))
    names = numbered(b, ["body", "satellite", "top", "gyro"], n)
    group, all_m = d.one(("m", "L", "M")), []
    s = b.system
    for part in names:
        m = [b.p(part, group, "rotation", energy=False) for _ in range(3)]
        all_m.append(m)
        inertia = [d.uniform(0.5, 1.6) for _ in range(3)]
        if max(inertia) > sum(inertia) - max(inertia):
            inertia[inertia.index(max(inertia))] = 0.9 * (sum(inertia) - max(inertia))
        wheel = n == 1 and d.chance(0.4)
        if wheel:  # its momentum along the third axis is part of m
            h = b.p(part, "h", "rotation", energy=False)
            spin = d.uniform(0.1, 0.3)
            b.energy(lambda u, v, w, h: u**2 / (2 * inertia[0]) + v**2 / (2 * inertia[1]) + (w - h) ** 2 / (2 * inertia[2]) + h**2 / (2 * spin), *m, h)
            b.begin[h] = lambda rng, count, z: rng.uniform(-0.3, 0.3, count) * s.variables[h].size
        else:
            b.energy(lambda u, v, w, i=inertia: u**2 / (2 * i[0]) + v**2 / (2 * i[1]) + w**2 / (2 * i[2]), *m)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            s.pairs.append((m[i], m[j], lambda z, k=m[k]: -z[k], [m[k]]))
        sink = b.body(part)
        if n == 1 and d.chance(0.4):  # a direction that turns with the body, such as that of gravity
            g = [b.add(part, "g", "1", 1.0, Sensor("g", "1", False)) for _ in range(3)]

            def begin(rng, count, z, g=g):
                v = rng.normal(size=(3, count))
                z[g] = v / np.sqrt((v**2).sum(0))
                return z[g[0]]
            b.begin[g[0]] = begin
            for i in g[1:]:
                b.begin[i] = lambda rng, count, z, i=i: z[i]
            height = [d.uniform(-0.8, 0.8) for _ in range(3)]
            b.energy(lambda *u, c=height: sum(a * v for a, v in zip(c, u)), *g)
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                s.pairs += [(g[i], m[j], lambda z, k=g[k]: -z[k], [g[k]]), (m[i], g[j], lambda z, k=g[k]: -z[k], [g[k]])]
        if wheel:
            b.friction([(h, 1.0)], sinks=[sink])
        if d.chance(0.6) or (n == 1 and not wheel):
            for i in m:
                b.friction([(i, 1.0)], sinks=[sink], law=b.draw.resistance(False), scale=0.3)
    if n == 2:
        for i, j in zip(*all_m):
            b.friction([(i, 1.0), (j, -1.0)], law=b.draw.resistance(False), scale=0.5)
    b.conductions()
    return b.give("rigid bodies that turn")


def heat(b):
    """Bodies that conduct and radiate."""
    d = b.draw
    b.tau, b.E0, b.thermometers = d.log(0.5, 600), d.log(1, 1e4), True
    n = d.whole(2, 5)
    together = d.chance(0.3)
    names = [d.one(("rod", "wall", "stack"))] * n if together else numbered(b, ["block", "plate", "body", "wall", "tank"], n)
    bodies = [b.body(part, start=(275.0, 345.0), rise=d.log(8, 60)) for part in names]
    for k in range(1, n):
        b.conduct(bodies[k], bodies[d.whole(max(0, k - 2), k - 1) if not together else k - 1], slow=d.log(3, 20))
    if n > 2 and d.chance(0.5):
        b.conduct(bodies[-1], bodies[0], slow=d.log(3, 20))
    return b.give(f"{n} bodies that exchange heat")


def reaction(b):
    """Species that react and diffuse; the heat of reaction warms the mixture."""
    d = b.draw
    b.tau, b.thermometers = d.log(0.5, 300), True
    moles, R = d.log(0.01, 10), 8.314
    b.E0 = moles * R * T0
    cells = d.one((1, 1, 2))
    names = numbered(b, ["vessel", "reactor", "cell"], cells)
    scheme = d.one(([("A", "B")], [("A", "B"), ("B", "C")], [("AB", "C")], [("A", "BB")]))
    species = sorted(set("".join(x + y for x, y in scheme)))
    # Standard energies and entropies of the species, in units of R T0 and R: the heat warms by some 10 K.
    u, s0 = {x: d.uniform(-1.5, 1.5) for x in species}, {x: d.uniform(-0.5, 0.5) for x in species}
    c, wall = {x: d.uniform(3, 12) for x in species}, d.uniform(10, 40)
    k = [(d.log(0.05, 0.5), d.uniform(0, 8000)) for _ in scheme]
    vector, prefixed = d.chance(0.4), b.unit("mol", moles)
    system, all_n, all_s = b.system, [], []
    for part in names:
        n = {}
        for x in species:
            n[x] = b.add(part, "n" if vector else x, "mol", moles, Sensor(x, prefixed[0], False, 1 / prefixed[1]))
            low, high = d.uniform(0.1, 0.4), d.uniform(0.6, 1.6)
            b.begin[n[x]] = lambda rng, count, z, low=low, high=high: rng.uniform(low, high, count) * moles
        s = b.body(part, rise=T0 * R * moles / (R * moles * (wall + sum(c.values()))), sensed=True)
        index = [s] + [n[x] for x in species]

        def temperature(s, *a):
            total, capacity = sum(a), R * (wall * moles + sum(c[x] * v for x, v in zip(species, a)))
            mixing = R * sum(v * (s0[x] - np.log(v / total)) for x, v in zip(species, a))
            return capacity, T0 * np.exp((s - mixing) / capacity)

        def energy(s, *a):
            capacity, T = temperature(s, *a)
            return R * T0 * sum(u[x] * v for x, v in zip(species, a)) + capacity * (T - T0)
        system.energies = [e for e in system.energies if e[0] != [s]] + [(index, energy)]

        def begin(rng, count, z, s=s, index=tuple(index)):
            a = [z[i] for i in index[1:]]
            zero = temperature(np.zeros(count), *a)
            return zero[0] * np.log(rng.uniform(290, 330, count) / zero[1])
        b.begin[s] = begin
        for (left, right), (speed, activation) in zip(scheme, k):
            along = {}
            for x in left:
                along[n[x]] = along.get(n[x], 0) + 1.0
            for x in right:
                along[n[x]] = along.get(n[x], 0) - 1.0

            def rate(f, z, dE, s=s, left=left, n=n, speed=speed, activation=activation):
                T = dE[s]
                forward = sum(dE[n[x]] / (R * T) for x in left)  # mass action: exp of potentials, forward less backward
                r = f / (R * T)
                ratio = np.where(np.abs(r) < 1e-6, 1 - r / 2, -np.expm1(-r) / np.where(r == 0, 1, r))
                return speed * moles / b.tau / (R * T) * np.exp(forward - activation * (1 / T - 1 / T0)) * ratio
            system.frictions.append(Friction(list(along.items()), rate, [(s, 1.0)], []))
        all_n.append(n)
        all_s.append(s)
    if cells == 2:
        for x in species:
            through = d.log(0.02, 0.2) * moles / b.tau / (R * T0)
            pair = [(all_n[0][x], 1.0), (all_n[1][x], -1.0)]
            system.frictions.append(Friction(pair, lambda f, z, dE, g=through: g + 0 * f, list(zip(all_s, (0.5, 0.5))), []))
    if d.chance(0.5):
        case(b)
        b.sinks.pop("*")
    b.conductions(1.0)
    return b.give("a reaction")


def gas(b):
    """Gases under pistons: between two of them, or against a spring; walls take heat."""
    d = b.draw
    b.scales("translation", "hydraulic")
    b.thermometers = True
    n = d.one((1, 1, 2))
    names = numbered(b, ["cylinder", "chamber", "gas"], n)
    piston = d.one(("piston", names[0], "wall"))
    p = b.p(piston, "p", "translation")
    v, system = b.system.variables, b.system
    if n == 1 or d.chance(0.4):
        x = b.x(piston, "x", "translation")
        b.pair(p, x)
    for k, part in enumerate(names):
        fill, gamma = d.uniform(2.5, 6), d.one((0.4, 0.6667))
        V = b.x(part, "V", "hydraulic", energy=False)
        V0 = fill * v[V].size
        v[V].sensor = Sensor("V", "l", False, 1e3)
        capacity = b.E0 * fill**2 / (gamma * (gamma + 1) * T0)
        s = b.body(part, rise=b.E0 / capacity, start=(285, 310))
        system.energies = [e for e in system.energies if e[0] != [s]]
        attraction = d.uniform(0, 0.15) * capacity * T0 * V0 if d.chance(0.3) else 0.0  # van der Waals
        pressure = gamma * capacity * T0 / V0 - attraction / V0**2
        system.energies.append(([V, s], lambda w, s, c=capacity, g=gamma, V0=V0, a=attraction:
                                c * T0 * (V0 / w) ** g * np.exp(s / c) - a / w))
        system.energies.append(([V], lambda w, q=pressure: q * w))
        b.begin[V] = lambda rng, count, z, V0=V0, size=v[V].size: V0 + rng.uniform(-0.8, 0.8, count) * size
        b.begin[s] = lambda rng, count, z, c=capacity, g=gamma, V0=V0, V=V: c * (
            np.log(rng.uniform(285, 310, count) / T0) - g * np.log(V0 / z[V]))
        # A piston moves both volumes by its area.
        c = v[p].size * v[V].size / (b.E0 * b.tau) * d.uniform(0.6, 1.3)
        system.pairs.append((V, p, c if k == 0 else -c, []))
    walls = d.chance(0.6)
    if walls:
        b.body(d.one(("case", "jacket", "shell")), rise=d.log(1, 8))
    b.friction([(p, 1.0)], sinks=[b.sinks[names[0]]], scale=0.5)
    b.conductions(1.0)
    return b.give("gas under a piston")


def viscous(b):
    """A mass on a material with inner strains that relax."""
    d = b.draw
    b.scales("translation")
    part = d.one(("bar", "pad", "specimen"))
    x, p = b.x(part, "x", "translation", shapes=("square", "hard", "skew")), b.p(part, "p", "translation")
    b.pair(p, x)
    n, together = d.one((1, 1, 2)), d.chance(0.5)
    s = b.body(part)
    for k in range(n):
        e = b.x(part, "e" if together or n == 1 else f"e{k + 1}", "translation", energy=False)
        b.system.variables[e].sensor = None
        law = d.store(("square", "square", "hard"))
        b.energy(lambda x, e, law=law: law(x - e), x, e)
        rho = d.resistance()
        b.friction([(e, 1.0)], law=rho, scale=d.log(1, 10))
    if d.chance(0.6):
        b.friction([(p, 1.0)])
    if d.chance(0.5):
        b.body(d.one(CASES))
    b.conductions(1.0)
    return b.give("a mass on a material that relaxes")


def thermoelectric(b):
    """A couple whose current carries entropy from one body to another."""
    d = b.draw
    b.scales("electric")
    b.thermometers = True
    hot, cold = numbered(b, ["block", "junction", "plate"], 2)
    coil, (gq, gphi) = hot, d.one(GROUPS["electric"])  # entropy passes between two ends of a port, not of two ports
    phi = b.p(coil, gphi, "electric")
    if d.chance(0.7):
        b.pair(phi, b.x(d.one(("capacitor", coil)), gq, "electric"))
    a, c = b.body(hot, rise=d.log(2, 8)), b.body(cold, rise=d.log(2, 8))
    _, _, f0, e0 = b.sizes("electric")
    carried = d.uniform(0.2, 0.8) * e0 / 20
    b.system.pairs += [(phi, a, carried, []), (phi, c, -carried, [])]
    b.friction([(phi, 1.0)], sinks=[a])
    b.conduct(a, c)
    return b.give("a current that carries entropy")


def celestial(b):
    """A planet and its moons in the plane: tides slow the spins and heat the bodies. Directions of friction turn with the orbit."""
    d = b.draw
    b.scales("translation", "rotation")
    b.flow["rotation"] = 1 / b.tau  # a full turn takes about 2 pi of these times
    size, whole = b.sizes("translation")[0], d.chance(0.5)
    g = d.one((("q", "p", "L"), ("r", "p", "J"), ("pos", "mom", "spin")))
    n = 1 if whole else d.one((1, 1, 2))
    moons = ["pair"] if whole else numbered(b, ["moon", "satellite", "probe"], n)
    planet = "pair" if whole else d.one(("planet", "earth"))
    inertia = d.uniform(0.1, 0.5)
    b.begin_spin = d.uniform(1.5, 3)
    spin = b.p(planet, g[2], "rotation", energy=False)
    b.begin[-1] = lambda rng, count, z: inertia * b.begin_spin * rng.uniform(0.6, 1.4, count) * b.system.variables[spin].size
    b.energy(lambda L: L**2 / (2 * inertia), spin)
    orbits = []
    for part in moons:
        weight, pull, exponent = d.uniform(0.6, 1.6), d.uniform(0.8, 1.3), d.one((1.0, 1.0, 0.7))
        x = [b.x(part, g[0], "translation", energy=False) for _ in range(2)]
        p = [b.p(part, g[1], "translation", energy=False) for _ in range(2)]
        b.energy(lambda u, v, pull=pull, a=exponent: -pull / a * (u**2 + v**2) ** (-a / 2), *x)
        b.energy(lambda u, v, weight=weight: (u**2 + v**2) / (2 * weight), *p)
        for i, j in zip(x, p):
            b.pair(j, i)
        v = b.system.variables
        momentum = v[p[0]].size * np.sqrt(weight * pull)

        def begin(rng, count, z, x=x, p=p, momentum=momentum):  # not far from circles
            radius, angle = rng.uniform(0.9, 1.5, count), rng.uniform(0, 2 * np.pi, count)
            speed, lean = momentum / np.sqrt(radius) * rng.uniform(0.85, 1.1, count), angle + rng.uniform(-0.15, 0.15, count)
            z[x[0]], z[x[1]] = size * radius * np.cos(angle), size * radius * np.sin(angle)
            z[p[0]], z[p[1]] = -speed * np.sin(lean), speed * np.cos(lean)
            return z[x[0]]
        b.begin[x[0]] = begin
        for i in (x[1], *p):
            b.begin[i] = lambda rng, count, z, i=i: z[i]
        orbits.append((x, p))
    s = b.body(planet, rise=d.log(1, 8))
    for x, p in orbits:
        tide, rise, power = d.log(0.01, 0.05), d.log(0.01, 0.05), d.one((2, 3, 6))
        square = lambda z, x=x: z[x[0]] ** 2 + z[x[1]] ** 2
        fall = lambda z, power=power, square=square: (square(z) / size**2) ** (-power / 2)
        across = [(p[0], lambda z, x=x, square=square: -z[x[1]] / square(z)), (p[1], lambda z, x=x, square=square: z[x[0]] / square(z))]
        along = [(p[k], lambda z, x=x, k=k, square=square: z[x[k]] / np.sqrt(square(z))) for k in range(2)]
        e0, f0 = b.sizes("translation")[3], b.sizes("translation")[2]
        for direction, law in ((across + [(spin, -1.0)], lambda f, z, dE, fall=fall, tide=tide: b.E0 * b.tau * tide * fall(z)),
                               (along, lambda f, z, dE, fall=fall, rise=rise: e0 / f0 * rise * fall(z))):
            b.system.frictions.append(Friction(direction, law, [(s, 1.0)], list(x)))
    return b.give(f"a planet and {n} moon{'s' if n > 1 else ''}, with tides")


def crank(b):
    """A flywheel that moves a slider through a crank: the lossless coupling depends on its angle."""
    d = b.draw
    b.scales("translation", "rotation")
    b.flow["rotation"] = 1 / b.tau
    whole = d.chance(0.3)
    wheel, slider = ("press", "press") if whole else (d.one(("wheel", "flywheel", "crank")), d.one(("piston", "slider", "ram")))
    (gt, gh), (gx, gp) = d.one(GROUPS["rotation"]), d.one(GROUPS["translation"])
    t = b.x(wheel, gt, "rotation", energy=False, amplitude=3.0)
    h = b.p(wheel, gh, "rotation", amplitude=1.5)
    x, p = b.x(slider, gx, "translation", amplitude=0.5), b.p(slider, gp, "translation", amplitude=0.5)
    b.energy(lambda u, a=d.uniform(0.1, 0.6): a * (1 - np.cos(u)), t)  # an unbalanced wheel
    b.pair(h, t)
    v, ratio, rod = b.system.variables, d.uniform(0.5, 1.0), d.uniform(0.1, 0.35) * d.one((0, 1))
    arm = ratio * v[h].size * v[x].size / (b.E0 * b.tau)
    # The stretch of the spring between the crosshead and the slider: its rate is arm sin(..) omega less the speed of the slider.
    b.system.pairs.append((x, h, lambda z: arm * (np.sin(z[t]) + rod * np.sin(2 * z[t])), [t]))
    b.pair(p, x, -1.0)
    b.body(wheel)
    if not whole:
        b.body(slider)
    for i in (h, p):
        b.friction([(i, 1.0)], scale=0.4)
    b.conductions()
    return b.give("a flywheel, a crank and a slider")


KINDS = {f.__name__: f for f in (chain, circuit, hydraulics, drive, linkage, electromagnet, nonholonomic, planar, rotor, heat,
                                 reaction, gas, viscous, thermoelectric, celestial, crank)}
