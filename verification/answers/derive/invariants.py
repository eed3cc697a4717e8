"""Identities that hold at any state, and the factors of one step on single modes.

Rigid rotation: x -> x + s (omega x x) turns every spring and every elastic force, f(x + s omega x x) = f + s omega x f + O(s^2), so
K (omega x x) = omega x f_el for full (not zero under prestress); under axial K (omega x x) = 0, because omega x d is across the
spring. Dilation: K^s d = (k/l0) d for every option, because d is along the spring, so K x = -L x with L the Laplacian of the
weights k/l0. Translation: K 1 = 0. The vectors are stored for a state with prestress in which nothing is equal.

A mode that grows, M q'' = sigma^2 M q, s = sigma dt: linearised backward Euler with the exact stiffness has g^2 (1 - s^2) - 2 g + 1
= 0, so g = 1/(1 - s) and 1/(1 + s); with the stiffness dropped from the matrix (tension, axial under compression) it is symplectic
Euler, g^2 - (2 + s^2) g + 1 = 0, g = 1 + s^2/2 +- s sqrt(1 + s^2/4). The exact factor is e^s.

A mode that oscillates, q'' = -omega^2 q, z = omega dt: with the exact stiffness the energy factor is 1/(1 + z^2) and the phase atan
z (see taut_chain.py). Dropped, it is symplectic Euler, on the unit circle until z = 2. The linearised implicit midpoint rule with
the stiffness dropped has the matrix ((1 - z^2/2, z), (-z, 1)) on (omega q, v), of determinant 1 + z^2/2: the modulus is sqrt(1 +
z^2/2), beyond the unit circle for every z. The W-method (see wmethod.py) with the stiffness dropped has W = ((1, -tau), (0, 1));
its amplification matrix is a polynomial in z, and it is stable up to the z where the spectral radius leaves 1. The factors are held
to the amplification matrices themselves.

The column between two walls makes growth visible: one mass between two equal compressed springs along x has across it sigma^2 = 2
c/m, c = k (1/l - 1/l0). From a displacement of 1e-10 its four steps follow the factors to the square of the slope, below 1e-11.
"""

from mpmath import mp, mpf

import answers
import linear_backward_euler
from one_step import tetrahedron
from springs import OPTIONS, System
from wmethod import gamma


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def flat(rows):
    return mp.matrix([c for row in rows for c in row])


def rigid_motions():
    scene, omega = tetrahedron(), [0.4, -1.1, 0.7]
    system = System(scene)
    x, w = system.positions, [mpf(c) for c in omega]
    turned = flat([cross(w, row) for row in x])
    force = system.rows(system.elastic_forces(x))
    expected = flat([cross(w, row) for row in force])
    laplacian = mp.zeros(len(turned), 1)
    for (i, j), k, l0 in zip(system.pairs, system.stiffness, system.rest_lengths):
        for a in range(3):
            pull = k / l0 * (x[i][a] - x[j][a])
            laplacian[3 * i + a] -= pull
            laplacian[3 * j + a] += pull
    rotation, ones = {}, flat([[mpf(1), mpf(-2), mpf(3)]] * system.count)
    for option in OPTIONS:
        matrix = system.K(x, option)
        rotation[option] = answers.settle(matrix * turned)
        answers.close_rows([matrix * flat(x)], [laplacian])
        answers.close(mp.norm(matrix * ones, mp.inf), 0)
    answers.close_rows([rotation["full"]], [expected])
    answers.close(mp.norm(rotation["axial"], mp.inf), 0)
    return {"name": "rigid rotation and dilation", "kind": "identities", "scene": scene, "omega": omega,
            "elastic_force": force, "omega_cross_x": system.rows(turned),
            "K_omega_cross_x": {o: system.rows(r) for o, r in rotation.items()}, "K_x": system.rows(laplacian)}


def radius(matrix):
    return max(abs(e) for e in mp.eig(matrix, left=False, right=False))


def euler(z2, kept):
    """Amplification of (q, dt v) by linearised backward Euler, dt^2 omega^2 = z2 (negative: growth), the stiffness kept or dropped."""
    d = 1 + (z2 if kept else 0)
    return mp.matrix([[1 - z2 / d, 1 / d], [-z2 / d, 1 / d]])


def midpoint_dropped(z2):
    return mp.matrix([[1 - z2 / 2, 1], [-z2, 1]])


def w_method(z2, kept):
    """Amplification of (q, dt v) by the W-method."""
    rate = mp.matrix([[0, 1], [-z2, 0]])
    w_inverse = (mp.eye(2) - gamma() * mp.matrix([[0, 1], [-z2 if kept else 0, 0]])) ** -1
    k1 = w_inverse * rate
    return mp.eye(2) + k1 + w_inverse * (rate * (mp.eye(2) + k1 / 2) - k1)


def growth_factors():
    rows = []
    for s in (0.01, 0.1, 0.5, 0.9, 0.99, 1.5, 2.0, 5.0):
        q = mpf(s)
        kept, dropped = 1 / (1 - q), 1 + q ** 2 / 2 + q * mp.sqrt(1 + q ** 2 / 4)
        answers.close(min(abs(e - kept) for e in mp.eig(euler(-q ** 2, True), left=False, right=False)), 0)
        answers.close(radius(euler(-q ** 2, False)), dropped)
        rows.append({"sigma_dt": s, "exact": mp.exp(q), "kept": kept, "dropped": dropped,
                     "w_method_kept": radius(w_method(-q ** 2, True)), "w_method_dropped": radius(w_method(-q ** 2, False))})
    return {"name": "growth factors of a compressed mode", "kind": "growth", "rows": rows}


def oscillation_factors():
    rows = []
    for s in (0.01, 0.1, 0.5, 1.0, 1.9, 2.1, 2.26, 2.27, 3.0, 10.0, 100.0):
        z2 = mpf(s) ** 2
        answers.close(radius(euler(z2, True)) ** 2, 1 / (1 + z2))
        if s < 2:
            answers.close(radius(euler(z2, False)), 1)
            answers.close(radius(midpoint_dropped(z2)), mp.sqrt(1 + z2 / 2))
        rows.append({"z": s, "energy_factor": 1 / (1 + z2), "amplitude_factor": 1 / mp.sqrt(1 + z2), "phase": mp.atan(s),
                     "radius_dropped": radius(euler(z2, False)), "midpoint_radius_dropped": radius(midpoint_dropped(z2)),
                     "w_method_radius_kept": radius(w_method(z2, True)), "w_method_radius_dropped": radius(w_method(z2, False))})
    return {"name": "factors of an oscillating mode", "kind": "oscillation", "rows": rows}


def w_method_limit():
    """The first z at which the spectral radius of the W-method with the stiffness dropped exceeds 1, by bisection.

    Below it the roots are a complex pair inside the circle or real and inside; it is left at g = -1, where 1 + trace + determinant = 0."""
    def at_minus_one(z):
        matrix = w_method(z ** 2, False)
        return 1 + matrix[0, 0] + matrix[1, 1] + mp.det(matrix)

    low, high = mpf("2.2"), mpf("2.3")
    assert at_minus_one(low) > 0 > at_minus_one(high)
    while high - low > mpf(10) ** -45:
        middle = (low + high) / 2
        low, high = (middle, high) if at_minus_one(middle) > 0 else (low, middle)
    for n in range(1, 1001):                                            # nothing leaves the circle before
        assert radius(w_method((low * n / 1001) ** 2, False)) <= 1 + mpf(10) ** -30
    assert radius(w_method((low * mpf("1.000001")) ** 2, False)) > 1
    return {"name": "stability limits on an oscillating mode", "kind": "limits",
            "linear_backward_euler_dropped": mpf(2), "w_method_dropped": low, "linear_backward_euler_kept": None, "w_method_kept": None,
            "midpoint_dropped": mpf(0)}


def pressed_mass(s, steps=4):
    """One mass between two walls, its springs compressed, displaced by 1e-10 across: sigma dt is close to s."""
    l, l0, k, m = 0.75, 1.0, 40.0, 0.3
    sigma = mp.sqrt(2 * mpf(k) * (1 / mpf(l) - 1 / mpf(l0)) / m)
    dt = answers.double(s / sigma)
    scene = {"name": "pressed mass", "particles": {"positions": [[0.0, 0.0, 0.0], [l, 1e-10, 0.0], [2 * l, 0.0, 0.0]], "masses": m},
             "springs": {"pairs": [[0, 1], [1, 2]], "stiffness": k, "rest_lengths": l0},
             "constraints": [{"particles": [0, 2]}], "time": {"dt": dt, "duration": steps * dt}}
    q, results = sigma * mpf(dt), {}
    for option in OPTIONS:
        heights = [x[1][1] for x, _ in linear_backward_euler.run(scene, option, steps)]
        if option == "full":
            pair = (1 / (1 - q), 1 / (1 + q))
        else:
            half = q * mp.sqrt(1 + q ** 2 / 4)
            pair = (1 + q ** 2 / 2 + half, 1 + q ** 2 / 2 - half)
        # from rest: q_0 and q_1 give the two coefficients, and the powers have to follow
        a = (heights[1] - pair[1] * heights[0]) / (pair[0] - pair[1])
        for n, h in enumerate(heights):
            answers.close(h / (a * pair[0] ** n + (heights[0] - a) * pair[1] ** n), 1, mpf(10) ** -11)
        results[option] = {"heights": heights, "factors": list(pair)}
    return {"name": f"pressed mass, sigma dt = {s}", "kind": "run", "scene": scene, "dt": mpf(dt), "steps": steps, "sigma": sigma,
            "exact_factor": mp.exp(q), "options": results}


def main():
    answers.write(
        "invariants",
        "Rigid motions and dilation under K, and the factors of one step on modes that oscillate or grow",
        "identities: vectors in 50 digits, held to the identities they show. growth, oscillation: closed forms held to the "
        "eigenvalues of amplification matrices; radius is the spectral radius; kept and dropped say whether the matrix has the "
        "mode's stiffness (full) or not (axial across a spring; tension across a compressed one). limits: the largest z = omega "
        "dt that is stable, null where every z is; the W-method's by bisection to 45 digits. run: iterates of linearised backward"
        " Euler in 50 digits; heights are the y of particle 1 after 0, 1, ... steps, and follow the powers of the factors to "
        "1e-11.",
        [rigid_motions(), growth_factors(), oscillation_factors(), w_method_limit(), *(pressed_mass(s) for s in (0.1, 0.5, 0.9))])


if __name__ == "__main__":
    main()
