"""Two bodies joined by a spring, circling each other at a steady length.

With the reduced mass mu the separation obeys mu d'' = -k (l/l0 - 1) n. A steady circle of rate omega needs mu omega^2 l = k (l/l0 -
1), so

    l = l0/(1 - mu omega^2 l0/k).

The bodies circle their centre of mass at the distances l m2/(m1 + m2) and l m1/(m1 + m2); the centre moves on steadily. Damping
along the spring does nothing, because the length does not change. The scene's positions and velocities are rounded to doubles,
which changes the orbit by a few 1e-16 a radian.
"""

from mpmath import mp, mpf

import answers
from springs import System


def circle(label, masses, k, l0, omega, b, plane, centre, drift, duration, dt=0.01):
    """plane: two orthonormal directions, exactly so in many digits."""
    m1, m2 = (mpf(m) for m in masses)
    mu = m1 * m2 / (m1 + m2)
    omega, k_, l0_ = mpf(omega), mpf(k), mpf(l0)
    l = l0_ / (1 - mu * omega ** 2 * l0_ / k_)
    answers.close(mu * omega ** 2 * l, k_ * (l / l0_ - 1))
    across, ahead = plane

    def state(t):
        c, s = mp.cos(omega * t), mp.sin(omega * t)
        n = [c * p + s * q for p, q in zip(across, ahead)]
        w = [omega * (c * q - s * p) for p, q in zip(across, ahead)]
        middle = [mpf(p) + mpf(d) * t for p, d in zip(centre, drift)]
        share1, share2 = m2 / (m1 + m2) * l, m1 / (m1 + m2) * l
        return {"positions": [[p + share1 * q for p, q in zip(middle, n)], [p - share2 * q for p, q in zip(middle, n)]],
                "velocities": [[mpf(p) + share1 * q for p, q in zip(drift, w)], [mpf(p) - share2 * q for p, q in zip(drift, w)]]}

    start = answers.settle(state(mpf(0))["positions"]), answers.settle(state(mpf(0))["velocities"])
    scene = {"name": label, "particles": {"positions": answers.doubles(start[0]), "velocities": answers.doubles(start[1]), "masses": masses},
             "springs": {"pairs": [[0, 1]], "stiffness": k, "rest_lengths": l0, "damping": b}, "time": {"dt": dt, "duration": duration}}
    system = System(scene)
    for t in (mpf(0), mpf("0.37")):                                     # the exact circle obeys m x'' = f
        now = state(t)
        force = system.rows(system.forces(now["positions"], now["velocities"]))
        for p in range(2):
            centripetal = [-system.masses[p] * omega ** 2 * (a - mpf(c) - mpf(d) * t) for a, c, d in zip(now["positions"][p], centre, drift)]
            answers.close_rows([force[p]], [centripetal])
    energies = system.energies(*start)
    times = [mpf(answers.double(mpf(duration) * mpf(f))) for f in ("0.125", "0.5", "1")]
    return {"name": label, "scene": scene, "omega": omega, "length": l, "reduced_mass": mu, "tension": k_ * (l / l0_ - 1),
            "energy": {"kinetic": energies["kinetic"], "elastic": energies["elastic"]},
            "angular_momentum_about_centre": mu * l ** 2 * omega,
            "states": [{"time": t, **{key: answers.settle(value) for key, value in state(t).items()}} for t in times]}


def main():
    third = mpf(1) / 3
    oblique = ([2 * third, third, 2 * third], [-2 * third, 2 * third, third])
    flat = ([mpf(1), mpf(0), mpf(0)], [mpf(0), mpf(1), mpf(0)])
    still = {"centre": [0.0, 0.0, 0.0], "drift": [0.0, 0.0, 0.0]}
    answers.write(
        "two_bodies",
        "Two bodies circle each other at the length l = l0/(1 - mu omega^2 l0/k) for all time",
        "Balance of spring and centripetal force, solved for l, in 50 digits; the circle is checked to obey the equations of "
        "motion to 35 digits. Positions and velocities of the scene are its start rounded to doubles; states are those of the "
        "exact circle.",
        [circle("circling in the xy plane", [1.3, 0.45], 33.0, 1.7, 3.0, 0.0, flat, duration=2.0, **still),
         circle("circling in an oblique plane", [1.3, 0.45], 33.0, 1.7, 3.0, 0.0, oblique, duration=2.0, **still),
         circle("circling, damped and drifting", [0.7, 2.1], 52.0, 0.6, 4.5, 1.2, oblique, [0.5, -0.25, 0.125], [0.25, -0.5, 0.375], 2.0),
         circle("circling fast and far apart", [0.7, 2.1], 20.0, 0.6, 7.0, 0.0, oblique, duration=1.0, **still),
         circle("circling, planar scene", [1.3, 0.45], 33.0, 1.7, -3.0, 0.0, ([mpf("0.6"), mpf("0.8")], [mpf("-0.8"), mpf("0.6")]),
                [0.0, 0.0], [0.1, 0.2], 2.0)])


if __name__ == "__main__":
    main()
