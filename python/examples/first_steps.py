"""First steps: a hanging net from arrays, its motion, and how wrong that is.

    python examples/first_steps.py        # writes net.html, a page that plays the motion
"""

import numpy as np
import sprung

# A square net of 12 × 12 particles in the plane z = 0, joined to their neighbours along both axes.
side = 12
x, y = np.meshgrid(np.linspace(0.0, 1.0, side), np.linspace(0.0, 1.0, side), indexing="ij")
positions = np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1)
number = np.arange(side * side).reshape(side, side)
along = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
across = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)

net = sprung.System(
    positions,
    np.concatenate([along, across]),
    masses=0.2 / side**2,
    stiffness=20.0,
    damping=0.002,
    gravity=[0.0, 0.0, -9.81],
    constraints=[sprung.Constraint(number[:, -1])],  # held along one edge
    name="net",
)
print(net)

# Without a time step the run chooses its steps, and says about how wrong it is.
stepper = sprung.Stepper(net, method="bdf2")
result = stepper.run(1.0)
print(result)
print(f"the lowest particle is at z = {result.state.positions[:, 2].min():.3f} m after {result.steps} steps")

# Energies are arrays, too: what gravity gave is in motion, in springs, or dissipated.
energies = result.energies
print(f"{energies['dissipated'][-1]:.4f} J dissipated, {energies['imbalance'][-1]:+.1e} J unexplained")

result.to_html("net.html")
