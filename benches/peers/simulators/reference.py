"""The true motion, by forces and an integrator that share nothing with any of those measured: numpy's and scipy's."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csr_array


def accelerations(scene):
    """Of the free particles, given positions and velocities of all."""
    springs = np.arange(len(scene.pairs))
    rows, ends = np.concatenate([springs, springs]), scene.pairs.T.ravel()
    signs = np.concatenate([np.ones(len(springs)), -np.ones(len(springs))])
    difference = csr_array((signs, (rows, ends)), shape=(len(springs), len(scene.masses)))
    free = ~scene.held
    gather = csr_array(-(difference.T.tocsr()[free]))
    inverse_masses = 1 / scene.masses[free, None]

    def of(x, v):
        d, rate = difference @ x, difference @ v
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        force = scene.stiffness * (length / scene.rest_lengths - 1) + scene.damping * np.einsum("ij,ij->i", d, rate) / length
        return gather @ (d * (force / length)[:, None]) * inverse_masses + scene.gravity

    return of


def solve(scene, rtol):
    """Positions at the end by DOP853 with this relative tolerance, of lengths by the scene's extent and its fastest motion."""
    free = ~scene.held
    acceleration = accelerations(scene)
    x, v = scene.positions.copy(), scene.velocities.copy()
    n = 3 * free.sum()

    def rates(_, y):
        x[free], v[free] = y[:n].reshape(-1, 3), y[n:].reshape(-1, 3)
        return np.concatenate([y[n:], acceleration(x, v).ravel()])

    extent = np.ptp(scene.positions, axis=0).max()
    speed = max(np.linalg.norm(scene.gravity) * scene.duration, np.abs(v).max())
    scales = np.concatenate([np.full(n, extent), np.full(n, speed)])
    start = np.concatenate([x[free].ravel(), v[free].ravel()])
    # Only the end is kept: states of all steps of a large scene would fill the memory.
    end = solve_ivp(rates, (0.0, scene.duration), start, method="DOP853", rtol=rtol, atol=rtol * scales, t_eval=[scene.duration])
    if not end.success:
        raise RuntimeError(f"{scene.name}: {end.message}")
    positions = scene.positions.copy()
    positions[free] = end.y[:n, -1].reshape(-1, 3)
    return positions
