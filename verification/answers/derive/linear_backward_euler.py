"""One step of linearised (linearly implicit) backward Euler.

Backward Euler, x+ = x + dt v+, M (v+ - v)/dt = f_el(x+) + G v+ + g, with the force made linear about x and G taken at x:

    M (v+ - v)/dt = f_el(x) + K dx + G v+ + g,      dx = x+ - x = dt v+
    (M/dt^2 - G/dt - K) dx = M v/dt + g + f_el(x)   that is  A dx = b

Prescribed coordinates c have known dx_c, so their rows leave the system and b_f loses A_fc dx_c. Afterwards x += dx, v = dx/dt
for every coordinate, prescribed ones included.
"""

from mpmath import mp, mpf

from springs import System


def free_system(system, x, v, t, dt, option):
    """A and b over the free coordinates, and the prescribed dx_c (from where x is to where the motion has to be at t + dt)."""
    full = system.A(x, dt, option)
    mass, gravity, elastic = system.M(), system.gravity_forces(), system.elastic_forces(x)
    a = system.restrict(full)
    prescribed = [system.positions[p][c] + system.motions[p, c].offset(t + dt) - x[p][c] for p, c in system.held]
    b = mp.matrix(len(system.free), 1)
    for r, (p, c) in enumerate(system.free):
        i = system.index((p, c))
        b[r] = mass[i, i] * v[p][c] / dt + gravity[i] + elastic[i]
        b[r] -= mp.fsum(full[i, system.index(dof)] * d for dof, d in zip(system.held, prescribed))
    return a, b, prescribed


def step(system, x, v, t, dt, option):
    """The state after one step."""
    a, b, prescribed = free_system(system, x, v, t, dt, option)
    solution = mp.lu_solve(a, b) if system.free else []
    dx = [[mpf(0)] * system.dim for _ in range(system.count)]
    for (p, c), value in zip(system.free, solution):
        dx[p][c] = value
    for (p, c), value in zip(system.held, prescribed):
        dx[p][c] = value
    return ([[p + d for p, d in zip(row, dr)] for row, dr in zip(x, dx)], [[d / dt for d in dr] for dr in dx])


def run(scene, option, steps, dt=None):
    """States after 0, 1, ..., steps steps of a scene."""
    system = System(scene)
    dt = system.dt if dt is None else mpf(dt)
    x, v, t = system.positions, system.velocities, mpf(0)
    states = [(x, v)]
    for _ in range(steps):
        x, v = step(system, x, v, t, dt, option)
        t += dt
        states.append((x, v))
    return states
