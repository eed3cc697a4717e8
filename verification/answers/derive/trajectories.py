"""True motions of small nonlinear scenes, to more digits than a double holds.

M v' = f_el(x) + f_d(x, v) + g, x' = v, for the free coordinates; prescribed ones follow their motion, and their velocity enters the
damping. The equations are solved twice by extrapolation (see extrapolation.py), with orders 24 and 20 and other steps, in 36
digits; the larger of the two differences is given as error_estimate. Held besides: to mpmath's Taylor integrator for the spherical
pendulum; to conservation of energy where nothing damps, of both momenta for the free tetrahedron; and, for the steadily moved
anchor, to the same pendulum seen from the anchor, where the anchor is at rest.

The scenes are soft: the fastest vibration takes about a second (a quarter of one for the stiffer pendulum), so that the order of a
method shows with dt from 0.1 to 0.001.
"""

from mpmath import mp, mpf

import answers
import extrapolation
from springs import System

DIGITS = 36
TETRAHEDRON = {
    "positions": [[0.11, -0.07, 0.23], [1.37, 0.19, -0.11], [0.41, 1.21, 0.17], [0.57, 0.31, 1.43]],
    "velocities": [[0.3, -0.2, 0.5], [-0.7, 0.4, 0.1], [0.2, 0.9, -0.6], [-0.1, -0.3, 0.8]],
    "masses": [0.7, 1.3, 0.45, 2.1]}
TETRAHEDRON_SPRINGS = {
    "pairs": [[0, 1], [0, 2], [3, 0], [1, 2], [1, 3], [3, 2]], "stiffness": [3.0, 1.9, 5.2, 1.4, 4.0, 2.4],
    "rest_lengths": [1.15, 1.45, 1.21, 1.27, 1.9, 1.3], "damping": [0.09, 0.035, 0.17, 0.06, 0.11, 0.02]}


def scene(name, gravity, particles, springs, constraints=(), duration=2.0):
    content = {"name": name, "gravity": gravity, "particles": particles, "springs": springs,
               "time": {"dt": 0.01, "duration": duration}}
    if constraints:
        content["constraints"] = list(constraints)
    return content


def spherical_pendulum(k=40.0):
    return scene("spherical pendulum", [0.0, -9.81, 0.0],
                 {"positions": [[0.1, 0.2, -0.1], [0.95, -0.45, 0.15]], "velocities": [[0, 0, 0], [0.2, 0.4, 1.3]], "masses": [1.0, 0.6]},
                 {"pairs": [[0, 1]], "stiffness": k, "rest_lengths": 0.9}, [{"particles": [0]}])


def elastic_pendulum():
    return scene("elastic pendulum", [0.4, -9.81],
                 {"positions": [[0.0, 0.0], [0.8, -0.9]], "velocities": [[0, 0], [-0.5, 1.1]], "masses": [1.0, 0.75]},
                 {"pairs": [[0, 1]], "stiffness": 24.0, "rest_lengths": 0.8}, [{"particles": [0]}])


def tetrahedron(gravity=(0.0, 0.0, 0.0)):
    return scene("damped tetrahedron", list(gravity), TETRAHEDRON, TETRAHEDRON_SPRINGS)


def undamped_tetrahedron():
    return scene("undamped tetrahedron", [0.0, 0.0, 0.0], TETRAHEDRON, {**TETRAHEDRON_SPRINGS, "damping": 0.0})


def moving_anchor():
    return scene("pendulum on a moving anchor", [0.0, -9.81, 0.0],
                 {"positions": [[0.0, 0.0, 0.0], [0.7, -0.8, 0.3], [0.9, -1.7, 0.1]],
                  "velocities": [[0.5, 0.1, -0.2], [0.0, 0.3, 0.6], [-0.4, 0.0, 0.2]], "masses": [1.0, 0.6, 0.35]},
                 {"pairs": [[0, 1], [1, 2]], "stiffness": [30.0, 19.0], "rest_lengths": [0.9, 0.75], "damping": [0.5, 0.2]},
                 [{"particles": [0], "velocity": [0.5, 0.1, -0.2]}])


def seen_from_anchor():
    """moving_anchor in the frame of its anchor; its numbers are exact differences of the other scene's, not doubles."""
    content = moving_anchor()
    drift = [mpf(c) for c in content["constraints"][0]["velocity"]]
    content["particles"]["velocities"] = [[mpf(c) - d for c, d in zip(row, drift)] for row in content["particles"]["velocities"]]
    content["constraints"] = [{"particles": [0]}]
    return content, drift


def roller():
    """A particle free along x only, carrying a pendulum; a second particle moved along x only."""
    return scene("pendulum on a roller", [0.0, -9.81, 0.0],
                 {"positions": [[0.0, 0.0, 0.0], [0.6, -0.7, 0.2], [-1.0, 0.1, 0.0]], "velocities": [[0.3, 0, 0], [0.0, 0.0, 0.8], [0.25, 0, 0]],
                  "masses": [0.8, 0.5, 1.0]},
                 {"pairs": [[0, 1], [2, 0]], "stiffness": [30.0, 12.0], "rest_lengths": [0.85, 0.9], "damping": [0.1, 0.3]},
                 [{"particles": [0, 2], "axes": ["y", "z"]}, {"particles": [2], "axes": ["x"], "velocity": [0.25, 0, 0]}])


class Motion:
    """Equations of motion over the free coordinates of a scene."""

    def __init__(self, content):
        self.system = System(content)
        s = self.system
        self.size = len(s.free)
        self.start = [s.positions[p][a] for p, a in s.free] + [s.velocities[p][a] for p, a in s.free]

    def state(self, t, y):
        s = self.system
        x, v = [[None] * s.dim for _ in range(s.count)], [[None] * s.dim for _ in range(s.count)]
        for i, (p, a) in enumerate(s.free):
            x[p][a], v[p][a] = y[i], y[self.size + i]
        for (p, a), motion in s.motions.items():
            x[p][a], v[p][a] = s.positions[p][a] + motion.offset(t), motion.rate(t)
        return x, v

    def rate(self, t, y):
        s = self.system
        forces = s.forces(*self.state(t, y))
        return list(y[self.size:]) + [forces[s.index(dof)] / s.masses[dof[0]] for dof in s.free]

    def solve(self, times, step, columns):
        with mp.workdps(DIGITS):
            return extrapolation.solve(self.rate, self.start, times, mpf(step), columns)


def largest_difference(a, b):
    return max(abs(p - q) for p, q in zip(a, b))


def momenta(system, x, v):
    linear = [mp.fsum(m * row[a] for m, row in zip(system.masses, v)) for a in range(3)]
    angular = [mp.fsum(m * (p[(a + 1) % 3] * w[(a + 2) % 3] - p[(a + 2) % 3] * w[(a + 1) % 3]) for m, p, w in zip(system.masses, x, v))
               for a in range(3)]
    return linear + angular


def answer(content, step=0.1, conserves=()):
    motion = Motion(content)
    duration = mpf(content["time"]["duration"])
    times = [mpf(answers.double(duration * mpf(f))) for f in ("0.05", "0.25", "0.5", "1")]
    fine, other = motion.solve(times, step, 12), motion.solve(times, step * 0.83, 10)
    error = max(largest_difference(a, b) for a, b in zip(fine, other))
    if error > mpf(10) ** -18:
        raise AssertionError(f"{content['name']}: two solutions differ by {mp.nstr(error, 3)}")
    system = motion.system
    states = [(t, *motion.state(t, y)) for t, y in zip(times, fine)]
    first = motion.state(mpf(0), motion.start)
    for quantity in conserves:
        before = quantity(system, *first)
        for _, x, v in states:
            answers.close_rows([quantity(system, x, v)], [before], max(10 * error, mpf(10) ** -30))
    return {"name": content["name"], "scene": content, "error_estimate": error,
            "states": [{"time": t, "positions": x, "velocities": v, "energy": system.energies(x, v)} for t, x, v in states]}


def energy(system, x, v):
    return [mp.fsum(system.energies(x, v).values())]


def hold_to_taylor(content, end, expected):
    """mpmath's own Taylor-series integrator, to the digits it is asked for."""
    motion = Motion(content)
    with mp.workdps(25):
        solution = mp.odefun(lambda t, y: motion.rate(t, y), 0, motion.start, tol=mpf(10) ** -20)(end)
    answers.close(largest_difference(solution, expected), 0, mpf(10) ** -17)


def hold_to_moving_frame(result):
    content, drift = seen_from_anchor()
    motion = Motion(content)
    times = [s["time"] for s in result["states"]]
    for state, y in zip(result["states"], motion.solve(times, 0.1, 12)):
        x, v = motion.state(state["time"], y)
        for p in range(motion.system.count):
            answers.close_rows([state["positions"][p]], [[c + d * state["time"] for c, d in zip(x[p], drift)]], mpf(10) ** -18)
            answers.close_rows([state["velocities"][p]], [[c + d for c, d in zip(v[p], drift)]], mpf(10) ** -18)


def main():
    pendulum = answer(spherical_pendulum(), conserves=[energy])
    early = pendulum["states"][0]
    hold_to_taylor(spherical_pendulum(), early["time"], early["positions"][1] + early["velocities"][1])
    anchor = answer(moving_anchor())
    hold_to_moving_frame(anchor)
    results = [
        pendulum,
        answer(elastic_pendulum(), conserves=[energy]),
        answer(tetrahedron(), conserves=[momenta]),
        answer(undamped_tetrahedron(), conserves=[momenta, energy]),
        answer(tetrahedron(gravity=(1.7, -8.9, 2.3))),
        anchor,
        answer(roller()),
        answer(spherical_pendulum(k=400.0), step=0.03125, conserves=[energy]),
    ]
    results[4]["name"] = results[4]["scene"]["name"] = "falling damped tetrahedron"
    results[7]["name"] = results[7]["scene"]["name"] = "stiffer spherical pendulum"
    answers.write(
        "trajectories",
        "True motions of nonlinear scenes at several times",
        "Extrapolation of order 24 in 36 digits; error_estimate is the largest difference, over all coordinates and times, to a "
        "second solution of order 20 with other steps. Held besides to mpmath's Taylor integrator, to conserved energies and "
        "momenta, and to a change of frame. Velocities of prescribed coordinates are those of their motion. Gravitational energy "
        "is -sum m gravity.x.",
        results)
    for r in results:
        print(f"  {r['name']}: {mp.nstr(r['error_estimate'], 2)}")


if __name__ == "__main__":
    main()
