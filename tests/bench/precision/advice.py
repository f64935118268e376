"""advice.py PORTMETD SCENE...: does the advice of `portmetd bench` hold? Each scene is written with the advice. Its error is
measured again from other starts over as many steps, and so is its CPU time beside the scene's, in runs that take turns from
random starts within the training range: a tolerance costs more from some starts than from others. Prints the error that was
promised and the one found, how many times faster than the scene the advice was and is, and how many from the scene's start.
Fails if an error is more than twice what was promised, or a ratio of times is off by more than 20 %."""
import json
import os
import re
import statistics
import subprocess
import sys
import time

import numpy

import portmet

KEYS = "integrator", "substeps", "tolerance"
portmetd, *scenes = sys.argv[1:]
missed = 0


def bench(*words):
    return json.loads(subprocess.run([portmetd, "bench", *words, "--json"], stdout=subprocess.PIPE, check=True).stdout)


def starts(path, scene, count):
    """The scene's own start, then random ones: each group with a value, or a length, within its training range."""
    said = subprocess.run([portmetd, "check", path], stdout=subprocess.PIPE, text=True, check=True).stdout
    files = dict(re.findall(r"^subsystem (\S+) (?:.+\n)+?  weights +(.*?): ", said, re.M))
    rng = numpy.random.default_rng(1)
    for i in range(count):
        pieces = []
        for name in scene:
            if i == 0 or name not in files:
                pieces.append(scene[name].state)
                continue
            weights = portmet.Weights(files[name])
            for group, low, high in zip(weights.layout, *(weights.parameters[f"training_range.{end}"].ravel() for end in ("low", "high"))):
                way = rng.normal(size=group.size) if group.size > 1 else numpy.ones(1)
                pieces.append(way / numpy.linalg.norm(way) * rng.uniform(low, high))
        yield numpy.concatenate(pieces)


def cost(scene, state, steps):
    scene.restart(state)
    scene.step()
    begin = time.process_time()
    scene.step(steps - 1)
    return time.process_time() - begin


def times_faster(path, written, steps):
    """How many times faster the scene `written` is: median over random starts, and from the scene's own start."""
    own, advised = portmet.Scene(path), portmet.Scene(written)
    found = []
    for state in list(starts(path, own, 61)):
        try:
            found.append(statistics.median(cost(own, state, steps) / cost(advised, state, steps) for _ in range(5)))
        except portmet.Error:  # it breaks from there
            found.append(numpy.nan)
    return numpy.nanmedian(found), found[0]


def find(settings, setting):
    return next(s for s in settings if all(s[key] == setting[key] for key in KEYS))


for scene in scenes:
    written = os.path.splitext(scene)[0] + ".advised.yaml"  # beside the scene, whose paths count from there
    try:
        first = bench(scene, "--write", written)
        other = bench(written, "--seed", "77", "--steps", str(first["steps"]))
        advice = first["advice"]
        now = find(other["settings"], advice)
        faster, here = times_faster(scene, written, first["steps"])
        off = now["error"] / advice["error"], faster / advice["times_faster"]
        good = off[0] <= 2 and 0.8 <= off[1] <= 1.2
        missed += not good
        print(f"{scene}, {first['steps']} steps: {advice['integrator']} {advice['substeps']} {advice['tolerance']:g}: promised "
              f"{100 * advice['error']:.2g} %, {advice['times_faster']:.3g} times faster; found "
              f"{100 * now['error']:.2g} %, {faster:.3g} ({here:.3g} from its start){'' if good else ', MISSED'}", flush=True)
    finally:
        if os.path.exists(written):
            os.remove(written)
sys.exit(missed > 0)
