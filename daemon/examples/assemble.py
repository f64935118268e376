# SPDX-License-Identifier: MIT
"""Learns two masses on springs from data that it makes itself, and assembles six of them, in two seconds of CPU time.

    PYTHONPATH=build/daemon/python python3 daemon/examples/assemble.py [PICTURE.png]     in the root of the repository
"""
import os
import subprocess
import sys

try:
    import numpy as np
    import portmet
except ImportError as error:
    sys.exit(f"{sys.executable}: {error}; on Debian use /usr/bin/python3, with python3-numpy and python3-h5py")


picture = os.path.abspath(sys.argv[1]) if __name__ == "__main__" and sys.argv[1:] else None
os.chdir(os.environ.get("PORTMET_EXAMPLE", "build"))


def scene(name, masses):   # masses in a row, each on a spring from the one before; q is the spring's length
    text = (f"scene: {name}\ntime: {{dt: 0.1, steps: 200, integrator: rk4, substeps: 4}}\n"
            "models:\n  true: {energy: '|p|^2/2 + |q|^2/2 + |q|^2*|q|^2/8', reversible: {given: [[q, p, 1.0]]}}\n"
            "  joint: {law: bracket, reversible: {given: [[a.p, b.q, 1.0]]}}\nsubsystems:\n")
    for i, mass in enumerate(masses):
        text += (f"  m{i}: {{{mass}, initial: {{q: 0.0, p: 0.0}}, state: "
                 f"{{q: {{unit: m, columns: [q{i}]}}, p: {{unit: kg m/s, columns: [p{i}]}}}}}}\n")
    text += "ports:\n" + "".join(f"  j{i}: {{law: bracket, between: [m{i}, m{i + 1}], model: joint, "
                                 f"expose: {{m{i}: p, m{i + 1}: q}}}}\n" for i in range(len(masses) - 1))
    with open(name + ".yaml", "w") as file:
        file.write(text)
    return name + ".yaml"


def follow(scene, start, steps):   # the states of a run: [time][variable]
    scene.restart(start)
    return np.array([start] + [scene.step().state.copy() for _ in range(steps)])


pair = portmet.Scene(scene("true_pair", ["model: true"] * 2))
runs = [follow(pair, start, 40) for start in np.random.default_rng(1).uniform(-1, 1, (10, 4))]
portmet.Dataset(z=runs, dt=0.1, columns=["q0", "p0", "q1", "p1"]).save("pair.h5")
learned = scene("pair", [f"weights: learned/m{i}.h5" for i in (0, 1)])
fit = portmet.fit(learned, "learned", data="pair.h5")
print(fit.report)

chain = portmet.Scene(scene("chain", [f"weights: learned/m{min(i, 1)}.h5" for i in range(6)]))
start = np.random.default_rng(2).uniform(-1, 1, 12)
true = follow(portmet.Scene(scene("true_chain", ["model: true"] * 6)), start, 200)
error = np.linalg.norm(follow(chain, start, 200) - true) / np.linalg.norm(true)
print(f"six masses that were never seen together: {100 * error:.2g} %", chain.ledger, sep="\n")
if picture:   # with gnuplot
    np.savetxt("six.txt", np.column_stack([true[:, 10], follow(chain, start, 200)[:, 10]]))
    subprocess.run(["gnuplot", "-e", f"set term pngcairo; set out '{picture}'; set xlabel 'time, s'; set ylabel 'q of the last, m'; "
                    "plot 'six.txt' using ($0/10):1 w l lw 4 lc 'gray' title 'true', '' using ($0/10):2 w l title 'assembled'"],
                   check=True)
