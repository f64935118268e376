# SPDX-License-Identifier: MIT
"""A scene as a layer of PyTorch (python3-torch): finds the start that ends where another one ends."""
import numpy
import torch

import portmet


class Rollout(torch.autograd.Function):
    """The states [1, n, variables] after some steps from `start` [n, variables]."""

    @staticmethod
    def forward(context, start, copies, steps):
        context.save_for_backward(start)
        context.copies, context.steps = copies, steps
        return torch.from_numpy(copies.rollout(steps=steps, start=start.detach().numpy()))

    @staticmethod
    def backward(context, seed):
        start, = context.saved_tensors
        by_start = context.copies.vjp(seed.numpy(), steps=context.steps, start=start.numpy())[0]
        return torch.from_numpy(by_start), None, None


scene = portmet.Scene("configs/double_pendulum.yaml")
copies = portmet.Fleet(scene, 4)
sought = scene.state * (1 + 0.01 * numpy.random.default_rng(0).standard_normal((4, len(scene.variables))))
target = torch.from_numpy(copies.rollout(steps=5, start=sought))
start = torch.tensor(numpy.tile(scene.state, (4, 1)), requires_grad=True)
optimizer = torch.optim.LBFGS([start], max_iter=200, tolerance_grad=1e-12, tolerance_change=1e-14,
                              line_search_fn="strong_wolfe")


def loss():
    optimizer.zero_grad()
    value = ((Rollout.apply(start, copies, 5) - target)**2).sum()
    value.backward()
    return value


print(f"loss {loss().item():.3g}, then {optimizer.step(loss) and loss().item():.3g}")
print(f"largest error of a start: {numpy.abs(start.detach().numpy() - sought).max():.2g}")
