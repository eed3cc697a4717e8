"""A motion as a function of torch: a network of neurons learns the field of stiffnesses of a net from its motion.

The forward pass is a differentiable run, the backward pass one gradient of it, for all stiffnesses and starting velocities at once. Everything
is in double precision.
"""

import numpy as np
import sprung
import torch

torch.manual_seed(0)
SIZE, DT, STEPS = 6, 0.02, range(4, 25, 4)
rng = np.random.default_rng(0)
y, x = np.mgrid[0 : 1 : SIZE * 1j, 0 : 1 : SIZE * 1j]
start = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
number = np.arange(x.size).reshape(SIZE, SIZE)
pairs = np.concatenate([
    np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
    np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
])  # fmt: skip
net = sprung.System(
    start, pairs, masses=0.05, stiffness=3.0, rest_lengths=0.19, damping=0.01, velocities=rng.normal(0, 0.3, start.shape),
    gravity=[0, 0, -9.81], constraints=[sprung.Constraint(number[[0, 0, -1, -1], [0, -1, 0, -1]])],
)  # fmt: skip


class Motion(torch.autograd.Function):
    """Positions of all particles after some steps, by the stiffnesses and the velocities at the start."""

    @staticmethod
    def forward(ctx, stiffness, velocities):
        system = net.with_springs(stiffness=stiffness.detach().numpy())
        state = sprung.State(start, velocities.detach().numpy())
        ctx.run = sprung.Stepper(system, state, method="implicit-midpoint").run(DT * STEPS[-1], dt=DT, differentiable=True)
        return torch.from_numpy(ctx.run.positions[STEPS])

    @staticmethod
    def backward(ctx, cotangents):
        records = [(step, cotangent, None) for step, cotangent in zip(STEPS, cotangents.numpy())]
        gradient = ctx.run.gradient(records=records, check=False)
        return torch.from_numpy(gradient.stiffness), torch.from_numpy(gradient.velocities)


velocities = torch.from_numpy(net.initial_state().velocities)
given = (torch.from_numpy(net.stiffness).requires_grad_(), velocities.clone().requires_grad_())
assert torch.autograd.gradcheck(Motion.apply, given, fast_mode=True)

# The measured motion is that of a net which is stiffer on one side.
middles = torch.from_numpy(start[pairs].mean(axis=1)[:, :2])
truth = 2.0 + 4.0 * middles[:, 0] * (1.0 - middles[:, 1])
with torch.no_grad():
    measured = Motion.apply(truth, velocities)

field = torch.nn.Sequential(torch.nn.Linear(2, 16), torch.nn.Tanh(), torch.nn.Linear(16, 1), torch.nn.Softplus()).double()
descent = torch.optim.Adam(field.parameters(), lr=0.03)
costs = []
for _ in range(150):
    descent.zero_grad()
    stiffness = 4.0 * field(middles)[:, 0]
    cost = ((Motion.apply(stiffness, velocities) - measured) ** 2).sum()
    cost.backward()
    descent.step()
    costs.append(cost.item())
error = (stiffness.detach() / truth - 1.0).abs().max().item()
print(f"{len(pairs)} springs: cost {costs[0]:.3g} -> {costs[-1]:.3g} m², stiffnesses to {100 * error:.1f} %")
assert costs[-1] < 0.01 * costs[0] and error < 0.1
