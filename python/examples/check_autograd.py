"""Checking the Jacobian of a force written with autograd: a right one, and one with a mistake that is easily made.

The force is a chain of springs with a repulsion from the ground; its Jacobian comes from autograd, or from hand with the transverse term
of the springs forgotten.
"""

import autograd
import autograd.numpy as anp
import numpy as np
import sprung

particles, k, l0 = 12, 50.0, 0.1
rng = np.random.default_rng(0)
x = np.cumsum(rng.uniform(0.05, 0.15, size=(particles, 3)), axis=0)


def energy(x):
    d = x[1:] - x[:-1]
    length = anp.sqrt(anp.sum(d**2, axis=1))
    return anp.sum(0.5 * k / l0 * (length - l0) ** 2) + anp.sum(1e-3 / x[:, 1])


force = lambda x: -autograd.grad(energy)(x)
jacobian = lambda x: autograd.jacobian(force)(x).reshape(x.size, x.size)

check = sprung.check_jacobian(force, jacobian, x, name="by autograd")
print("by autograd:", check)
assert check

matrix = jacobian(x)
for first in range(particles - 1):
    d = x[first + 1] - x[first]
    length = np.linalg.norm(d)
    n = d / length
    transverse = k / l0 * (1 - l0 / length) * (np.eye(3) - np.outer(n, n))
    rows = slice(3 * first, 3 * first + 6)
    matrix[rows, rows] += np.kron([[1, -1], [-1, 1]], transverse)
check = sprung.check_jacobian(force, matrix, x, name="without transverse terms")
print("without transverse terms:", check)
assert not check
