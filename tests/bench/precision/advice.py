"""advice.py PORTMETD SCENE...: does the advice of `portmetd bench` hold? Each scene is written with the advice. Its error is
measured again from other starts over as many steps, and its CPU time beside the scene's, in runs that take turns. Prints the
error that was promised and the one found, and how many times faster than the scene the advice was and is. Fails if an error
is more than twice what was promised, or a ratio of times is off by more than 20 %."""
import json
import os
import statistics
import subprocess
import sys
import time

import portmet

KEYS = "integrator", "substeps", "tolerance"
portmetd, *scenes = sys.argv[1:]
missed = 0


def bench(*words):
    return json.loads(subprocess.run([portmetd, "bench", *words, "--json"], stdout=subprocess.PIPE, check=True).stdout)


def cost(scene):
    scene.restart()
    scene.step()
    begin = time.process_time()
    scene.step(min(40, scene.planned - 1))
    return time.process_time() - begin


def times_faster(scene, written):
    own, advised = portmet.Scene(scene), portmet.Scene(written)
    return statistics.median(cost(own) / cost(advised) for _ in range(101))


def find(settings, setting):
    return next(s for s in settings if all(s[key] == setting[key] for key in KEYS))


for scene in scenes:
    written = os.path.splitext(scene)[0] + ".advised.yaml"  # beside the scene, whose paths count from there
    try:
        first = bench(scene, "--write", written)
        other = bench(written, "--seed", "77", "--steps", str(first["steps"]))
        advice = first["advice"]
        now = find(other["settings"], advice)
        faster = times_faster(scene, written)
        off = now["error"] / advice["error"], faster / advice["times_faster"]
        good = off[0] <= 2 and 0.8 <= off[1] <= 1.2
        missed += not good
        print(f"{scene}, {first['steps']} steps: {advice['integrator']} {advice['substeps']} {advice['tolerance']:g}: promised "
              f"{100 * advice['error']:.2g} %, {advice['times_faster']:.3g} times faster; found "
              f"{100 * now['error']:.2g} %, {faster:.3g}{'' if good else ', MISSED'}", flush=True)
    finally:
        if os.path.exists(written):
            os.remove(written)
sys.exit(missed > 0)
