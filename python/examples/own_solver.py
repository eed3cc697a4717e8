"""Backward Euler with a solver of one's own on A, beside the library's stepper.

The matrix of a step is A = M/dt² − G/dt − K, its right-hand side b, and A δx = b moves the free coordinates. Here scipy solves it, by
conjugate gradients preconditioned with the diagonal; any other solver could.
"""

import sprung
from scipy.sparse import diags_array
from scipy.sparse.linalg import cg

dt, steps = 0.01, 20
system = sprung.System.ready("cloth", 12)
state = system.initial_state()

for _ in range(steps):
    matrices = system.matrices(state, dt, stiffness="tension")  # positive definite whatever the springs
    moved, failed = cg(matrices.A, matrices.b, rtol=1e-12, M=diags_array(1.0 / matrices.A.diagonal()))
    assert failed == 0
    change = system.scatter(moved)
    state.velocities = change / dt  # what is held has no velocity here
    state.positions = state.positions + change
    state.time += dt

stepper = sprung.Stepper(system, method="linear-backward-euler", stiffness="tension", tolerance=1e-12)
for _ in range(steps):
    stepper.step(dt)
difference = abs(stepper.state.positions - state.positions).max()
print(f"after {steps} steps both cloths are at t = {state.time:.2f} s, at most {difference:.1e} m apart")
assert difference < 1e-8
