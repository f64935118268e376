# SPDX-License-Identifier: MIT
"""Moves the pivot of configs/live_double_pendulum.yaml so that the lower mass swings to a point and comes to rest
there. There is no gravity: springs pull. Every half second a plan of the pivot's velocity over the next ten is made
anew from the present state, in two ways, one after the other:

    gradient   L-BFGS with the gradient of a rollout, portmet.Fleet.vjp
    sampling   path integrals (MPPI): the mean of random plans, weighted by exp(-cost / temperature)

    python3 control.py           # the pendulum is stepped in this process
    python3 control.py --live    # `portmetd serve configs/live_double_pendulum.yaml` steps it
"""
import os
import sys

import numpy
import scipy.optimize

import portmet

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../configs/live_double_pendulum.yaml")
TARGET, FASTEST = numpy.array([2.0, -7.0]), 1.0  # m from where the pivot begins; m/s
HOLD, PIECES, SECONDS = 10, 20, 18.0  # steps for which a velocity holds, velocities of a plan, length of a run
EFFORT = 0.02                         # weight of velocity squared beside distance squared

model = portmet.Scene(SCENE, compiled=True)
PIECE = HOLD * model.dt
VELOCITY = model.input_columns("pivot.dE/dp")
UPPER, LOWER, P, P_UPPER = (slice(model.variables.index(f"{name}[0]"), model.variables.index(f"{name}[1]") + 1)
                            for name in ("upper.q", "lower.q", "lower.p", "upper.p"))


def inputs_of(plan):
    """Returns the inputs [pieces, n, inputs] of a plan [pieces, n, 2]."""
    inputs = numpy.full((*plan.shape[:2], len(model.input_names)), numpy.nan)  # NaN: as the scene says
    inputs[..., VELOCITY] = plan
    return inputs


def cost(plan, states, pivot):
    """Returns the cost [n] of a plan with its states [pieces, n, variables], and its derivatives by both."""
    late = numpy.linspace(0, 1, PIECES)[:, None, None]**2  # what happens late in a plan counts more
    off = pivot + PIECE * numpy.cumsum(plan, axis=0) + states[..., UPPER] + states[..., LOWER] - TARGET
    by_states = numpy.zeros_like(states)
    by_states[..., UPPER] = by_states[..., LOWER] = 2 * late * off
    by_states[..., P], by_states[..., P_UPPER] = 2 * late * states[..., P], 2 * late * states[..., P_UPPER]
    by_plan = 2 * EFFORT * plan + PIECE * numpy.cumsum((2 * late * off)[::-1], axis=0)[::-1]
    terms = late * (off**2 + states[..., P]**2 + states[..., P_UPPER]**2) + EFFORT * plan**2
    return terms.sum(axis=(0, 2)), by_plan, by_states


class Gradient:
    """Improves a plan by some iterations of L-BFGS."""

    ITERATIONS = 10  # of each plan after the first

    def __init__(self):
        self.copy = portmet.Fleet(model, 1)

    def improve(self, plan, state, pivot, iterations):
        def value_and_gradient(x):
            x = x.reshape(PIECES, 1, 2)
            inputs = inputs_of(x)
            value, by_plan, by_states = cost(x, self.copy.rollout(inputs, HOLD, state), pivot)
            by_inputs = self.copy.vjp(by_states, inputs, HOLD, state)[1]
            return value[0], (by_plan + by_inputs[..., VELOCITY]).ravel()
        return scipy.optimize.minimize(value_and_gradient, plan.ravel(), jac=True, method="L-BFGS-B",
                                       bounds=[(-FASTEST, FASTEST)] * plan.size,
                                       options={"maxiter": iterations}).x.reshape(plan.shape)


class Sampling:
    """Replaces a plan by the mean of random plans around it, where cheap ones count more."""

    ITERATIONS = 4

    def __init__(self, n=128):
        self.copies, self.random = portmet.Fleet(model, n), numpy.random.default_rng(0)

    def improve(self, plan, state, pivot, iterations):
        for spread in 0.3 * 0.9**numpy.arange(iterations):
            plans = plan[:, None] + spread * self.random.standard_normal((PIECES, self.copies.n, 2))
            plans[:, 0] = plan
            plans = numpy.clip(plans, -FASTEST, FASTEST)
            value = cost(plans, self.copies.rollout(inputs_of(plans), HOLD, state), pivot)[0]
            value = numpy.where(numpy.isnan(value), numpy.inf, value)  # a copy that failed
            weight = numpy.exp((value.min() - value) / (0.1 * (numpy.median(value) - value.min()) + 1e-12))
            plan = numpy.einsum("pni,n->pi", plans, weight) / weight.sum()
        return plan


def run(pendulum, move, planner):
    """Lets a planner move the pivot. Returns how far the lower mass is from the target then, m, and |p|, kg m/s."""
    plan, pivot = numpy.zeros((PIECES, 2)), numpy.zeros(2)
    for piece in range(round(SECONDS / PIECE)):
        plan = planner.improve(plan, pendulum.state, pivot, planner.ITERATIONS if piece else 40)
        move(plan[0])
        pendulum.step(HOLD)
        pivot = pivot + PIECE * plan[0]
        plan = numpy.vstack((plan[1:], numpy.zeros(2)))
        lower, p = pivot + pendulum.state[UPPER] + pendulum.state[LOWER], numpy.linalg.norm(pendulum.state[P])
        if piece % 6 == 5:
            print(f"{pendulum.time:5.1f} s: pivot {pivot.round(3)} m, lower mass {lower.round(3)} m, |p| {p:.3f} kg m/s")
    return numpy.linalg.norm(lower - TARGET), p


for planner in Gradient(), Sampling():
    print(type(planner).__name__)
    if "--live" in sys.argv[1:]:
        with portmet.Remote("live_double_pendulum") as pendulum:
            def move(velocity):
                pendulum.inputs[:] = velocity
            distance, p = run(pendulum, move, planner)
    else:
        pendulum = portmet.Scene(SCENE)

        def move(velocity):
            pendulum.inputs[VELOCITY] = velocity
        distance, p = run(pendulum, move, planner)
    print(f"{'reached' if distance < 0.25 and p < 0.25 else 'missed'} the target: {distance:.3f} m, {p:.3f} kg m/s")
