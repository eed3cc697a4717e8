"""Holds springs.py to itself by other means: numerical differentiation in 50 digits, and energy against force.

Central differences with step h err by O(h^2) and by 10^-50/h; with h = 10^-15 both stay below 10^-28 relative.
"""

from mpmath import mp, mpf

from answers import close
from one_step import tetrahedron
from springs import System, damping_force, elastic_energy, elastic_force, stiffness_block

STEP = mpf(10) ** -15
TOLERANCE = mpf(10) ** -26


def moved(rows, particle, axis, by):
    rows = [list(row) for row in rows]
    rows[particle][axis] += by
    return rows


def check_system(scene):
    system = System(scene)
    x, v = system.positions, system.velocities
    stiffness, damping, forces = system.K(x), system.G(x), system.elastic_forces(x)
    for p in range(system.count):
        for a in range(system.dim):
            column = system.index((p, a))
            up, down = moved(x, p, a, STEP), moved(x, p, a, -STEP)
            for row, (f1, f0) in enumerate(zip(system.elastic_forces(up), system.elastic_forces(down))):
                close((f1 - f0) / (2 * STEP), stiffness[row, column], TOLERANCE * 1000)
            slope = (system.energies(up, v)["elastic"] - system.energies(down, v)["elastic"]) / (2 * STEP)
            close(-slope, forces[column], TOLERANCE * 1000)
            up, down = moved(v, p, a, STEP), moved(v, p, a, -STEP)
            for row, (f1, f0) in enumerate(zip(system.damping_forces(x, up), system.damping_forces(x, down))):
                close((f1 - f0) / (2 * STEP), damping[row, column], TOLERANCE * 1000)


def check_eigenvalues():
    """K^s of one spring has k/l0 once and k (1/l0 - 1/l) twice."""
    xi, xj, k, l0 = [mpf(c) / 7 for c in (3, -2, 5)], [mpf(c) / 11 for c in (1, 4, -2)], mpf(130), mpf("0.7")
    l = mp.sqrt(sum((p - q) ** 2 for p, q in zip(xi, xj)))
    values = sorted(mp.eigsy(mp.matrix(stiffness_block(xi, xj, k, l0, "full")), eigvals_only=True))
    for value, expected in zip(values, sorted([k / l0, k * (1 / l0 - 1 / l), k * (1 / l0 - 1 / l)])):
        close(value, expected)


def main():
    check_eigenvalues()
    check_system(tetrahedron())
    print("springs.py: K, G and f agree with differences of f_el, f_d and U")


if __name__ == "__main__":
    main()
