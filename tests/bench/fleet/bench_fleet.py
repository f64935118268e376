"""Measures copies of scenes (portmet.Fleet), interpreted and compiled, on one and two threads, and a
Scene alone, beside numpy, and PyTorch where it is installed, on the equations of
analytic_double_pendulum. Run it in the repository's root with PYTHONPATH=build/daemon/python; with
BENCH_QUICK in the environment it takes seconds. CPU time is that of all threads of the process."""
import os
import resource
import time

import numpy

import portmet

QUICK = "BENCH_QUICK" in os.environ
COUNTS = (1, 100) if QUICK else (1, 10, 100, 1000, 10000, 100000)
SECONDS = 0.02 if QUICK else 0.5  # of CPU time of a measurement
SCENES = "double_pendulum", "analytic_double_pendulum", "gas_containers", "driven_lower", "chain_10"


def cpu():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def measure(step, rounds=3):
    """Returns CPU and clock time, s, of one call of step(): the least of some rounds."""
    step()
    best = (float("inf"), float("inf"))
    for _ in range(rounds):
        calls, begin, clock = 0, cpu(), time.monotonic()
        while calls == 0 or cpu() - begin < SECONDS / 3:
            step()
            calls += 1
        best = min(best, ((cpu() - begin) / calls, (time.monotonic() - clock) / calls))
    return best


def scatter(start, n):
    """Returns n states around a start."""
    return start * (1 + 1e-3 * numpy.random.default_rng(0).standard_normal((n, len(start))))


class Pendula:
    """n double pendula by an array library: the equations of configs/analytic_double_pendulum.yaml,
    with all copies in one array."""

    M, C, L0 = (1.0, 2.0), (0.027, 0.192), (2.0, 1.0)
    B, HEAT, TR, K = 0.0869, 5.08, 300.0, 0.5

    def __init__(self, library, state):
        self.xp, self.z = library, library.asarray(state.T.copy())

    def rates(self, z):
        rate, force, velocity, temperature = self.xp.zeros_like(z), [], [], []
        for i in range(2):
            q, p, s = z[5 * i:5 * i + 2], z[5 * i + 2:5 * i + 4], z[5 * i + 4]
            square = q[0] * q[0] + q[1] * q[1]
            stretch = 0.5 * self.xp.log(square / self.L0[i]**2)
            temperature.append(self.TR * self.xp.exp((s - self.B * stretch) / self.HEAT))
            force.append(q * ((self.C[i] * stretch + self.B * self.TR - self.B * temperature[i]) / square))
            velocity.append(p / self.M[i])
            rate[5 * i:5 * i + 2], rate[5 * i + 2:5 * i + 4] = velocity[i], -force[i]
        heat = self.K * (temperature[1] - temperature[0])
        rate[2:4] += force[1]
        rate[5:7] -= velocity[0]
        rate[4], rate[9] = heat / temperature[0], -heat / temperature[1]
        return rate

    def step(self, substeps=16, dt=0.3):
        h, z = dt / substeps, self.z
        for _ in range(substeps):
            a = self.rates(z)
            b = self.rates(z + 0.5 * h * a)
            c = self.rates(z + 0.5 * h * b)
            d = self.rates(z + h * c)
            z = z + h / 6 * (a + 2 * b + 2 * c + d)
        self.z = z


def report(what, n, threads, seconds):
    print(f"{what:44s} {n:7d} {threads:8d} {1e6 * seconds[0] / n:12.3f} {1e6 * seconds[1] / n:12.3f}", flush=True)


def libraries():
    yield "numpy " + numpy.__version__, numpy
    try:
        import torch  # pylint: disable=import-outside-toplevel
    except ImportError:
        return
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    yield "torch " + torch.__version__, torch


def check():
    """The equations of Pendula are those of the scene."""
    scene = portmet.Scene("configs/analytic_double_pendulum.yaml")
    states = scatter(scene.state, 3)
    copies, others = portmet.Fleet(scene, 3, threads=1), Pendula(numpy, states)
    copies.state[:] = states
    copies.step(5)
    for _ in range(5):
        others.step()
    numpy.testing.assert_allclose(others.z.T, copies.state, rtol=1e-9, atol=1e-12)


def main():
    check()
    print(f"{'':44s} {'copies':>7s} {'threads':>8s} {'CPU, us':>12s} {'clock, us':>12s}   a step of a copy")
    for name in SCENES[:2] if QUICK else SCENES:
        for compiled in False, True:
            scene = portmet.Scene(f"configs/{name}.yaml", compiled=compiled)
            start, what = scene.state.copy(), name + (", compiled" if compiled else "")
            scene.inputs[:] = 0.1  # beyond the end of a reference as well
            report(what + ", alone", 1, 1, measure(lambda: scene.restart(start).step(10)) / numpy.array(10.0))
            for n in COUNTS:
                for threads in (1, 2) if n > 64 else (1,):
                    copies = portmet.Fleet(scene, n, threads)
                    copies.inputs[:] = 0.1
                    states, steps = scatter(start, n), max(1, min(10, 20000 // n))

                    def step():
                        copies.state[:] = states
                        copies.step(steps)
                        assert not copies.ended.any(), copies.failure
                    report(what, n, threads, measure(step, 3 if n < 10000 else 1) / numpy.array(float(steps)))
    for name, library in libraries():
        for n in COUNTS:
            pendula = Pendula(library, scatter(portmet.Scene("configs/analytic_double_pendulum.yaml").state, n))
            report("analytic_double_pendulum, " + name, n, 1, measure(pendula.step, 3 if n < 10000 else 1))


main()
