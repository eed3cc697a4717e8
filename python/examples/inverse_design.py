"""Inverse design: rest lengths such that a net hangs in a wanted shape.

The cost is half the sum of squares of the distances to the wanted places. Its derivative by all rest lengths takes one linear solve at the
equilibrium, whatever their number, and goes to a quasi-Newton method of scipy.
"""

import numpy as np
import sprung
from scipy.optimize import minimize

SIZE = 6
number = np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
y, x = np.mgrid[-1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j]
edge = (abs(x) == 1) | (abs(y) == 1)
start = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
pairs = np.concatenate([
    np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
    np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
])  # fmt: skip
is_moving = ~(edge.ravel()[pairs].all(axis=1))
net = sprung.System(
    start, pairs[is_moving], masses=0.2, stiffness=80.0, rest_lengths=0.38, gravity=[0, 0, -9.81],
    constraints=[sprung.Constraint(number[edge])], name="net",
)  # fmt: skip

# The inner nodes are wanted on a dish that is deeper on one side.
wanted = start.copy()
wanted[:, 2] = (-0.35 * (1 - x**2) * (1 - y**2) * (1 + 0.3 * x)).ravel()
known = {"state": net.initial_state()}


def cost(rest_lengths):
    """The cost and its derivative."""
    found = sprung.equilibrium(net.with_springs(rest_lengths=rest_lengths), known["state"])
    assert found.status == "stable"
    known["state"] = found.state  # the next search begins here
    miss = found.positions - wanted
    return 0.5 * np.sum(miss**2), found.gradient(positions=miss).rest_lengths


before, slope = cost(net.rest_lengths)

# The derivative beside a central difference along a random direction.
direction = np.random.default_rng(0).normal(size=len(slope))
ends = [cost(net.rest_lengths + sign * 1e-5 * direction)[0] for sign in (1, -1)]
assert abs((ends[0] - ends[1]) / 2e-5 - slope @ direction) < 1e-6 * abs(slope @ direction)

done = minimize(cost, net.rest_lengths, jac=True, method="L-BFGS-B", bounds=[(0.1, 1.0)] * len(slope), options={"maxiter": 500})
after = done.fun
print(f"{len(slope)} rest lengths, {done.nfev} equilibria: cost {before:.3g} -> {after:.3g} m²")
miss = np.linalg.norm(known["state"].positions - wanted, axis=1).max()
print(f"largest distance to the wanted shape: {1e3 * miss:.2f} mm; rest lengths from {done.x.min():.3f} to {done.x.max():.3f} m")
assert after < 1e-3 * before
