"""Derivative checks on force models that are not of this library, right and with planted faults; writes derivative-checks.md.

    python verification/derivative_checks.py [--write]

Needs sprung, autograd and scipy. Every model gives an energy, a force in named terms and K = dforce/dx in named terms. A fault is a term with a
wrong factor, or a wrong index: an entry lost, particles, rows or axes exchanged or shifted.
"""

from __future__ import annotations

import datetime
import sys
from pathlib import Path

import autograd
import autograd.numpy as anp
import numpy as np
import scipy.optimize
import sprung

SCALES = [10.0**k for k in range(-6, 7)]
SEEDS = range(5)
FAULTS = 20


class Net:
    """Springs between random points, some stretched and some compressed."""

    name = "spring net"

    def __init__(self, seed, s):
        rng = np.random.default_rng(seed)
        self.x = rng.normal(size=(7, 3)) * s
        self.pairs = np.array([rng.choice(7, 2, replace=False) for _ in range(14)])
        self.k = rng.uniform(20, 80, 14)
        self.l0 = np.linalg.norm(self.d(self.x), axis=1) * rng.uniform(0.7, 1.4, 14)

    def d(self, x):
        return x[self.pairs[:, 0]] - x[self.pairs[:, 1]]

    def energy(self, x):
        return np.sum(0.5 * self.k / self.l0 * (np.linalg.norm(self.d(x), axis=1) - self.l0) ** 2)

    def force(self, x):
        d = self.d(x)
        l = np.linalg.norm(d, axis=1)
        parts = {"k d/l0": -(self.k / self.l0)[:, None] * d, "k n": (self.k / l)[:, None] * d}
        return {name: self.scatter(part) for name, part in parts.items()}

    def scatter(self, part):
        f = np.zeros((7, 3))
        np.add.at(f, self.pairs[:, 0], part)
        np.add.at(f, self.pairs[:, 1], -part)
        return f

    def K(self, x):
        d = self.d(x)
        l = np.linalg.norm(d, axis=1)
        n = d / l[:, None]
        outer = n[:, :, None] * n[:, None, :]
        blocks = {
            "axial": (self.k / self.l0)[:, None, None] * outer,
            "transverse": (self.k * (1 / self.l0 - 1 / l))[:, None, None] * (np.eye(3) - outer),
        }
        found = {}
        for name, block in blocks.items():
            matrix = np.zeros((7, 3, 7, 3))
            for (i, j), b in zip(self.pairs, block):
                for r, c, sign in ((i, i, -1), (j, j, -1), (i, j, 1), (j, i, 1)):
                    matrix[r, :, c, :] += sign * b
            found[name] = matrix.reshape(21, 21)
        return found


class Cable:
    """A cable with stretching, bending and gravity, differentiated by autograd."""

    name = "cable, autograd"

    def __init__(self, seed, s):
        rng = np.random.default_rng(seed)
        self.s = s
        self.x = (np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)]) + 0.3 * rng.normal(size=(6, 3))) * s
        self.parts = {"stretch": self.stretch, "bend": self.bend, "weight": self.weight}
        self.weights = rng.uniform(1, 3, 6)

    def stretch(self, x):
        return 30 / self.s * anp.sum((anp.sqrt(anp.sum((x[1:] - x[:-1]) ** 2, axis=1)) - 0.9 * self.s) ** 2)

    def bend(self, x):
        a, b = x[1:-1] - x[:-2], x[2:] - x[1:-1]
        cosine = anp.sum(a * b, axis=1) / anp.sqrt(anp.sum(a * a, axis=1) * anp.sum(b * b, axis=1))
        return 5 * self.s * anp.sum(1 - cosine)

    def weight(self, x):
        return anp.sum(self.weights * x[:, 1])

    def energy(self, x):
        return sum(part(x) for part in self.parts.values())

    def force(self, x):
        return {name: -autograd.grad(part)(x) for name, part in self.parts.items()}

    def K(self, x):
        return {name: -autograd.hessian(self.parts[name])(x).reshape(18, 18) for name in ("stretch", "bend")}


class Hinge:
    """A hinge of two triangles with a rest angle; the second derivatives of the angle by complex steps."""

    name = "hinge"

    def __init__(self, seed, s):
        rng = np.random.default_rng(seed)
        self.s = s
        self.x = (np.array([[0, 0, 0], [1, 0, 0], [0.4, 1, 0.1], [0.6, -0.8, 0.5]]) + 0.1 * rng.normal(size=(4, 3))) * s
        self.rest = self.angle(self.x) - 0.4
        self.k = 3.0 * s

    @staticmethod
    def angle(x):
        e = x[1] - x[0]
        a, b = np.cross(e, x[2] - x[0]), np.cross(x[3] - x[0], e)
        return np.arctan2(np.cross(a, b) @ e / np.linalg.norm(e), a @ b)

    @staticmethod
    def slopes(x):
        """The parts of the gradient of the angle over the ends of the edge and over the tips."""
        e = x[1] - x[0]
        l = np.sqrt(np.sum(e * e))
        a, b = np.cross(e, x[2] - x[0]), np.cross(x[3] - x[0], e)
        a, b = a / np.sum(a * a), b / np.sum(b * b)
        tips, edge = np.zeros_like(x), np.zeros_like(x)
        tips[2], tips[3] = -l * a, -l * b
        edge[0] = -(np.sum((x[2] - x[1]) * e) * a + np.sum((x[3] - x[1]) * e) * b) / l
        edge[1] = np.sum((x[2] - x[0]) * e) * a / l + np.sum((x[3] - x[0]) * e) * b / l
        return {"edge": edge, "tips": tips}

    def energy(self, x):
        return 0.5 * self.k * (self.angle(x) - self.rest) ** 2

    def force(self, x):
        moment = -self.k * (self.angle(x) - self.rest)
        return {name: moment * slope for name, slope in self.slopes(x).items()}

    def K(self, x):
        slope = sum(self.slopes(x).values()).ravel()
        columns = []
        for index in range(12):
            moved = x.astype(complex)
            moved.ravel()[index] += 1e-30j * self.s
            columns.append(sum(self.slopes(moved).values()).imag.ravel() / (1e-30 * self.s))
        curved = -self.k * (self.angle(x) - self.rest) * np.array(columns).T
        return {"slopes": -self.k * np.outer(slope, slope), "curvature": 0.5 * (curved + curved.T)}


class Tetrahedron:
    """A neo-Hookean tetrahedron."""

    name = "neo-Hookean tetrahedron"

    def __init__(self, seed, s):
        rng = np.random.default_rng(seed)
        rest = (np.vstack([np.zeros(3), np.eye(3)]) + 0.1 * rng.normal(size=(4, 3))) * s
        self.x = rest + 0.12 * s * rng.normal(size=(4, 3))
        edges = (rest[1:] - rest[0]).T
        self.inverse, self.volume = np.linalg.inv(edges), abs(np.linalg.det(edges)) / 6
        self.mu, self.lame = 20 / s**2, 35 / s**2
        self.shape = np.vstack([-self.inverse.sum(axis=0), self.inverse])

    def F(self, x):
        return x.T @ self.shape

    @staticmethod
    def log(F):
        volume = np.linalg.det(F)
        return np.log(volume) if volume > 0 else np.nan

    def energy(self, x):
        F = self.F(x)
        log = self.log(F)
        return self.volume * (self.mu / 2 * (np.sum(F * F) - 3) - self.mu * log + self.lame / 2 * log**2)

    def force(self, x):
        F = self.F(x)
        back = np.linalg.inv(F).T
        stress = {"shear": self.mu * F, "pressure": -self.mu * back, "volume": self.lame * self.log(F) * back}
        return {name: -self.volume * self.shape @ P.T for name, P in stress.items()}

    def K(self, x):
        F = self.F(x)
        log, back = self.log(F), np.linalg.inv(F).T
        turned = np.einsum("iL,kJ->iJkL", back, back)
        tangent = {
            "shear": self.mu * np.einsum("ik,JL->iJkL", np.eye(3), np.eye(3)),
            "inverse": (self.mu - self.lame * log) * turned,
            "volume": self.lame * np.einsum("iJ,kL->iJkL", back, back),
        }
        return {name: -self.volume * np.einsum("aJ,iJkL,bL->aibk", self.shape, T, self.shape).reshape(12, 12) for name, T in tangent.items()}


class Contact:
    """Points that are pressed into a sphere and a floor, by penalties; some touch, some do not."""

    name = "contact penalty"

    def __init__(self, seed, s):
        rng = np.random.default_rng(seed)
        way = rng.normal(size=(8, 3))
        way /= np.linalg.norm(way, axis=1)[:, None]
        self.r, self.k, self.floor = s, 50 / s, -0.3 * s
        self.x = way * s * np.where(np.arange(8) % 4 < 3, rng.uniform(0.7, 0.95, 8), rng.uniform(1.1, 1.3, 8))[:, None]

    def parts(self, x):
        l = np.linalg.norm(x, axis=1)
        return l, np.maximum(0, self.r - l), np.maximum(0, self.floor - x[:, 1])

    def energy(self, x):
        _, sphere, floor = self.parts(x)
        return 0.5 * self.k * (np.sum(sphere**2) + np.sum(floor**2))

    def force(self, x):
        l, sphere, floor = self.parts(x)
        up = np.zeros_like(x)
        up[:, 1] = self.k * floor
        return {"sphere": self.k * (sphere / l)[:, None] * x, "floor": up}

    def K(self, x):
        l, sphere, floor = self.parts(x)
        found = {name: np.zeros((8, 3, 8, 3)) for name in ("normal", "tangential", "floor")}
        for p in range(8):
            n = np.outer(x[p], x[p]) / l[p] ** 2
            found["normal"][p, :, p, :] = -self.k * (sphere[p] > 0) * n
            found["tangential"][p, :, p, :] = self.k * sphere[p] / l[p] * (np.eye(3) - n)
            found["floor"][p, 1, p, 1] = -self.k * (floor[p] > 0)
        return {name: matrix.reshape(24, 24) for name, matrix in found.items()}


MODELS = [Net, Cable, Hinge, Tetrahedron, Contact]


def total(terms):
    return sum(terms.values())


def entry(array):
    """An entry that is neither zero nor the largest."""
    size = np.sort(abs(array[array != 0]).ravel())
    return np.unravel_index(np.argmin(abs(abs(array) - size[len(size) // 2])), array.shape)


def changed(place, factor):
    def fault(array):
        array = array.copy()
        array[place(array)] *= factor
        return array

    return fault


def exchanged(array, a, b):
    array = array.copy()
    array[[a, b]] = array[[b, a]]
    return array


def faults_of(model):
    """Names and functions of a force and a K, by turns of both kinds."""
    force, K = model.force(model.x), model.K(model.x)
    found = []

    def add(name, of_force=None, of_K=None):
        found.append((name, (lambda f: f) if of_force is None else of_force, (lambda K: K) if of_K is None else of_K))

    def of_term(key, factor):
        return lambda terms: {**terms, key: factor * terms[key]}

    for factor, words in ((-1.0, "wrong sign"), (0.0, "missing"), (1.01, "1 % too large")):
        for key in force:
            add(f"force, {key}: {words}", of_force=of_term(key, factor))
        for key in K:
            add(f"K, {key}: {words}", of_K=of_term(key, factor))
    on_total = lambda change: lambda terms: {"total": change(total(terms))}
    add("force: one entry lost", of_force=on_total(changed(entry, 0.0)))
    add("K: one entry lost", of_K=on_total(changed(entry, 0.0)))
    add("force: two particles exchanged", of_force=on_total(lambda f: exchanged(f, 1, 2)))
    add("K: two rows exchanged", of_K=on_total(lambda K: exchanged(K, 3, 4)))
    add("force: two axes exchanged", of_force=on_total(lambda f: f[:, [1, 0, 2]]))
    add("K: a row shifted by one", of_K=on_total(lambda K: np.vstack([np.roll(K[:1], 1, axis=1), K[1:]])))
    add("force: one entry 1 % too large", of_force=on_total(changed(entry, 1.01)))
    add("K: one entry 1 % too large", of_K=on_total(changed(entry, 1.01)))
    add("force: off by the factor 2", of_force=on_total(lambda f: 2 * f))
    add("K: off by the factor 1/2", of_K=on_total(lambda K: 0.5 * K))
    add("K: one entry of wrong sign", of_K=on_total(changed(entry, -1.0)))
    # Faults that change nothing where a term vanishes or an entry is its own image are none.
    sound = []
    for name, of_force, of_K in found:
        moved = [abs(total(change(terms)) - total(terms)).max() / abs(total(terms)).max() for change, terms in ((of_force, force), (of_K, K))]
        if max(moved) > 1e-5:
            sound.append((name, of_force, of_K))
    assert len(sound) >= FAULTS, (model.name, len(sound))
    return sound[-FAULTS:]


def relative(found, expected, tolerance):
    return np.linalg.norm(found - expected) <= tolerance * np.linalg.norm(expected)


def differences(function, x, step, central):
    """The Jacobian by differences with a fixed step."""
    x = x.ravel()
    columns = []
    for index in range(x.size):
        ahead, behind = x.copy(), x.copy()
        ahead[index] += step
        behind[index] -= step if central else 0.0
        columns.append((np.ravel(function(ahead)) - np.ravel(function(behind))) / (ahead[index] - behind[index]))
    return np.array(columns).T


def judged(model, of_force=lambda terms: terms, of_K=lambda terms: terms):
    """Which checks accept a force and a K."""
    x = model.x
    shaped = lambda function: lambda flat: function(flat.reshape(x.shape))
    energy = shaped(model.energy)
    force = shaped(lambda x: total(of_force(model.force(x))))
    gradient, K = -np.ravel(force(x.ravel())), total(of_K(model.K(x)))
    accepted = {"sprung": bool(sprung.check_hessian(energy, lambda x: force(x).ravel(), K, x.ravel()))}
    # The function of scipy is for gradients: of K along one direction of forces.
    along = np.random.default_rng(0).normal(size=x.size)
    error = [
        scipy.optimize.check_grad(energy, lambda _: gradient, x.ravel()),
        scipy.optimize.check_grad(lambda flat: along @ np.ravel(force(flat)), lambda _: along @ K, x.ravel()),
    ]
    sizes = [np.linalg.norm(gradient), np.linalg.norm(along @ K)]
    accepted["scipy check_grad, 1e-6"] = all(e <= 1e-6 for e in error)
    accepted["scipy check_grad, 1e-6 relative"] = all(e <= 1e-6 * size for e, size in zip(error, sizes))
    pairs = lambda step, central: (
        (differences(energy, x, step, central)[0], gradient),
        (differences(force, x, step, central), K),
    )
    accepted["ε = 1e-6 central, 1e-5 + 1e-3 g"] = all(
        (abs(a - b) <= 1e-5 + 1e-3 * abs(b)).all() for a, b in pairs(1e-6, True)
    )
    accepted["ε = 1e-6 central, 1e-5 relative"] = all(relative(a, b, 1e-5) for a, b in pairs(1e-6, True))
    accepted["ε = 1e-9 forward, 1e-5 relative"] = all(relative(a, b, 1e-5) for a, b in pairs(1e-9, False))
    return accepted


def main():
    right: dict[str, list] = {}
    for make in MODELS:
        for s in SCALES:
            for seed in SEEDS:
                for check, passed in judged(make(seed, s)).items():
                    right.setdefault(check, []).append((passed, make.name, s, seed))
    caught: dict[tuple, list] = {}
    for make in MODELS:
        for s in (1e-3, 1.0, 1e3):
            model = make(11, s)
            for name, of_force, of_K in faults_of(model):
                for check, passed in judged(model, of_force, of_K).items():
                    caught.setdefault((check, s), []).append((not passed, f"{make.name}: {name}"))
    count = len(right["sprung"])
    lines = [
        "# Derivative checks on models of others",
        "",
        f"Written by `python verification/derivative_checks.py --write` on {datetime.date.today()}. Five force models that are not of this library (a spring net, a cable",
        "differentiated by autograd, a hinge, a neo-Hookean tetrahedron, contact penalties), each right, and each with twenty planted faults: terms of a force or of",
        "K = ∂f/∂x with a wrong sign, missing or 1 % too large; entries, particles, rows and axes lost, exchanged or shifted.",
        "",
        f"*False alarms* are on the right models, of {len(SCALES)} sizes from 10⁻⁶ to 10⁶ m and {len(SEEDS)} seeds: {count} cases. *Caught* are planted faults, at three sizes.",
        "`sprung` is `check_hessian`, which has no step to be chosen. Beside it are `scipy.optimize.check_grad` with its default step, for K along one random direction of",
        "forces, and differences with a fixed step ε of coordinates; the tolerance follows. The one with 1e-5 + 1e-3 g is the rule of `torch.autograd.gradcheck`.",
        "",
        "| check | false alarms | caught, 10⁻³ m | caught, 1 m | caught, 10³ m |",
        "|---|---|---|---|---|",
    ]
    for check, results in right.items():
        alarms = sum(not passed for passed, *_ in results)
        found = [caught[check, s] for s in (1e-3, 1.0, 1e3)]
        lines.append(f"| {check} | {alarms} of {count} | " + " | ".join(f"{sum(was for was, _ in f)} of {len(f)}" for f in found) + " |")
    missed = [f"{name} ({s:g} m)" for s in (1e-3, 1.0, 1e3) for was, name in caught["sprung", s] if not was]
    alarms = [f"{name}, {s:g} m, seed {seed}" for passed, name, s, seed in right["sprung"] if not passed]
    lines += ["", f"Missed by `sprung`: {'; '.join(missed) or 'none'}. False alarms of `sprung`: {'; '.join(alarms) or 'none'}.", ""]
    text = "\n".join(lines)
    print(text)
    if "--write" in sys.argv:
        Path(__file__).with_name("derivative-checks.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
