"""The taut chain: its frequencies, what linearised backward Euler does to each mode, and where the option axial stops being stable.

N equal masses between two walls, N + 1 equal springs stretched from l0 to l, at rest. The second difference of N masses between
walls has the eigenvectors sin(i j pi/(N+1)) and the eigenvalues 2 - 2 cos(j pi/(N+1)) = 4 sin^2(j pi/(2(N+1))), so along and across
the chain

    omega_j = 2 sqrt(kappa/m) sin(j pi/(2(N+1))),      kappa = k/l0 along,  k (1/l0 - 1/l) across.

One mode, q'' = -omega^2 q, in a step of linearised backward Euler with the exact stiffness: with z = omega dt, v+ = (v - z omega
q)/(1 + z^2) and omega q+ = (omega q + z v)/(1 + z^2): the pair (omega q, v) is turned by atan z and shrunk by 1/sqrt(1 + z^2), so
the energy by 1/(1 + z^2). Along the chain the springs are linear, so that holds for any amplitude and every option; across it holds
in the limit of small amplitude, and for full and tension only. Under axial the transverse part is missing from the matrix: v+ = v -
z omega q, q+ = q + dt v+, symplectic Euler, whose characteristic polynomial g^2 - (2 - z^2) g + 1 has a root beyond the unit circle
exactly where z > 2: stable up to dt = 2/omega_max.

Every frequency is held to the eigenvalues of M^(-1/2) (-K) M^(-1/2) of the assembled matrices, and every limit to bisection on the
definiteness of S = 4M/dt^2 - 2G/dt - 2K_option + K. The irregular chain has unequal masses and springs and knows only bisection and
eigenvalues.
"""

from mpmath import mp, mpf

import answers
import linear_backward_euler
from springs import OPTIONS, System, eigenvalues, largest_definite_step


def chain(label, n, dim=3, l=0.75, l0=0.5, k=60.0, m=0.0625, b=0.0, dt=0.02):
    return {
        "name": label,
        "particles": {"positions": [[l * p] + [0.0] * (dim - 1) for p in range(n + 2)], "masses": m},
        "springs": {"pairs": [[p, p + 1] for p in range(n + 1)], "stiffness": k, "rest_lengths": l0, "damping": b},
        "constraints": [{"particles": [0, n + 1]}],
        "time": {"dt": dt, "duration": 20 * dt},
    }


def spectrum(system):
    """Eigenvalues omega^2 of the free motion at the initial state."""
    k = -system.restrict(system.K(system.positions))
    root = [mp.sqrt(system.masses[p]) for p, _ in system.free]
    return eigenvalues(mp.matrix([[k[i, j] / (root[i] * root[j]) for j in range(k.cols)] for i in range(k.rows)]))


def limits(system):
    return {option: largest_definite_step(lambda dt: system.restrict(system.S(system.positions, dt, option))) for option in OPTIONS}


def modes(system, n, kind, kappa, m, dt):
    rows = []
    for j in range(1, n + 1):
        omega = 2 * mp.sqrt(kappa / m) * mp.sin(j * mp.pi / (2 * (n + 1)))
        z = omega * dt
        rows.append({"mode": j, "omega": omega, "z": z, "energy_factor": 1 / (1 + z ** 2), "amplitude_factor": 1 / mp.sqrt(1 + z ** 2),
                     "phase": mp.atan(z), "shape": [mp.sin(i * j * mp.pi / (n + 1)) for i in range(1, n + 1)]})
    return rows


def regular(label, n, **given):
    scene = chain(label, n, **given)
    system = System(scene)
    k, l0, m = system.stiffness[0], system.rest_lengths[0], system.masses[0]
    l = system.positions[1][0] - system.positions[0][0]
    along, across = k / l0, k * (1 / l0 - 1 / l)
    axial, transverse = (modes(system, n, kind, kappa, m, system.dt) for kind, kappa in (("axial", along), ("transverse", across)))
    closed = sorted([r["omega"] ** 2 for r in axial] + [r["omega"] ** 2 for r in transverse] * (system.dim - 1))
    for a, b in zip(closed, spectrum(system), strict=True):
        answers.close(a, b)
    stable = limits(system)
    assert stable["full"] is None and stable["tension"] is None
    answers.close(stable["axial"], 2 / transverse[-1]["omega"])
    return {"name": label, "kind": "modes", "scene": scene, "dt": system.dt, "kappa_axial": along, "kappa_transverse": across,
            "axial_modes": axial, "transverse_modes": transverse, "stable_dt": stable}


def irregular(dim):
    """Unequal everything; the tension is 30 N in every spring, k_s = 30/(l_s/l0_s - 1), so it is at rest to rounding."""
    lengths, strains = [0.75, 0.5, 1.25, 1.0, 0.625, 0.875], [0.5, 0.25, 0.75, 1.0, 0.375, 0.625]
    positions = [[0.0] * dim]
    for l in lengths:
        positions.append([positions[-1][0] + l] + [0.0] * (dim - 1))
    scene = {
        "name": "irregular taut chain",
        "particles": {"positions": positions, "masses": [1.0, 0.07, 0.11, 0.05, 0.16, 0.09, 1.0]},
        "springs": {"pairs": [[p, p + 1] for p in range(6)], "stiffness": [30.0 / e for e in strains],
                    "rest_lengths": [l / (1 + e) for l, e in zip(lengths, strains)], "damping": [0.3, 0.1, 0.2, 0.0, 0.4, 0.15]},
        "constraints": [{"particles": [0, 6]}],
        "time": {"dt": 0.02, "duration": 0.4},
    }
    system = System(scene)
    return {"name": f"irregular chain, {dim} axes", "kind": "spectrum", "scene": scene, "dt": system.dt,
            "omegas_undamped": [mp.sqrt(w) for w in spectrum(system)], "stable_dt": limits(system)}


def axial_run(j, amplitude=0.125, n=5, steps=12):
    """A chain let go in one axial mode: every option, the energy above rest falling by 1/(1 + z^2) a step."""
    scene = chain(f"axial mode {j}", n)
    for i in range(1, n + 1):
        scene["particles"]["positions"][i][0] = answers.double(mpf(scene["particles"]["positions"][i][0]) + amplitude * mp.sin(i * j * mp.pi / (n + 1)))
    system = System(scene)
    k, l0, m = system.stiffness[0], system.rest_lengths[0], system.masses[0]
    omega = 2 * mp.sqrt(k / l0 / m) * mp.sin(j * mp.pi / (2 * (n + 1)))
    rest = (n + 1) * k * (mpf(0.75) - l0) ** 2 / (2 * l0)
    runs = {option: linear_backward_euler.run(scene, option, steps) for option in OPTIONS}
    energies = [mp.fsum(system.energies(*state).values()) - rest for state in runs["full"]]
    for first, second in zip(energies, energies[1:]):
        answers.close(second / first, 1 / (1 + (omega * system.dt) ** 2), mpf(10) ** -14)       # the mode is one to rounding of the scene
    for option in OPTIONS:
        answers.close_rows(runs[option][-1][0], runs["full"][-1][0])
    x, v = runs["full"][-1]
    return {"name": f"let go in axial mode {j}", "kind": "run", "scene": scene, "dt": system.dt, "steps": steps, "omega": omega,
            "energy_factor": 1 / (1 + (omega * system.dt) ** 2), "energy_at_rest": rest, "energies_above_rest": energies,
            "positions": answers.settle(x), "velocities": answers.settle(v)}


def transverse_growth(n=5):
    """How fast the highest transverse mode grows under axial beyond its limit: the larger root of g^2 - (2 - z^2) g + 1."""
    rows = []
    system = System(chain("", n))
    k, l0, m = system.stiffness[0], system.rest_lengths[0], system.masses[0]
    omega = 2 * mp.sqrt(k * (1 / l0 - 1 / mpf(0.75)) / m) * mp.sin(n * mp.pi / (2 * (n + 1)))
    for z in (0.5, 1.0, 1.9, 1.999, 2.001, 2.1, 2.5, 3.0):
        trace = 2 - mpf(z) ** 2
        modulus = mpf(1) if z <= 2 else (abs(trace) + mp.sqrt(trace ** 2 - 4)) / 2
        rows.append({"z": z, "dt": z / omega, "spectral_radius": modulus})
    return {"name": "highest transverse mode under axial", "kind": "growth", "scene": chain("taut chain", n), "stiffness": "axial",
            "omega_max_transverse": omega, "limit": 2 / omega, "rows": rows}


def transverse_run(option, steps=8, n=5, dt=0.02):
    """Plucked across with a visible amplitude, so nonlinear: the iterates themselves, as a check of whole steps of a prestressed scene."""
    scene = chain("plucked taut chain", n, b=0.05, dt=dt)
    for i, (y, z) in enumerate([(0.0625, 0.0), (0.125, -0.03125), (0.1875, 0.0625), (0.0, 0.03125), (-0.0625, 0.0)], start=1):
        scene["particles"]["positions"][i][1:] = [y, z]
    x, v = linear_backward_euler.run(scene, option, steps)[-1]
    return {"name": f"plucked, {option}", "kind": "run", "scene": scene, "stiffness": option, "dt": mpf(dt), "steps": steps,
            "positions": x, "velocities": v}


def main():
    answers.write(
        "taut_chain",
        "Frequencies of a stretched chain, the damping and phase of linearised backward Euler on its modes, and the limit of the option axial",
        "kind modes: closed forms, held to eigenvalues and to bisection in 50 digits (35 digits agree); factors are those of one "
        "step dt of the exact stiffness (full and tension; for axial_modes axial too). stable_dt: end of the interval where S = "
        "4M/dt^2 - 2G/dt - 2K_option + K is positive definite, null where it has no end. kind spectrum: by eigenvalues and "
        "bisection alone; its rest lengths are rounded, so its forces vanish to rounding. kind run: iterates of linearised "
        "backward Euler in 50 digits; without \"stiffness\" they hold for every option. kind growth: spectral radius of the mode "
        "under axial. Factors of runs in one axial mode hold to about 1e-15, because the mode is rounded to doubles.",
        [regular("chain of 5", 5), regular("chain of 5, planar", 5, dim=2), regular("chain of 12, other numbers", 12, dim=2, l=1.3125, l0=0.875, k=17.0, m=0.3, dt=0.05),
         regular("chain of 1", 1), regular("chain of 5, damped along the springs", 5, b=2.0),
         irregular(3), irregular(2), *(axial_run(j) for j in (1, 2, 5)), *(transverse_run(o) for o in OPTIONS), transverse_growth()])


if __name__ == "__main__":
    main()
