"""Mass-spring mathematics in many digits, written from the formulas alone.

Every number of a scene is taken as the double it is and converted exactly, so that a program working in doubles starts from
the very same problem. Per spring (i, j), with d = x_i - x_j, l = |d|, n = d / l:

    elastic force     f_i = -k (l/l0 - 1) n,            f_j = -f_i
    elastic energy    U   = k (l - l0)^2 / (2 l0)       (f_i = -dU/dx_i)
    damping force     f_i = -b n n^T (v_i - v_j),       f_j = -f_i
    stiffness block   K^s = k (1/l0 - 1/l) (I - n n^T) + (k/l0) n n^T

K^s is the derivative of -f_i with respect to d: with f_i = -(k/l0) d + k d/l and the derivative of d/l being (I - n n^T)/l,
-df_i = (k/l0) I - (k/l)(I - n n^T); splitting I into I - n n^T and n n^T gives the form above.

The matrices have the signs K = df_el/dx and G = df_d/dv, so a spring adds -K^s (or -b n n^T) to its two diagonal blocks and
+K^s (or +b n n^T) to the two off-diagonal ones. The three stiffness options:

    full      K^s as it is
    tension   without the transverse term k (1/l0 - 1/l)(I - n n^T) where l < l0
    axial     without it always
"""

from dataclasses import dataclass

from mpmath import mp, mpf

mp.dps = 50

AXES = "xyz"
OPTIONS = ("full", "tension", "axial")


# ---------------------------------------------------------------- one spring

def sub(a, b):
    return [p - q for p, q in zip(a, b)]


def dot(a, b):
    return mp.fsum(p * q for p, q in zip(a, b))


def norm(a):
    return mp.sqrt(dot(a, a))


def outer(a, b):
    return [[p * q for q in b] for p in a]


def times(matrix, vector):
    return [dot(row, vector) for row in matrix]


def direction(xi, xj):
    """Length l and unit vector n from x_j to x_i."""
    d = sub(xi, xj)
    l = norm(d)
    return l, [c / l for c in d]


def elastic_force(xi, xj, k, l0):
    """Force on end i (N)."""
    l, n = direction(xi, xj)
    return [-k * (l / l0 - 1) * c for c in n]


def elastic_energy(xi, xj, k, l0):
    l, _ = direction(xi, xj)
    return k * (l - l0) ** 2 / (2 * l0)


def damping_block(xi, xj, b):
    """b n n^T, so that f_i = -(b n n^T)(v_i - v_j)."""
    _, n = direction(xi, xj)
    return [[b * c for c in row] for row in outer(n, n)]


def damping_force(xi, xj, vi, vj, b):
    """Force on end i (N)."""
    return [-c for c in times(damping_block(xi, xj, b), sub(vi, vj))]


def stiffness_block(xi, xj, k, l0, option):
    """K^s under an option (N/m)."""
    l, n = direction(xi, xj)
    keeps_transverse = option == "full" or (option == "tension" and l >= l0)
    transverse = k * (1 / l0 - 1 / l) if keeps_transverse else mpf(0)
    axial = k / l0
    return [[transverse * ((p == q) - n[p] * n[q]) + axial * n[p] * n[q] for q in range(len(n))] for p in range(len(n))]


# ---------------------------------------------------------------- a scene

def exact(value):
    """Numbers of a scene, nested as they come, as exact multiprecision numbers."""
    return [exact(v) for v in value] if isinstance(value, (list, tuple)) else mpf(value)


def spread(value, count):
    """One number for all, or one each."""
    return list(value) if isinstance(value, list) else [value] * count


@dataclass
class Motion:
    """How one prescribed coordinate moves: offset(t), rate(t)."""
    times: list
    offsets: list
    velocity: object = None

    def offset(self, t):
        if self.velocity is not None:
            return self.velocity * t
        if not self.times or t <= self.times[0]:
            return self.offsets[0] if self.offsets else mpf(0)
        for t0, t1, o0, o1 in zip(self.times, self.times[1:], self.offsets, self.offsets[1:]):
            if t <= t1:
                return o0 + (o1 - o0) * (t - t0) / (t1 - t0)
        return self.offsets[-1]

    def rate(self, t):
        """Velocity of the coordinate; of a path, on the piece that starts at or before t."""
        if self.velocity is not None:
            return self.velocity
        for t0, t1, o0, o1 in zip(self.times, self.times[1:], self.offsets, self.offsets[1:]):
            if t0 <= t < t1:
                return (o1 - o0) / (t1 - t0)
        return mpf(0)


class System:
    """A scene with its numbers made exact and its degrees of freedom numbered."""

    def __init__(self, scene):
        particles, springs = scene["particles"], scene.get("springs", {"pairs": []})
        self.positions = exact(particles["positions"])
        self.count, self.dim = len(self.positions), len(self.positions[0])
        self.velocities = exact(particles.get("velocities", [[0] * self.dim] * self.count))
        self.masses = exact(spread(particles["masses"], self.count))
        self.pairs = [tuple(p) for p in springs["pairs"]]
        m = len(self.pairs)
        self.stiffness = exact(spread(springs.get("stiffness", 0), m))
        self.damping = exact(spread(springs.get("damping", 0), m))
        if "rest_lengths" in springs:
            self.rest_lengths = exact(spread(springs["rest_lengths"], m))
        else:
            self.rest_lengths = [norm(sub(self.positions[i], self.positions[j])) for i, j in self.pairs]
        self.gravity = exact(scene.get("gravity", [0] * self.dim))
        self.dt = mpf(scene["time"]["dt"]) if "time" in scene else None

        self.motions = {}
        for entry in scene.get("constraints", []):
            for particle in entry["particles"]:
                for axis in entry.get("axes", list(AXES[: self.dim])):
                    self.motions[particle, AXES.index(axis)] = self._motion(entry, AXES.index(axis))
        self.free = [(p, a) for p in range(self.count) for a in range(self.dim) if (p, a) not in self.motions]
        self.held = sorted(self.motions)

    @staticmethod
    def _motion(entry, axis):
        if "velocity" in entry:
            return Motion([], [], mpf(entry["velocity"][axis]))
        if "path" in entry:
            return Motion(exact(entry["path"]["times"]), [mpf(o[axis]) for o in entry["path"]["offsets"]])
        return Motion([], [])

    def index(self, dof):
        return dof[0] * self.dim + dof[1]

    # ---- sums over springs, flat vectors over all coordinates

    def _scatter(self, per_spring):
        total = [[mpf(0)] * self.dim for _ in range(self.count)]
        for s, (i, j) in enumerate(self.pairs):
            for a, c in enumerate(per_spring(s, i, j)):
                total[i][a] += c
                total[j][a] -= c
        return [c for row in total for c in row]

    def elastic_forces(self, x):
        return self._scatter(lambda s, i, j: elastic_force(x[i], x[j], self.stiffness[s], self.rest_lengths[s]))

    def damping_forces(self, x, v):
        return self._scatter(lambda s, i, j: damping_force(x[i], x[j], v[i], v[j], self.damping[s]))

    def gravity_forces(self):
        return [m * g for m in self.masses for g in self.gravity]

    def forces(self, x, v):
        return [a + b + c for a, b, c in zip(self.elastic_forces(x), self.damping_forces(x, v), self.gravity_forces())]

    def energies(self, x, v):
        """Kinetic, elastic and gravitational energy, the last one -sum m gravity . x."""
        return {
            "kinetic": mp.fsum(m * dot(w, w) / 2 for m, w in zip(self.masses, v)),
            "elastic": mp.fsum(elastic_energy(x[i], x[j], self.stiffness[s], self.rest_lengths[s])
                               for s, (i, j) in enumerate(self.pairs)),
            "gravitational": -mp.fsum(m * dot(self.gravity, p) for m, p in zip(self.masses, x)),
        }

    # ---- matrices over all coordinates

    def _assemble(self, per_spring):
        size, dim = self.count * self.dim, self.dim
        matrix = mp.zeros(size)
        for s, (i, j) in enumerate(self.pairs):
            block = per_spring(s, i, j)
            for p in range(dim):
                for q in range(dim):
                    for a, b, sign in ((i, i, -1), (j, j, -1), (i, j, 1), (j, i, 1)):
                        matrix[a * dim + p, b * dim + q] += sign * block[p][q]
        return matrix

    def K(self, x, option="full"):
        return self._assemble(lambda s, i, j: stiffness_block(x[i], x[j], self.stiffness[s], self.rest_lengths[s], option))

    def G(self, x):
        return self._assemble(lambda s, i, j: damping_block(x[i], x[j], self.damping[s]))

    def M(self):
        return mp.diag([m for m in self.masses for _ in range(self.dim)])

    def A(self, x, dt, option):
        return self.M() / dt ** 2 - self.G(x) / dt - self.K(x, option)

    def S(self, x, dt, option):
        """4M/dt^2 - 2G/dt - 2K_option + K: positive semidefinite exactly where a stable equilibrium is kept stable."""
        return 4 * self.M() / dt ** 2 - 2 * self.G(x) / dt - 2 * self.K(x, option) + self.K(x)

    def restrict(self, matrix, rows=None, columns=None):
        rows = self.free if rows is None else rows
        columns = self.free if columns is None else columns
        out = mp.zeros(len(rows), len(columns))
        for r, p in enumerate(rows):
            for c, q in enumerate(columns):
                out[r, c] = matrix[self.index(p), self.index(q)]
        return out

    def rows(self, flat):
        """A flat vector as one row a particle."""
        return [list(flat[p * self.dim:(p + 1) * self.dim]) for p in range(self.count)]


# ---------------------------------------------------------------- definiteness

def cholesky_succeeds(matrix):
    """Whether a symmetric matrix is positive definite, by elimination without pivoting."""
    a = matrix.copy()
    n = a.rows
    for k in range(n):
        if a[k, k] <= 0:
            return False
        for i in range(k + 1, n):
            if a[i, k]:
                r = a[i, k] / a[k, k]
                for j in range(k + 1, i + 1):
                    a[i, j] -= r * a[j, k]
    return True


def eigenvalues(matrix):
    """Eigenvalues of a symmetric matrix, ascending."""
    return sorted(mp.eigsy(matrix, eigvals_only=True))


def inertia(matrix, values=None):
    """Counts of negative, zero and positive eigenvalues; zero is what 30 digits cannot tell from it."""
    values = eigenvalues(matrix) if values is None else values
    cut = max(abs(v) for v in values) * mpf(10) ** -30
    negative = sum(v < -cut for v in values)
    positive = sum(v > cut for v in values)
    return {"negative": negative, "zero": len(values) - negative - positive, "positive": positive}


def largest_definite_step(matrix_of_dt, high=mpf(10) ** 8):
    """End of the interval (0, dt) on which matrix_of_dt(dt) is positive definite, to 40 digits; None where it has no end.

    u^T A(dt) u falls as dt grows, for every u, so the definite steps are an interval and bisection finds its end."""
    if cholesky_succeeds(matrix_of_dt(high)):
        return None
    low = high
    while not cholesky_succeeds(matrix_of_dt(low)):
        low /= 4
    high = 4 * low
    while high - low > high * mpf(10) ** -40:
        middle = (low + high) / 2
        if cholesky_succeeds(matrix_of_dt(middle)):
            low = middle
        else:
            high = middle
    return (low + high) / 2
