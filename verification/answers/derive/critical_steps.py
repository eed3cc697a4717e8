"""Steps at which A = M/dt^2 - G/dt - K stops being positive definite, and what is known in closed form about them.

With c = k (1/l - 1/l0) > 0 for a compressed spring, -K has -c across the spring, so across it A loses definiteness at a finite
step.

One compressed spring, two free masses: across it -K is -c [[1, -1], [-1, 1]], G has no part there, and M - dt^2 c [[1, -1], [-1,
1]] is singular when 1 = dt^2 c (1/m1 + 1/m2): dt = sqrt(mu / c), mu = m1 m2/(m1 + m2). Above it one negative eigenvalue per
transverse axis.

Straight free chain of n equal masses, all springs equally compressed: across it -K is -c times the Laplacian of a path, whose
largest eigenvalue is 2 - 2 cos((n-1) pi/n) = 2 + 2 cos(pi/n): dt = sqrt(m / (c (2 + 2 cos(pi/n)))).

Shallow truss (apex between two held supports, half-span a, links of rest length l0, apex height y, l^2 = a^2 + y^2): vertically
K_yy = -2k (1/l0 - a^2/l^3), zero at l = (a^2 l0)^(1/3). There the load of equilibrium, P = 2 k y (1/l - 1/l0), is the largest the
truss can bear: with r = (a/l0)^(2/3), l = l0 r, y = l0 r sqrt(1 - r), P = 2 k (1 - r)^(3/2). Below that height dt = sqrt(m / K_yy).

Braced column: N joints between two held ends, links of length l pressed by P = k (1 - l/l0), each joint braced sideways by a spring
at its rest length, of stiffness kappa = k_b/l_b. Sideways -K is kappa I - (P/l) L, L the Laplacian of N joints between walls, whose
largest eigenvalue is 2 + 2 cos(pi/(N+1)): it buckles at P = kappa l/(2 + 2 cos(pi/(N+1))), and above it dt = sqrt(m / ((P/l)(2 + 2
cos(pi/(N+1))) - kappa)).

Linear stability of linearised backward Euler at an equilibrium. With K the true and K_o the option's matrix the step is M (x+ - 2x
+ x-)/dt^2 = K_o (x+ - x) + K x + G (x+ - x)/dt; with x ~ g^n u and the three numbers a = u*Au, s = u*(-K)u, m = u*Mu/dt^2 this is a
g^2 - (a + m - s) g + m = 0, so |g| <= 1 for both roots exactly when m <= a, s >= 0 and 2a + 2m - s >= 0. The last is u*Su >= 0 with
S = 4M/dt^2 - 2G/dt - 2K_o + K; s >= 0 says that the equilibrium itself is stable; m <= a follows from it because no option makes
-K_o less than -K. So at a stable equilibrium the largest stable step is the end of the interval where S is positive definite.

Every closed form here is held to bisection with a Cholesky factorization, and every count to eigenvalues, all in 50 digits.
"""

from mpmath import mp, mpf

import answers
from one_step import tetrahedron
from springs import OPTIONS, System, eigenvalues, inertia, largest_definite_step

BELOW, ABOVE = 1 - 1e-6, 1 + 1e-6


def matrix_of_dt(system, option):
    return lambda dt: system.restrict(system.A(system.positions, dt, option))


def test_matrix_of_dt(system, option):
    return lambda dt: system.restrict(system.S(system.positions, dt, option))


def case(label, kind, scene, closed_form=None, stable=False, parameters=None):
    """A scene with its critical step, counts on both sides of it, and, at a stable equilibrium, the largest stable steps."""
    system = System(scene)
    critical = {o: largest_definite_step(matrix_of_dt(system, o)) for o in OPTIONS}
    if closed_form is not None:
        answers.close(critical["full"], closed_form)
    for option in ("tension", "axial"):
        if critical[option] is not None:
            raise AssertionError(f"{label}: {option} has to be definite for every step")
    result = {"name": label, "kind": kind, "scene": scene, "parameters": parameters or {}, "stiffness": "full",
              "dofs": len(system.free), "critical_dt": critical["full"],
              "compressed_springs": sum(mp.norm([p - q for p, q in zip(system.positions[i], system.positions[j])]) < l0
                                        for (i, j), l0 in zip(system.pairs, system.rest_lengths))}
    if critical["full"] is not None:
        for side, factor, expected_definite in (("below", BELOW, True), ("above", ABOVE, False)):
            dt = answers.double(critical["full"] * mpf(factor))
            values = eigenvalues(matrix_of_dt(system, "full")(mpf(dt)))
            counts = inertia(None, values)
            if (counts["negative"] == 0 and counts["zero"] == 0) != expected_definite:
                raise AssertionError(f"{label}: {counts} {side}")
            result[side] = {"dt": dt, "inertia": counts, "lambda_min": values[0], "lambda_max": values[-1]}
    if stable:
        if inertia(-system.restrict(system.K(system.positions)))["negative"]:
            raise AssertionError(f"{label}: not a stable equilibrium")
        result["stable_dt"] = {o: largest_definite_step(test_matrix_of_dt(system, o)) for o in OPTIONS}
    return result


def single_spring(label, xi, xj, masses, k, l0, b):
    dim = len(xi)
    scene = {"name": label, "particles": {"positions": [xi, xj], "masses": masses},
             "springs": {"pairs": [[0, 1]], "stiffness": k, "rest_lengths": l0, "damping": b}, "time": {"dt": 0.01, "duration": 0.1}}
    system = System(scene)
    m1, m2 = system.masses
    l = mp.norm([p - q for p, q in zip(*system.positions)])
    closed = mp.sqrt(m1 * m2 / (m1 + m2) / (system.stiffness[0] * (1 / l - 1 / system.rest_lengths[0])))
    result = case(label, "single spring", scene, closed)
    assert result["above"]["inertia"]["negative"] == dim - 1
    return result


def chain(n, dim, b=0.0):
    l, l0, k, m = 0.75, 1.0, 40.0, 0.3
    scene = {"name": f"straight chain of {n}", "particles": {"positions": [[l * p] + [0.0] * (dim - 1) for p in range(n)], "masses": m},
             "springs": {"pairs": [[p, p + 1] for p in range(n - 1)], "stiffness": k, "rest_lengths": l0, "damping": b},
             "time": {"dt": 0.01, "duration": 0.1}}
    c = mpf(k) * (1 / mpf(l) - 1 / mpf(l0))
    closed = mp.sqrt(mpf(m) / (c * (2 + 2 * mp.cos(mp.pi / n))))
    damped = ", damped" if b else ""
    result = case(f"straight free compressed chain of {n}, {dim} axes{damped}", "chain", scene, closed, parameters={"n": n, "c": c})
    assert result["above"]["inertia"]["negative"] == dim - 1
    return result


def truss_geometry(a, l0):
    """Height and load at which the truss snaps."""
    l = mp.cbrt(mpf(a) ** 2 * l0)
    y = mp.sqrt(l ** 2 - mpf(a) ** 2)
    r = mp.cbrt((mpf(a) / l0) ** 2)
    return l, y, 2 * (1 - r) ** mpf(1.5)


def truss_scene(label, a, y, k, l0, m, gravity=0.0, dim=2):
    flat = [0.0] * (dim - 2)
    scene = {"name": label, "particles": {"positions": [[-a, 0.0] + flat, [a, 0.0] + flat, [0.0, y] + flat], "masses": m},
             "springs": {"pairs": [[0, 2], [1, 2]], "stiffness": k, "rest_lengths": l0},
             "constraints": [{"particles": [0, 1]}], "time": {"dt": 0.01, "duration": 0.1}}
    if dim == 3:
        scene["constraints"].append({"particles": [2], "axes": ["z"]})
    if gravity:
        scene["gravity"] = [0.0, gravity] + flat
    return scene


def trusses():
    a, k, l0, m = 1.0, 900.0, 1.25, 2.0
    l_crit, y_crit, load = truss_geometry(a, mpf(l0))
    load *= k
    for dim in (2, 3):
        for label, factor, singular in (("just above its critical height", ABOVE, False), ("just below its critical height", BELOW, True),
                                        ("well below its critical height", 0.5, True)):
            y = answers.double(y_crit * mpf(factor))
            scene = truss_scene(f"shallow truss {label}", a, y, k, l0, m, dim=dim)
            l = mp.sqrt(mpf(a) ** 2 + mpf(y) ** 2)
            kyy = -2 * mpf(k) * (1 / mpf(l0) - mpf(a) ** 2 / l ** 3)
            closed = mp.sqrt(m / kyy) if singular else None
            result = case(f"shallow truss {label}, {dim} axes", "truss", scene, closed,
                          parameters={"critical_height": y_crit, "critical_length": l_crit, "critical_load": load, "K_yy": kyy})
            dt = 1.0e4
            result["long_step"] = {"dt": dt, "inertia": inertia(matrix_of_dt(System(scene), "full")(mpf(dt)))}
            assert result["long_step"]["inertia"]["negative"] == int(singular)
            yield result
    # The load itself: a vertical force on the apex at equilibrium, at heights with K_yy on both sides of zero, stays below the critical load.
    heights = [y_crit * mpf(f) for f in ("0.9", "0.999", "1", "1.001", "1.1")]
    forces = [2 * k * y * (1 / mp.sqrt(mpf(a) ** 2 + y ** 2) - 1 / mpf(l0)) for y in heights]
    answers.close(forces[2], load)
    assert max(forces) == forces[2]
    # Loaded by gravity to 96 % of the critical load, at its equilibrium above the critical height: a stable equilibrium under compression.
    y = answers.double(y_crit * mpf(1.2))
    l = mp.sqrt(mpf(a) ** 2 + mpf(y) ** 2)
    weight = 2 * k * mpf(y) * (1 / l - 1 / mpf(l0))
    scene = truss_scene("shallow truss under load", a, y, k, l0, m, gravity=answers.double(-weight / m))
    result = case("shallow truss under load, at rest above its critical height", "truss", scene, stable=True,
                  parameters={"critical_height": y_crit, "critical_length": l_crit, "critical_load": load, "load": weight})
    yield result


def column_scene(label, joints, dim, l, l0, k, m, kappa_stiffness, brace):
    positions = [[l * p] + [0.0] * (dim - 1) for p in range(joints + 2)]
    pairs = [[p, p + 1] for p in range(joints + 1)]
    ks, rests, held = [k] * (joints + 1), [l0] * (joints + 1), [0, joints + 1]
    for axis in range(1, dim):
        for p in range(1, joints + 1):
            anchor = list(positions[p])
            anchor[axis] = brace
            held.append(len(positions))
            pairs.append([p, len(positions)])
            positions.append(anchor)
            ks.append(kappa_stiffness)
            rests.append(brace)
    return {"name": label, "particles": {"positions": positions, "masses": m},
            "springs": {"pairs": pairs, "stiffness": ks, "rest_lengths": rests},
            "constraints": [{"particles": held}], "time": {"dt": 0.01, "duration": 0.1}}


def columns():
    l, l0, m, brace, brace_k = 0.5, 0.5078125, 0.4, 2.0, 30.0
    kappa = mpf(brace_k) / brace
    for joints, dim in ((1, 2), (3, 2), (5, 2), (8, 2), (5, 3)):
        largest = 2 + 2 * mp.cos(mp.pi / (joints + 1))
        load = kappa * l / largest
        for label, factor in (("just below its buckling load", BELOW), ("just above its buckling load", ABOVE), ("at twice its buckling load", 2.0)):
            k = answers.double(load * mpf(factor) / (1 - mpf(l) / mpf(l0)))
            pressed = mpf(k) * (1 - mpf(l) / mpf(l0))
            excess = pressed / l * largest - kappa
            scene = column_scene(f"braced column {label}", joints, dim, l, l0, k, m, brace_k, brace)
            result = case(f"braced column of {joints} joints {label}, {dim} axes", "column", scene,
                          mp.sqrt(m / excess) if excess > 0 else None, stable=excess < 0,
                          parameters={"joints": joints, "kappa": kappa, "buckling_load": load, "load": pressed})
            dt = 1.0e5
            result["long_step"] = {"dt": dt, "inertia": inertia(matrix_of_dt(System(scene), "full")(mpf(dt)))}
            negative = result["long_step"]["inertia"]["negative"]
            expected = 0 if excess < 0 else (dim - 1) * sum(
                pressed / l * (2 - 2 * mp.cos(j * mp.pi / (joints + 1))) > kappa for j in range(1, joints + 1))
            assert negative == expected
            yield result


def tensegrity(label, dim, masses):
    """Sides 3 and 4 stretched, diagonals 5 compressed, all with the force density k |1/l0 - 1/l| = 10: at rest, and exactly so in doubles."""
    flat = [0.0] * (dim - 2)
    scene = {"name": label, "particles": {"positions": [[x, y] + flat for x, y in ((0.0, 0.0), (3.0, 0.0), (3.0, 4.0), (0.0, 4.0))], "masses": masses},
             "springs": {"pairs": [[0, 1], [2, 3], [1, 2], [3, 0], [0, 2], [1, 3]], "stiffness": [60.0, 60.0, 40.0, 40.0, 100.0, 100.0],
                         "rest_lengths": [2.0, 2.0, 2.0, 2.0, 10.0, 10.0], "damping": [0.5, 0.5, 0.25, 0.25, 1.5, 1.5]},
             "time": {"dt": 0.01, "duration": 0.1}}
    system = System(scene)
    assert max(abs(c) for c in system.elastic_forces(system.positions)) < mpf(10) ** -45
    result = case(label, "tensegrity", scene, stable=True, parameters={"force_density": 10})
    if dim == 3 and isinstance(masses, float):
        # Out of the plane -K is 10 s s^T with s = (1, -1, 1, -1), its eigenvalue 40, and 4m/dt^2 = 40 ends the stability of axial.
        answers.close(result["stable_dt"]["axial"], mp.sqrt(mpf(masses) / 10))
    return result


def irregular():
    """No closed form: bisection alone."""
    held = [{"particles": [0]}, {"particles": [2], "axes": ["y"]}]
    yield case("tetrahedron with nothing equal, free", "irregular", tetrahedron())
    yield case("tetrahedron with nothing equal, held", "irregular", tetrahedron(held))
    yield case("tetrahedron with nothing equal, planar", "irregular", tetrahedron(dim=2))
    yield case("tetrahedron with nothing equal, one-dimensional", "irregular", tetrahedron(dim=1))


def cases():
    yield single_spring("one compressed spring along x", [0.0, 0.0, 0.0], [0.75, 0.0, 0.0], [0.8, 1.7], 120.0, 1.1, 0.0)
    yield single_spring("one compressed spring, oblique", [0.31, -0.74, 0.52], [-0.23, 0.18, -0.41], [0.8, 1.7], 140.0, 1.9, 0.0)
    yield single_spring("one compressed spring, oblique and damped", [0.31, -0.74, 0.52], [-0.23, 0.18, -0.41], [0.8, 1.7], 140.0, 1.9, 35.0)
    yield single_spring("one compressed spring, masses 1 to 1e6", [0.31, -0.74, 0.52], [-0.23, 0.18, -0.41], [1e-3, 1e3], 140.0, 1.9, 0.3)
    yield single_spring("one compressed spring, planar", [0.31, -0.74], [-0.23, 0.18], [0.8, 1.7], 140.0, 1.9, 0.3)
    for n in range(2, 11):
        yield chain(n, 3)
    yield chain(6, 3, b=2.5)
    yield chain(6, 2, b=2.5)
    yield from trusses()
    yield from columns()
    yield tensegrity("rectangle of stretched sides and compressed diagonals, equal masses", 3, 0.6)
    yield tensegrity("rectangle of stretched sides and compressed diagonals", 3, [0.6, 1.1, 0.35, 0.8])
    yield tensegrity("rectangle of stretched sides and compressed diagonals, planar", 2, [0.6, 1.1, 0.35, 0.8])
    yield from irregular()


def main():
    answers.write(
        "critical_steps",
        "The largest step with a definite matrix, and the inertia on both sides of it",
        "critical_dt: closed forms (kind single spring, chain, truss, column), each held to bisection with Cholesky in 50 digits "
        "to 35 digits; kind irregular and tensegrity by bisection alone; null where A is definite for every step. below and "
        "above: the doubles nearest critical_dt(1 -+ 1e-6) and the inertia of A there, from all eigenvalues in 50 digits; "
        "rounding in doubles can tell the sign of lambda_min while it is well above 1e-16 lambda_max. long_step: the inertia at a"
        " step so long that only K counts. stable_dt: the end of the interval where S = 4M/dt^2 - 2G/dt - 2K_option + K is "
        "positive definite, at stable equilibria only (-K positive semidefinite); null where it has no end. Everything at the "
        "initial state under the option full unless an option is named.",
        list(cases()))


if __name__ == "__main__":
    main()
