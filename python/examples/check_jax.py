"""Checking a force and a Jacobian written with JAX, and against the library's own K.

Double precision has to be asked for: in single precision the check says so, by entries that are off by 1e-7 or more.
"""

import jax
import jax.numpy as jnp
import numpy as np
import sprung

jax.config.update("jax_enable_x64", True)

system = sprung.System.ready("network", 12)
state = system.initial_state()
pairs, stiffness, rest_lengths = system.pairs.astype(int), system.stiffness, system.rest_lengths
particles, axes = system.dofs.T


def energy(reduced):
    positions = jnp.asarray(state.positions).at[particles, axes].set(reduced)
    d = positions[pairs[:, 0]] - positions[pairs[:, 1]]
    length = jnp.sqrt((d**2).sum(axis=1))
    return (0.5 * stiffness * (length - rest_lengths) ** 2 / rest_lengths).sum()


force = jax.jit(lambda reduced: -jax.grad(energy)(reduced))
hessian = jax.jit(jax.jacfwd(force))
x = system.gather(state.positions)

check = sprung.check_jacobian(force, hessian, x, name="JAX", springs=(system, state))
print("JAX's derivative of JAX's force:", check)
assert check

check = sprung.check_jacobian(force, system.matrices(state, 0.01).K, x, name="K", springs=(system, state))
print("the library's K against JAX's force:", check)
assert check
np.testing.assert_allclose(system.gather(system.force(state, "elastic")), force(x), rtol=0, atol=1e-10)
