"""Eigenmodes by scipy: K φ = −ω² M φ, for a taut string, beside the closed form.

The string of n particles of mass m at distances h under the tension T has the frequencies ω_j = 2 √(T/(m h)) sin(j π/(2 (n + 1))) across
its axis.
"""

import numpy as np
import sprung
from scipy.sparse.linalg import eigsh

n, h, mass, tension = 60, 0.1, 0.02, 5.0
positions = np.column_stack([h * np.arange(n + 2), np.zeros(n + 2)])
pairs = np.column_stack([np.arange(n + 1), np.arange(1, n + 2)])
stiffness = 40.0
string = sprung.System(
    positions,
    pairs,
    masses=mass,
    stiffness=stiffness,
    rest_lengths=h / (1.0 + tension / stiffness),  # so that k (l/l0 − 1) is the tension
    constraints=[sprung.Constraint(np.arange(n + 2), axes="x"), sprung.Constraint([0, n + 1])],  # no motion along the string
    name="taut string",
)
matrices = string.matrices(dt=0.01)

# The lowest modes are found fast around zero: −K is positive definite, and eigsh factors it.
squares, modes = eigsh(-matrices.K, k=5, M=matrices.M, sigma=0.0)
found = np.sqrt(squares)
expected = 2 * np.sqrt(tension / (mass * h)) * np.sin(np.arange(1, 6) * np.pi / (2 * (n + 1)))
for number, (ours, closed) in enumerate(zip(found, expected), 1):
    print(f"mode {number}: {ours:.6f} rad/s, closed form {closed:.6f} rad/s")
np.testing.assert_allclose(found, expected, rtol=1e-9)

# A mode as displacements of particles: the first one is a half wave.
shape = string.scatter(modes[:, 0])[:, 1]
print("the first mode has its largest displacement at particle", int(abs(shape).argmax()))
