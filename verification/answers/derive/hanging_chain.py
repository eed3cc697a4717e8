"""The hanging chain at rest: each spring bears the weight below it.

In equilibrium the spring above mass i pulls with T_i, the weight of mass i and of all below, T_i = k_i (l_i/l0_i - 1), so l_i =
l0_i (1 + T_i/k_i). A chain hung along gravity, here oblique too, has its masses at the sums of these lengths. Nothing moves it:
f_el + g = 0, so b = 0 and dx = 0 from rest.

The scene's positions are those sums rounded to doubles, so forces vanish to rounding of the positions: a displacement u |x| meets a
stiffness 2 k/l0, and a step dx is of the order of that rounding. The exact equilibrium is given beside it.
"""

from mpmath import mp, mpf

import answers
from springs import System, norm


def hang(label, gravity, masses, k, l0, b=0.0, dt=0.01):
    dim = len(gravity)
    weight = norm([mpf(g) for g in gravity])
    down = [mpf(g) / weight for g in gravity]
    tensions, lengths, positions = [], [], [[mpf(0)] * dim]
    for i in range(len(k)):
        tension = mp.fsum(mpf(m) for m in masses[i + 1:]) * weight
        tensions.append(tension)
        lengths.append(mpf(l0[i]) * (1 + tension / mpf(k[i])))
        positions.append([p + lengths[-1] * d for p, d in zip(positions[-1], down)])
    scene = {
        "name": label, "gravity": gravity,
        "particles": {"positions": answers.doubles(positions), "masses": masses},
        "springs": {"pairs": [[i, i + 1] for i in range(len(k))], "stiffness": k, "rest_lengths": l0, "damping": b},
        "constraints": [{"particles": [0]}],
        "time": {"dt": dt, "duration": 10 * dt},
    }
    system = System(scene)
    exact_forces = [a + g for a, g in zip(system.elastic_forces(positions), system.gravity_forces())]
    assert all(abs(f) < mpf(10) ** -40 for f in exact_forces[dim:])
    rounded = [a + g for a, g in zip(system.elastic_forces(system.positions), system.gravity_forces())]
    return {"name": label, "scene": scene, "dt": system.dt, "positions": answers.settle(positions), "lengths": lengths, "tensions": tensions,
            "support_force": [-f for f in answers.settle(exact_forces[:dim])],
            "largest_force_of_rounded_positions": max(abs(f) for f in rounded[dim:])}


CHAIN = {"masses": [1.0, 0.7, 1.3, 0.45, 2.1, 0.2], "k": [120.0, 75.0, 210.0, 55.0, 90.0], "l0": [0.6, 0.8, 0.45, 0.7, 1.15]}


def main():
    answers.write(
        "hanging_chain",
        "A hanging chain rests where every spring bears the weight below it, and a step from there moves nothing",
        "l_i = l0_i (1 + T_i/k_i) in 50 digits, with T_i the weight below; forces at the exact equilibrium vanish to 40 digits. "
        "The scene holds its positions rounded to doubles; what force the rounding leaves is largest_force_of_rounded_positions. "
        "support_force is what holds particle 0 (the prescribed one), its own weight included.",
        [hang("hanging straight down", [0.0, -9.81, 0.0], **CHAIN), hang("hanging obliquely", [2.0, -9.0, 3.5], b=0.4, **CHAIN),
         hang("hanging in a plane", [1.5, -9.5], b=0.4, **CHAIN), hang("hanging along the only axis", [-9.81], b=0.4, **CHAIN),
         hang("hanging very soft", [0.0, 0.0, -9.81], [1.0] * 5, [10.0, 12.0, 9.0, 11.0], [0.3, 0.5, 0.4, 0.2])])


if __name__ == "__main__":
    main()
