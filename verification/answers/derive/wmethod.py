"""A W-method of second order whose two stages use the matrix of linearised backward Euler.

For y' = F(t, y) and any matrix J whatever, W = I - tau J, tau = gamma h, the two stages

    W k1 = F(t, y) + tau T
    W w  = F(t + h/2, y + (h/2) k1) - k1
    y+   = y + h (k1 + w)

are of second order: y + (h/2) k1 is the midpoint to O(h^2), whatever J and T, and w = F(midpoint) - k1 + tau J w with w = O(h), so
that k1 + w = F(midpoint) + O(h^2). T stands for dF/dt, exactly or not; it comes in with +tau in the first stage only, because the
added equation t' = 1 has k1 = 1 and w = 0. For the same reason the second stage is taken at t + h/2, where y + (h/2) k1 is. gamma =
1 - 1/sqrt 2.

For y = (x, v) over the free coordinates f, with prescribed ones c that follow x_c(t), v_c(t), a_c(t), J has the blocks 0, I, M^-1
K_o, M^-1 G of the free coordinates (K_o under the stiffness option) and T = (0, M^-1 (K_fc v_c + G_fc a_c)). Eliminating the
velocities, with A = M/tau^2 - G/tau - K_o:

    A d1 = M v/tau + f_el(x) + g + G_fc v_c + tau (K_fc v_c + G_fc a_c)       k1x = d1/tau,  k1v = (k1x - v)/tau
    p    = v + (h/2) k1v - k1x
    A d  = M p/tau + F(x + (h/2) k1x, v + (h/2) k1v, x_c, v_c at t + h/2) - M k1v - G p       wx = d/tau,  wv = (wx - p)/tau
    x += h (k1x + wx),   v += h (k1v + wv),   x_c, v_c from their motion at t + h

where F = f_el + f_d + g on the free coordinates; f_el(x) + g + G_fc v_c is F less the damping G v that A takes over. With K_fc the
option's own off-diagonal block and a_c = 0, the first stage is the step of linearised backward Euler of length tau, prescribed
displacement tau v_c included. Three kinds of T are stored: "option" (K_fc of the option), "exact" (K_fc in full), "none" (T = 0).
All are of second order.

The formulas in the eliminated form are held to the definition in y, solved as one dense system of both positions and velocities.
"""

from mpmath import mp, mpf

import answers
from springs import OPTIONS, System
from trajectories import Motion, moving_anchor, roller, tetrahedron

KINDS = ("option", "exact", "none")


def gamma():
    return 1 - 1 / mp.sqrt(2)


def prescribed(system, x, v, t):
    """x and v with prescribed coordinates where their motion has them at t."""
    x, v = [list(r) for r in x], [list(r) for r in v]
    for (p, a), motion in system.motions.items():
        x[p][a], v[p][a] = system.positions[p][a] + motion.offset(t), motion.rate(t)
    return x, v


def with_free(system, rows, values):
    rows = [list(r) for r in rows]
    for (p, a), value in zip(system.free, values):
        rows[p][a] = value
    return rows


def free_part(system, rows):
    return mp.matrix([rows[p][a] for p, a in system.free])


def forces(system, x, v):
    total = system.forces(x, v)
    return mp.matrix([total[system.index(dof)] for dof in system.free])


def coupling(system, x, v, option, kind):
    """M T = K_fc v_c; motions are at constant velocity here, so a_c = 0."""
    if kind == "none" or not system.held:
        return mp.zeros(len(system.free), 1)
    stiffness = system.restrict(system.K(x, "full" if kind == "exact" else option), columns=system.held)
    return stiffness * mp.matrix([v[p][a] for p, a in system.held])


def step(system, x, v, t, h, option, kind):
    """One step, in the eliminated form."""
    tau = gamma() * h
    mass, damping = system.restrict(system.M()), system.restrict(system.G(x))
    a = system.restrict(system.A(x, tau, option))
    xf, vf = free_part(system, x), free_part(system, v)
    d1 = mp.lu_solve(a, mass * vf / tau + forces(system, x, v) - damping * vf + tau * coupling(system, x, v, option, kind))
    k1x = d1 / tau
    k1v = (k1x - vf) / tau
    p = vf + h / 2 * k1v - k1x
    x_mid, v_mid = prescribed(system, with_free(system, x, xf + h / 2 * k1x), with_free(system, v, vf + h / 2 * k1v), t + h / 2)
    d = mp.lu_solve(a, mass * p / tau + forces(system, x_mid, v_mid) - mass * k1v - damping * p)
    wx = d / tau
    wv = (wx - p) / tau
    return prescribed(system, with_free(system, x, xf + h * (k1x + wx)), with_free(system, v, vf + h * (k1v + wv)), t + h)


def step_by_definition(system, x, v, t, h, option, kind):
    """One step from the definition in y = (x, v)."""
    n, tau = len(system.free), gamma() * h
    mass = system.restrict(system.M())
    jacobian = mp.zeros(2 * n)
    stiffness, damping = mass ** -1 * system.restrict(system.K(x, option)), mass ** -1 * system.restrict(system.G(x))
    for i in range(n):
        jacobian[i, n + i] = mpf(1)
        for j in range(n):
            jacobian[n + i, j], jacobian[n + i, n + j] = stiffness[i, j], damping[i, j]
    w_matrix = mp.eye(2 * n) - tau * jacobian
    stack = lambda top, bottom: mp.matrix(list(top) + list(bottom))
    y = stack(free_part(system, x), free_part(system, v))
    rate = lambda x, v: stack(free_part(system, v), mass ** -1 * forces(system, x, v))
    k1 = mp.lu_solve(w_matrix, rate(x, v) + tau * stack(mp.zeros(n, 1), mass ** -1 * coupling(system, x, v, option, kind)))
    middle = y + h / 2 * k1
    x_mid, v_mid = prescribed(system, with_free(system, x, middle[:n]), with_free(system, v, middle[n:]), t + h / 2)
    w = mp.lu_solve(w_matrix, rate(x_mid, v_mid) - k1)
    y = y + h * (k1 + w)
    return prescribed(system, with_free(system, x, y[:n]), with_free(system, v, y[n:]), t + h)


def run(scene, option, kind, steps, h, advance=step):
    system = System(scene)
    x, v = prescribed(system, system.positions, system.velocities, mpf(0))
    for n in range(steps):
        x, v = advance(system, x, v, n * h, h, option, kind)
    return x, v


def answer(scene, option, kind, dt=0.02, steps=2):
    scene = {**scene, "time": {"dt": dt, "duration": steps * dt}}
    x, v = run(scene, option, kind, steps, mpf(dt))
    check = run(scene, option, kind, steps, mpf(dt), step_by_definition)
    answers.close_rows(x, check[0])
    answers.close_rows(v, check[1])
    return {"name": f"{scene['name']}, {option}" + (f", time derivative {kind}" if "constraints" in scene else ""), "scene": scene,
            "stiffness": option, "time_derivative": kind if "constraints" in scene else None, "dt": mpf(dt), "steps": steps,
            "gamma": gamma(), "positions": x, "velocities": v}


def check_order(scene, truth, end, option, kind):
    """Halving the step has to divide the error by four."""
    with mp.workdps(20):
        errors = []
        for n in (8, 16, 32):
            x, _ = run(scene, option, kind, n, end / n)
            errors.append(max(abs(p - q) for row, true in zip(x, truth) for p, q in zip(row, true)))
        order = mp.log(errors[1] / errors[2], 2)
    if not abs(order - 2) < 0.2:
        raise AssertionError(f"{scene['name']}, {option}, {kind}: order {mp.nstr(order, 4)}")
    return order


def measured_orders():
    """The true motion by extrapolation, the orders of the method against it."""
    rows, end = [], mpf("0.4")
    for scene in (tetrahedron(), moving_anchor(), roller()):
        motion = Motion(scene)
        truth, _ = motion.state(end, motion.solve([end], 0.1, 8)[0])
        for option in OPTIONS:
            for kind in KINDS if "constraints" in scene else ("none",):
                rows.append((scene["name"], option, kind, check_order(scene, truth, end, option, kind)))
    return rows


def main():
    cases = [answer(tetrahedron(), option, "none") for option in OPTIONS]
    cases += [answer(scene, option, kind) for scene in (moving_anchor(), roller()) for option in OPTIONS for kind in KINDS]
    orders = measured_orders()
    answers.write(
        "wmethod",
        "Two steps of the second-order W-method that uses the matrix of linearised backward Euler",
        "Stages in the eliminated form (see derive/wmethod.py for the formula), A at tau = (1 - 1/sqrt 2) dt, in 50 digits; held "
        "to the definition of the method in positions and velocities together, and its order measured between 1.8 and 2.2 in "
        "every case. The second stage takes prescribed coordinates at t + dt/2; time_derivative tells which K_fc stands in tau "
        "(K_fc v_c) in the first stage: that of the option, the exact one, or none (null where nothing is prescribed). Prescribed"
        " coordinates end where their motion is at the end of the step, with its velocity.",
        cases)
    for row in orders:
        print("  order", *row[:3], mp.nstr(row[3], 5))


if __name__ == "__main__":
    main()
