"""A GENERIC system as plain data, its rates, its truth, and the check of both laws.

zdot = L dE + dissipation + inputs. States stand in SI units in an array [variable][trajectory]. Energies are functions
of few variables each; their gradients are complex steps, exact to rounding. What dissipates gives all its power to
entropies, so that both laws hold for any laws of the elements; `check` measures that they do.
"""
import dataclasses
import typing

import numpy as np
from scipy.integrate import DOP853

STEP = 1e-30  # of the complex step: far below rounding
CONVERGED = 3e-11  # the error of one interval between samples, in deviations, as halving the step shows it
COARSE = 1e-6  # the same for the steps of rk4 that an engineer would take
GROWTH = 300.0  # a typical small difference of starts may grow by this factor: beyond, nothing could be predicted
DRIFT = 1e-8  # of the energy, relative to the energy that moves


RK4 = (np.array([[0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1.0, 0]]), np.array([1, 2, 2, 1]) / 6.0,
       np.array([0, 0.5, 0.5, 1.0]))


class Unsuitable(Exception):
    """A draw that makes no usable system: stiff, unbounded, chaotic, or at rest. Another draw takes its place."""


@dataclasses.dataclass
class Sensor:
    """What a logger shows of a variable: itself or its co-energy, times `gain`, plus `offset`."""
    name: str
    unit: str
    coenergy: bool
    gain: float = 1.0
    offset: float = 0.0


@dataclasses.dataclass
class Variable:
    """A column: part, group, unit, the SI unit and the size of one in the other; `size` is the typical magnitude, SI."""
    part: str
    group: str
    unit: str
    base: str
    si: float
    size: float
    sensor: typing.Optional[Sensor] = None
    column: str = ""
    relative_to: typing.Optional[int] = None  # the dataset holds the sum of both


@dataclasses.dataclass
class Friction:
    """The flow f = sum c_i dE_i loses the power R f^2, which heats `sinks`, a list of (entropy, share)."""
    along: list  # (variable, number or function of z)
    R: typing.Callable  # (f, z, dE) -> positive
    sinks: list
    reads: list


@dataclasses.dataclass
class Conduction:
    """Heat G(Ta, Tb) (Tb - Ta) flows from b to a."""
    a: int
    b: int
    G: typing.Callable


@dataclasses.dataclass
class Input:
    """What the outside does: `force` (an effort on a variable), `power` (into an entropy), `bath` (its temperature)."""
    name: str
    unit: str
    si: float
    kind: str
    into: int
    gain: float  # of a force: rate per effort; of a bath: conductance, W/K
    mean: float
    swing: float


class System:
    def __init__(self, kind):
        self.kind, self.title, self.dt, self.nstate, self.substeps = kind, "", 0.0, 0, 1
        self.variables, self.energies, self.pairs, self.frictions, self.conductions, self.inputs = [], [], [], [], [], []
        self.bodies = {}  # entropies: index to the law of the body
        self.start = None  # function of (rng, count): states [variable][count]

    # Energies ---------------------------------------------------------------------------------------------------------

    def gradient(self, z):
        """dE, and the energies of all terms [term][trajectory]."""
        dE = np.zeros(z.shape)
        terms = []
        for index, energy in self.energies:
            if len(index) == 1:
                value = energy(z[index[0]] + 1j * STEP)
                dE[index[0]] += value.imag / STEP
                terms.append(value.real)
                continue
            steps = z[index][:, None, :] + 1j * STEP * np.eye(len(index))[:, :, None]
            value = energy(*steps)
            dE[index] += value.imag / STEP
            terms.append(value[0].real)
        return dE, terms

    def prepare(self):
        """Sums constant pairs into a matrix."""
        n = len(self.variables)
        self.L = np.zeros((n, n))
        self.turning = []
        for i, j, c, reads in self.pairs:
            if callable(c):
                self.turning.append((i, j, c))
            else:
                self.L[i, j] += c
                self.L[j, i] -= c

    def rates(self, z, u):
        """zdot, with the power and the entropy flow from outside in two more rows."""
        n = len(self.variables)
        z = z[:n]
        dE, _ = self.gradient(z)
        out = np.zeros((n + 2, z.shape[1]))
        out[:n] = self.L @ dE
        for i, j, c in self.turning:
            c = c(z)
            out[i] += c * dE[j]
            out[j] -= c * dE[i]
        for e in self.frictions:
            along = [(i, c(z) if callable(c) else c) for i, c in e.along]
            f = sum(c * dE[i] for i, c in along)
            w = e.R(f, z, dE) * f
            for i, c in along:
                out[i] -= c * w
            for s, share in e.sinks:
                out[s] += share * w * f / dE[s]
        for e in self.conductions:
            heat = e.G(dE[e.a], dE[e.b]) * (dE[e.b] - dE[e.a])
            out[e.a] += heat / dE[e.a]
            out[e.b] -= heat / dE[e.b]
        for e, value in zip(self.inputs, u):
            if e.kind == "force":
                out[e.into] += e.gain * value
                out[n] += e.gain * value * dE[e.into]
                continue
            heat = value if e.kind == "power" else e.gain * (value - dE[e.into])
            out[e.into] += heat / dE[e.into]
            out[n] += heat
            if e.kind == "bath":
                out[n + 1] += heat / value
        return out

    # Trajectories -----------------------------------------------------------------------------------------------------

    def advance(self, z, u, steps, method):
        """States one interval later. u(t) has the values of the inputs a time t after the start of the interval."""
        A, B, C = method
        h = self.dt / steps
        K = np.zeros((len(B),) + z.shape)
        for step in range(steps):
            for i in range(len(B)):
                K[i] = self.rates(z + h * np.tensordot(A[i, :i], K[:i], 1) if i else z, u((step + C[i]) * h))
            z = z + h * np.tensordot(B, K, 1)
        return z

    def integrate(self, z0, u, steps, method):
        """States [time][variable][trajectory]. u(interval, t) has the values of the inputs [input][trajectory]."""
        states = [np.vstack([z0, np.zeros((2, z0.shape[1]))])]
        for interval in range(self.nstate - 1):
            states.append(self.advance(states[-1], lambda t: u(interval, interval * self.dt + t), steps, method))
            if not np.isfinite(states[-1]).all():
                raise Unsuitable("not finite")
        return np.array(states)

    def interval_error(self, states, u, steps, method, fine):
        """The largest error of one interval from the given states, in deviations; `fine` = (steps, method) is the truth."""
        n, intervals = len(self.variables), range(0, self.nstate - 1, 2)
        start = np.concatenate([states[i] for i in intervals], axis=1)

        def values(t):
            return np.concatenate([u(i, i * self.dt + t) for i in intervals], axis=1) if self.inputs else ()
        difference = self.advance(start, values, steps, method) - self.advance(start, values, *fine)
        error = np.max(np.abs(difference[:n]) / self.deviation(states))
        return error if np.isfinite(error) else np.inf

    def truth(self, z0, u, most=8):
        """States by the method of Dormand and Prince of order 8, with equal steps that are halved until they suffice."""
        method = DOP853.A, DOP853.B, DOP853.C
        with np.errstate(all="ignore"):
            for steps in 1, 2, 4, 8:
                try:
                    states = self.integrate(z0, u, steps, method)
                except Unsuitable:
                    continue
                if np.min(self.deviation(states)) == 0:
                    raise Unsuitable("at rest")
                taken = steps
                while self.interval_error(states, u, steps, method, (2 * steps, method)) > CONVERGED:
                    steps *= 2
                    if steps > most:
                        raise Unsuitable("stiff or singular")
                return states if steps == taken else self.integrate(z0, u, steps, method)
        raise Unsuitable("stiff or singular")

    def user_substeps(self, states, u):
        """The substeps of rk4 that an engineer would find by halving until nothing changes."""
        with np.errstate(all="ignore"):
            for steps in 1, 2, 4, 8:
                if self.interval_error(states, u, steps, RK4, (2 * steps, RK4)) < COARSE:
                    return steps
        return 16

    def deviation(self, states):
        """The typical deviation of each group [variable][1] within a trajectory, over its components."""
        n = len(self.variables)
        spread = np.sqrt(np.mean(np.var(states[:, :n], axis=0), axis=1))
        groups = {}
        for i, v in enumerate(self.variables):
            groups.setdefault((v.part, v.group), []).append(i)
        for members in groups.values():
            spread[members] = np.sqrt(np.mean(spread[members] ** 2))
        return spread[:, None]

    def check(self, states):
        """Measures both laws: the drift of the energy relative to the energy that moves, or to 1e-4 of the whole where
        less moves, and the fall of the entropy relative to the entropy that moves. Raises AssertionError where one does
        not hold."""
        n = len(self.variables)
        terms = np.array([np.array(self.gradient(z[:n])[1]) for z in states])
        total = terms.sum(1) - states[:, n]
        moved = np.max(np.sum(np.abs(terms - terms[0]), axis=1), axis=0) + np.max(np.abs(states[:, n]), axis=0)
        drift = np.max(np.abs(total - total[0]) / np.maximum(moved, 1e-4 * np.max(np.abs(terms))))
        assert drift < DRIFT, f"{self.kind}: the energy drifts by {drift:.1e}"
        entropies = sorted(self.bodies)
        if not entropies:
            return drift, 0.0
        total = states[:, entropies].sum(1) - states[:, n + 1]
        moved = np.max(np.sum(np.abs(states[:, entropies] - states[0, entropies]), axis=1), axis=0)
        fall = np.max(-np.diff(total, axis=0) / np.maximum(moved, 1e-300))
        assert fall < 1e-9, f"{self.kind}: the entropy falls by {fall:.1e}"
        return drift, fall

    def production(self, states):
        """The entropy produced over each trajectory, J/K."""
        total = states[:, sorted(self.bodies)].sum(1) - states[:, len(self.variables) + 1]
        return total[-1] - total[0]
