"""Prints how many subsystem-steps per second of CPU time Scene.step makes. Run it with
PYTHONPATH=build/daemon/python; the figures are in daemon/LIBRARY.md."""
import time

import portmet


def ring(count):
    """Returns the text of a ring of trivial subsystems with one exchange per step."""
    links = "".join(f"  n{i}: {{model: part, initial: {{x: 1.0}}, state: {{x: {{unit: m, size: 1}}}}}}\n"
                    for i in range(count))
    ports = "".join(f"  p{i}: {{law: bracket, between: [n{i}, n{(i + 1) % count}], model: joint, "
                    f"expose: {{n{i}: x, n{(i + 1) % count}: x}}}}\n" for i in range(count))
    return ("scene: ring\ntime: {dt: 0.001, steps: 1, integrator: euler}\n"
            "models:\n  part: {energy: '|x|^2/2'}\n"
            "  joint: {law: bracket, reversible: {given: [[a.x, b.x, 1.0]]}}\n"
            f"subsystems:\n{links}ports:\n{ports}")


def measure(name, scene, steps):
    scene.step(steps // 10)
    rates = []
    for _ in range(3):
        begin = time.process_time()
        scene.step(steps)
        rates.append(steps * len(scene.subsystems) / (time.process_time() - begin))
    print(f"{name}: {sorted(rates)[1]:.3g} subsystem-steps per second of CPU time (median of 3)")


measure("ring of 16", portmet.Scene(text=ring(16)), 50000)
measure("chain_10", portmet.Scene("configs/chain_10.yaml"), 2000)
