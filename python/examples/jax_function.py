"""A motion as a function of JAX, with `jax.custom_vjp`: a throw that brings a ring of springs to a target.

The function can be compiled, differentiated backwards, and mapped. Its forward pass is a run and its backward pass one gradient. What JAX keeps
between the two are arrays, so the backward pass computes the run again.
"""

import jax
import jax.numpy as jnp
import numpy as np
import sprung
from jax.test_util import check_grads
from scipy.optimize import minimize

jax.config.update("jax_enable_x64", True)

COUNT, DT, DURATION = 12, 0.01, 0.6
angle = 2 * np.pi * np.arange(COUNT) / COUNT
start = np.column_stack([np.cos(angle), np.sin(angle)])
pairs = [(k, (k + step) % COUNT) for step in (1, 2) for k in range(COUNT)]
ring = sprung.System(start, pairs, masses=0.1, stiffness=30.0, damping=0.05, gravity=[0, -9.81])


def run(stiffness, velocities):
    system = ring.with_springs(stiffness=np.asarray(stiffness))
    state = sprung.State(start, np.asarray(velocities))
    return sprung.Stepper(system, state, method="implicit-midpoint").run(DURATION, dt=DT, differentiable=True)


def gradient(stiffness, velocities, cotangent):
    found = run(stiffness, velocities).gradient(positions=np.asarray(cotangent), check=False)
    return found.stiffness, found.velocities


@jax.custom_vjp
def motion(stiffness, velocities):
    """The last positions, by the stiffnesses and the velocities at the start."""
    shape = jax.ShapeDtypeStruct(start.shape, jnp.float64)
    return jax.pure_callback(lambda *given: run(*given).state.positions, shape, stiffness, velocities, vmap_method="sequential")


def forward(stiffness, velocities):
    return motion(stiffness, velocities), (stiffness, velocities)


def backward(given, cotangent):
    shapes = tuple(jax.ShapeDtypeStruct(each.shape, jnp.float64) for each in given)
    return jax.pure_callback(gradient, shapes, *given, cotangent, vmap_method="sequential")


motion.defvjp(forward, backward)
check_grads(motion, (ring.stiffness, np.random.default_rng(0).normal(size=start.shape)), order=1, modes=["rev"])

# The ring is to arrive around the target, turned by a quarter and as round as it began.
target = np.array([4.0, 1.0])
wanted = target + np.column_stack([-start[:, 1], start[:, 0]])


@jax.jit
@jax.value_and_grad
def cost(unknowns):
    stiffness, spin, throw = jnp.exp(unknowns[0]), unknowns[1], unknowns[2:]
    turning = spin * jnp.column_stack([-start[:, 1], start[:, 0]])
    end = motion(jnp.full(len(pairs), stiffness), throw + turning)
    return 0.5 * ((end - wanted) ** 2).sum()


first = np.array([np.log(30.0), 0.0, 0.0, 0.0])
before = cost(first)[0]
found = minimize(lambda unknowns: tuple(map(np.asarray, cost(unknowns))), first, jac=True, method="BFGS", options={"gtol": 1e-6})
stiffness, (spin, *throw) = np.exp(found.x[0]), found.x[1:]
print(f"{found.nfev} runs: cost {before:.3g} -> {found.fun:.3g} m², stiffness {stiffness:.3g} N, throw {np.round(throw, 3)} m/s, spin {spin:.3f}/s")
# The centre flies like a point.
np.testing.assert_allclose(throw, target / DURATION + [0, 9.81 / 2 * DURATION], rtol=1e-6)
assert found.fun < 0.01 * before
