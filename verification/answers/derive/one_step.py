"""One step of linearised backward Euler from a state in which nothing is equal and nothing is aligned.

Four particles, six springs, every mass, stiffness, rest length, damping, position and velocity different, rest lengths away from 1,
two springs compressed and four stretched, gravity oblique: a formula with k for k/l0, with a mass in the wrong row, or with a block
in the wrong place gives other numbers. The step solves A dx = b (see linear_backward_euler.py) by LU in 50 digits; A, b, M, G, K
are those over the free coordinates, ordered by particle and then axis; M, G, K are the derivatives with their signs (K = df_el/dx
and G = df_d/dv are negative where a spring resists); b has the prescribed motion moved to it.
"""

from mpmath import mp

import answers
from linear_backward_euler import free_system, step
from springs import OPTIONS, System, inertia

POSITIONS = [[0.11, -0.07, 0.23], [1.37, 0.19, -0.11], [0.41, 1.21, 0.17], [0.57, 0.31, 1.43]]
VELOCITIES = [[0.3, -0.2, 0.5], [-0.7, 0.4, 0.1], [0.2, 0.9, -0.6], [-0.1, -0.3, 0.8]]
MASSES = [0.7, 1.3, 0.45, 2.1]
PAIRS = [[0, 1], [0, 2], [3, 0], [1, 2], [1, 3], [3, 2]]
STIFFNESS = [120.0, 75.0, 210.0, 55.0, 160.0, 95.0]
REST_LENGTHS = [1.15, 1.6, 1.21, 1.27, 2.05, 1.3]
DAMPING = [0.9, 0.35, 1.7, 0.6, 1.1, 0.2]
GRAVITY = [1.7, -8.9, 2.3]


def tetrahedron(constraints=(), dt=0.015, dim=3):
    """The scene, with its first dim coordinates only."""
    scene = {
        "name": "tetrahedron with nothing equal",
        "gravity": GRAVITY[:dim],
        "particles": {"positions": [row[:dim] for row in POSITIONS], "velocities": [row[:dim] for row in VELOCITIES],
                      "masses": MASSES},
        "springs": {"pairs": PAIRS, "stiffness": STIFFNESS, "rest_lengths": REST_LENGTHS, "damping": DAMPING},
        "time": {"dt": dt, "duration": dt},
    }
    if constraints:
        scene["constraints"] = list(constraints)
    return scene


PATH = {"times": [0.0, 0.2, 0.5], "offsets": [[0, 0, 0], [0.12, -0.05, 0.3], [0.1, 0.4, 0.2]]}
SHORT_PATH = {"times": [0.0, 0.01, 0.5], "offsets": [[0, 0, 0], [0.012, -0.005, 0.03], [0.1, 0.4, 0.2]]}

VARIANTS = {
    "free": tetrahedron(),
    "moving particle": tetrahedron([{"particles": [1], "velocity": [0.4, -0.3, 0.25]}]),
    "particle on a path": tetrahedron([{"particles": [2], "path": PATH}]),
    "path with a corner inside the step": tetrahedron([{"particles": [2], "path": SHORT_PATH}]),
    "particle held in y": tetrahedron([{"particles": [2], "axes": ["y"]}]),
    "held, moved in two axes, and on a path": tetrahedron([
        {"particles": [0]},
        {"particles": [1], "axes": ["x", "z"], "velocity": [0.4, 0, -0.35]},
        {"particles": [3], "axes": ["y"], "path": PATH}]),
    "later entry wins": tetrahedron([
        {"particles": [0, 1]},
        {"particles": [1], "velocity": [0.4, -0.3, 0.25]}]),
    "planar": tetrahedron(dim=2),
    "planar with a moving particle": tetrahedron([{"particles": [3], "velocity": [0.2, -0.6]}], dim=2),
    "one-dimensional": tetrahedron(dim=1),
    "one-dimensional with a held particle": tetrahedron([{"particles": [0]}], dim=1),
    "step too long for full": tetrahedron(dt=3.0),
    "planar, step too long for full": tetrahedron(dt=0.2, dim=2),
}


def answer(label, scene, option):
    system = System(scene)
    x, v = system.positions, system.velocities
    a, b, _ = free_system(system, x, v, mp.mpf(0), system.dt, option)
    new_x, new_v = step(system, x, v, mp.mpf(0), system.dt, option)
    counts = inertia(a)
    dx = mp.matrix([new_x[p][c] - x[p][c] for p, c in system.free])
    answers.close(mp.norm(a * dx - b, mp.inf) / mp.norm(b, mp.inf), 0)
    definite = counts["positive"] == len(system.free)
    if definite == (label.endswith("too long for full") and option == "full"):
        raise AssertionError(f"{label}, {option}: {counts} is not what the case is for")
    return {
        "name": f"{label}, {option}",
        "scene": scene,
        "stiffness": option,
        "dt": system.dt,
        "dofs": [[p, "xyz"[c]] for p, c in system.free],
        "inertia": counts,
        "energy_initial": system.energies(x, v),
        "A": a, "b": b,
        "M": system.restrict(system.M()), "G": system.restrict(system.G(x)), "K": system.restrict(system.K(x, option)),
        "dx": answers.settle(dx), "positions": answers.settle(new_x), "velocities": answers.settle(new_v),
    }


def main():
    cases = [answer(label, scene, option) for label, scene in VARIANTS.items() for option in OPTIONS]
    answers.write(
        "one_step",
        "One step of linearised backward Euler, and the matrices it is made of",
        "A dx = b assembled from the formulas of one spring and solved by LU in 50 digits; then x += dx, v = dx/dt for every "
        "coordinate. A, b, M, G, K over the free coordinates (dofs) at the initial state; K and G with the signs of df/dx and "
        "df/dv; b after the prescribed motion is moved to it. Velocities of prescribed coordinates are their displacement over "
        "dt. Gravitational energy is -sum m gravity.x. Doubles are correctly rounded. All springs stay the same in the planar and"
        " one-dimensional variants.",
        cases)


if __name__ == "__main__":
    main()
