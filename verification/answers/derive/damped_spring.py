"""The damped single spring: its motion in time, and what linearised backward Euler makes of it.

Along a line the force is linear in the length: with the extension e = l - l0, kappa = k/l0 and the reduced mass mu (the mass itself
where the other end is held), mu e'' + b e' + kappa e = 0. With zeta = b/(2 mu) and omega^2 = kappa/mu - zeta^2

    e(t) = exp(-zeta t) (e0 cos(omega t) + (e0' + zeta e0)/omega sin(omega t)),

with cosh and sinh of sqrt(-omega^2) t above the critical damping. The centre of mass of a free pair moves on steadily.

Linearised backward Euler along the line: (mu/dt^2 + b/dt + kappa) d = mu e'/dt - kappa e, e += d, e' = d/dt. Every stiffness option
gives the same, because the transverse part of K^s meets no transverse motion. Two steps eliminate e': with D = mu/dt^2 + b/dt +
kappa, e_{n+1} = ((D - kappa + mu/dt^2) e_n - (mu/dt^2) e_{n-1}) / D, so e_n is a sum of powers of the two roots of D g^2 - (D -
kappa + mu/dt^2) g + mu/dt^2. The recurrence is held to those powers and to the step in three dimensions under all three options.

Positions are chosen so that the line is oblique and still exact in doubles: d = s (2, 1, 2), of length 3 s.
"""

from mpmath import mp, mpf

import answers
import linear_backward_euler
from springs import OPTIONS, System, norm, sub

LINE = (1.0, 0.5, 1.0)                    # of length 1.5


def scene(label, length, rate, k, l0, b, masses, held, dt, duration, dim=3, drift=(0.0, 0.0, 0.0)):
    """Particle 0 at the origin, particle 1 at the given length along the line, its extension changing at the given rate."""
    line = LINE if dim == 3 else (1.5,)
    position = [c * length / 1.5 for c in line]
    velocity = [c * rate / 1.5 for c in line]
    result = {
        "name": label,
        "particles": {"positions": [[0.0] * dim, position],
                      "velocities": [list(drift[:dim]), [d + c for d, c in zip(drift, velocity)]], "masses": masses},
        "springs": {"pairs": [[0, 1]], "stiffness": k, "rest_lengths": l0, "damping": b},
        "time": {"dt": dt, "duration": duration},
    }
    if held:
        result["constraints"] = [{"particles": [0]}]
    return result


class Line:
    """The scene reduced to the extension along its line."""

    def __init__(self, system):
        self.system = system
        d = sub(system.positions[1], system.positions[0])
        self.l = norm(d)
        self.n = [c / self.l for c in d]
        self.held = not set(range(system.dim)) & {a for p, a in system.free if p == 0}
        m0, m1 = system.masses
        self.mu = m1 if self.held else m0 * m1 / (m0 + m1)
        self.e0 = self.l - system.rest_lengths[0]
        w = sub(system.velocities[1], system.velocities[0])
        self.rate = sum(p * q for p, q in zip(w, self.n))
        answers.close(norm([p - self.rate * q for p, q in zip(w, self.n)]), 0)
        self.b, self.kappa = system.damping[0], system.stiffness[0] / system.rest_lengths[0]

    def in_time(self, t):
        """Extension and its rate of the exact motion."""
        zeta = self.b / (2 * self.mu)
        square = self.kappa / self.mu - zeta ** 2
        root = mp.sqrt(abs(square))
        c, s = (mp.cos(root * t), mp.sin(root * t)) if square > 0 else (mp.cosh(root * t), mp.sinh(root * t))
        w = (self.rate + zeta * self.e0) / root
        decay = mp.exp(-zeta * t)
        e = decay * (self.e0 * c + w * s)
        slope = decay * root * (-self.e0 * s if square > 0 else self.e0 * s) + decay * root * w * c - zeta * e
        return e, slope

    def in_steps(self, dt, steps):
        """Extension and its rate after that many steps of linearised backward Euler."""
        e, rate = self.e0, self.rate
        d = self.mu / dt ** 2 + self.b / dt + self.kappa
        for _ in range(steps):
            step = (self.mu * rate / dt - self.kappa * e) / d
            e, rate = e + step, step / dt
        return e, rate

    def in_powers(self, dt, steps):
        """The extension after that many steps from the roots of the characteristic polynomial."""
        d = self.mu / dt ** 2 + self.b / dt + self.kappa
        trace, product = (d - self.kappa + self.mu / dt ** 2) / d, self.mu / dt ** 2 / d
        root = mp.sqrt(mp.mpc(trace ** 2 - 4 * product))
        g, h = (trace + root) / 2, (trace - root) / 2
        e1, _ = self.in_steps(dt, 1)
        a = (e1 - h * self.e0) / (g - h)
        return (a * g ** steps + (self.e0 - a) * h ** steps).real

    def state(self, e, rate, t):
        """Positions and velocities of both particles."""
        system, (m0, m1) = self.system, self.system.masses
        l = system.rest_lengths[0] + e
        if self.held:
            x0, v0 = system.positions[0], [mpf(0)] * system.dim
        else:
            drift = [(m0 * p + m1 * q) / (m0 + m1) for p, q in zip(*system.velocities)]
            centre = [(m0 * p + m1 * q) / (m0 + m1) + d * t for p, q, d in zip(*system.positions, drift)]
            x0 = [c - m1 / (m0 + m1) * l * n for c, n in zip(centre, self.n)]
            v0 = [c - m1 / (m0 + m1) * rate * n for c, n in zip(drift, self.n)]
        return {"positions": [x0, [p + l * n for p, n in zip(x0, self.n)]], "velocities": [v0, [p + rate * n for p, n in zip(v0, self.n)]]}


def answer(label, **given):
    content = scene(label, **given)
    system = System(content)
    line, dt = Line(system), system.dt
    end = mpf(content["time"]["duration"])
    result = {"name": label, "scene": content, "dt": dt, "zeta": line.b / (2 * line.mu), "omega_squared": line.kappa / line.mu - (line.b / (2 * line.mu)) ** 2,
              "kappa": line.kappa, "reduced_mass": line.mu, "exact": [], "linear_backward_euler": []}
    for fraction in ("0.0625", "0.25", "0.5", "0.75", "1"):
        t = mpf(answers.double(end * mpf(fraction)))
        e, rate = line.in_time(t)
        answers.close(mp.diff(lambda s: line.in_time(s)[0], t), rate, mpf(10) ** -20)
        result["exact"].append({"time": t, "length": e + system.rest_lengths[0], "rate": rate, **line.state(e, rate, t)})
    for steps in (1, 2, 10, 100):
        e, rate = line.in_steps(dt, steps)
        answers.close(line.in_powers(dt, steps), e)
        state = line.state(e, rate, steps * dt)
        if steps <= 10:
            for option in OPTIONS:
                x, v = linear_backward_euler.run(content, option, steps)[-1]
                answers.close_rows(x, state["positions"])
                answers.close_rows(v, state["velocities"])
        result["linear_backward_euler"].append({"steps": steps, "time": steps * dt, "length": e + system.rest_lengths[0], "rate": rate, **state})
    return result


def main():
    held = {"masses": [1.0, 0.7], "held": True, "dt": 0.01, "duration": 1.5}
    free = {"masses": [1.3, 0.45], "held": False, "dt": 0.01, "duration": 1.5, "drift": (0.25, -0.5, 0.125)}
    spring = {"length": 2.25, "rate": -0.75, "k": 33.0, "l0": 1.7}
    pressed = {"length": 1.5, "rate": 0.375, "k": 33.0, "l0": 1.7}
    answers.write(
        "damped_spring",
        "A damped spring along its line: the motion in time, and the iterates of linearised backward Euler, the same under every option",
        "exact: e^(-zeta t)(e0 cos wt + (e0' + zeta e0)/w sin wt), or its hyperbolic form, for the extension, with kappa = k/l0 "
        "and the reduced mass; linear_backward_euler: the scalar recurrence in 50 digits, held to the powers of its "
        "characteristic roots and, up to 10 steps, to the step in space under full, tension and axial. Cases start exactly on an "
        "oblique line. omega_squared is negative above critical damping.",
        [
            answer("held, undamped", b=0.0, **spring, **held),
            answer("held, lightly damped", b=0.6, **spring, **held),
            answer("held, starting compressed", b=0.6, **pressed, **held),
            answer("held, overdamped", b=21.0, **spring, **held),
            answer("free pair, undamped", b=0.0, **spring, **free),
            answer("free pair, lightly damped", b=0.4, **spring, **free),
            answer("free pair, starting compressed", b=0.4, **pressed, **free),
            answer("free pair, overdamped", b=11.0, **spring, **free),
            answer("one-dimensional, held, lightly damped", b=0.6, dim=1, **spring, **held),
            answer("one-dimensional, free pair, lightly damped", b=0.4, dim=1, **spring, **free),
        ])


if __name__ == "__main__":
    main()
