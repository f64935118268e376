"""Measures copies of scenes (portmet.Fleet), interpreted and compiled, on one and two threads, their
gradients, and a Scene alone, beside numpy, scipy, and PyTorch where it is installed, eager and traced, on
the equations of analytic_double_pendulum. Run it in the repository's root with PYTHONPATH=build/daemon/python; with
BENCH_QUICK in the environment it takes seconds. CPU time is that of all threads of the process."""
import os
import resource
import time

import numpy
import scipy
import scipy.integrate

import portmet

QUICK = "BENCH_QUICK" in os.environ
COUNTS = (1, 100) if QUICK else (1, 10, 100, 1000, 10000, 100000)
SECONDS = 0.02 if QUICK else 0.5  # of CPU time of a measurement
SCENES = "double_pendulum", "analytic_double_pendulum", "gas_containers", "driven_lower", "chain_10", "beam"


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
        self.right_hand_side = self.rates

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
        h, z, rates = dt / substeps, self.z, self.right_hand_side
        for _ in range(substeps):
            a = rates(z)
            b = rates(z + 0.5 * h * a)
            c = rates(z + 0.5 * h * b)
            d = rates(z + h * c)
            z = z + h / 6 * (a + 2 * b + 2 * c + d)
        self.z = z


def report(what, n, threads, seconds):
    print(f"{what:44s} {n:7d} {threads:8d} {1e6 * seconds[0] / n:12.3f} {1e6 * seconds[1] / n:12.3f}", flush=True)


def measure_libraries():
    start = portmet.Scene("configs/analytic_double_pendulum.yaml").state
    what, rounds = "analytic_double_pendulum, ", lambda n: 3 if n < 10000 else 1
    for n in COUNTS:
        report(what + "numpy " + numpy.__version__, n, 1, measure(Pendula(numpy, scatter(start, n)).step, rounds(n)))
    alone = Pendula(numpy, start[None])
    report(what + "scipy " + scipy.__version__ + ", RK45, 1e-6", 1, 1, measure(lambda: scipy.integrate.solve_ivp(
        lambda t, z: alone.rates(z[:, None])[:, 0], (0, 0.3), start, rtol=1e-6, atol=1e-9)))
    try:
        import torch  # pylint: disable=import-outside-toplevel
    except ImportError:
        print("PyTorch is not installed (python3-torch)")
        return
    torch.set_default_dtype(torch.float64)
    for threads in 1, 2:
        torch.set_num_threads(threads)
        for traced in False, True:
            for n in COUNTS if threads == 1 else [n for n in COUNTS if n > 64]:
                pendula = Pendula(torch, scatter(start, n))
                if traced:
                    pendula.right_hand_side = torch.jit.trace(pendula.rates, pendula.z)
                with torch.no_grad():
                    report(what + "torch " + torch.__version__ + (", traced" if traced else ""), n, threads,
                           measure(pendula.step, rounds(n)))


def measure_gradients():
    """What the gradient of a rollout by its start costs, in rollouts."""
    for name in SCENES:
        for compiled in False, True:
            scene = portmet.Scene(f"configs/{name}.yaml", compiled=compiled)
            steps = 2 if QUICK else 200
            for n in 1, 1000:
                copies = portmet.Fleet(scene, n, 1)
                copies.inputs[:] = 0.1
                seed, rounds = numpy.ones_like(copies.state), 1 if n > 1 else 3
                rollout = measure(lambda: copies.rollout(steps=steps), rounds)[0]
                gradient = measure(lambda: copies.vjp(seed, steps=steps), rounds)[0]
                print(f"{name + (', compiled' if compiled else ''):44s} {n:7d}  gradient over {steps} steps: "
                      f"{gradient / rollout:.2f} rollouts, {1e6 * gradient / n / steps:.3f} us a step", flush=True)


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
    measure_libraries()
    measure_gradients()


main()
