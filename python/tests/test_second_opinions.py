"""The same motions by other programs: scipy on equations of motion written again, and MuJoCo with springs as tendons."""

from __future__ import annotations

import numpy as np
import pytest
import sprung
from scipy import integrate, optimize

pytestmark = pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")

GRAVITY = np.array([0.0, -9.81, 0.5])


def parts(particles: int, stiffness: float, damping: float):
    """A chain that hangs from its first particle and begins aside: positions, pairs, masses, k, l0, b."""
    rng = np.random.default_rng(particles)
    positions = np.cumsum(np.vstack([np.zeros(3), rng.uniform(0.3, 0.6, (particles - 1, 3)) * [1, 0.3, 0.5]]), axis=0)
    pairs = np.array([[p, p + 1] for p in range(particles - 1)] + [[p, p + 2] for p in range(0, particles - 2, 2)])
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    masses = rng.uniform(0.5, 1.5, particles)
    return positions, pairs, masses, stiffness * rng.uniform(0.5, 1.0, len(pairs)), lengths * 0.95, np.full(len(pairs), damping)


def system_of(positions, pairs, masses, stiffness, rest, damping) -> sprung.System:
    return sprung.System(
        positions, pairs, masses=masses, stiffness=stiffness, rest_lengths=rest, damping=damping, gravity=GRAVITY,
        constraints=[sprung.Constraint(0)], name="chain",
    )


def forces(x, v, pairs, masses, stiffness, rest, damping):
    """Of springs, dampers and weight, from tensions."""
    total = masses[:, None] * GRAVITY
    d, w = x[pairs[:, 0]] - x[pairs[:, 1]], v[pairs[:, 0]] - v[pairs[:, 1]]
    length = np.sqrt((d**2).sum(1))
    n = d / length[:, None]
    tension = stiffness * (length / rest - 1) + damping * (n * w).sum(1)
    np.add.at(total, pairs[:, 0], -tension[:, None] * n)
    np.add.at(total, pairs[:, 1], tension[:, None] * n)
    return total


def by_scipy(duration, method, rtol, positions, pairs, masses, *springs):
    count = positions.size

    def rate(_, y):
        x, v = y.reshape(2, -1, 3)
        acceleration = forces(x, v, pairs, masses, *springs) / masses[:, None]
        acceleration[0] = 0
        return np.concatenate([v.ravel(), acceleration.ravel()])

    start = np.concatenate([positions.ravel(), np.zeros(count)])
    found = integrate.solve_ivp(rate, (0, duration), start, method=method, rtol=rtol, atol=0.1 * rtol)
    assert found.success
    return found.y[:count, -1].reshape(-1, 3)


def error(found, known):
    return np.linalg.norm(found - known) / np.linalg.norm(known - known.mean(0))


# The error that a method of this order and step leaves in the motion; far more than that of scipy.
@pytest.mark.parametrize(
    ("method", "options", "allowed"),
    [
        ("dop853", {"rtol": 1e-12}, 1e-9),
        ("rodas4", {"rtol": 1e-9}, 1e-5),
        ("verlet", {"dt": 1e-4}, 1e-5),
        ("implicit-midpoint", {"dt": 1e-3}, 2e-4),
        ("bdf2", {"dt": 1e-3}, 1e-3),
        ("linear-backward-euler", {"dt": 1e-4}, 5e-3),
    ],
)
def test_a_swinging_chain_is_where_scipy_has_it(method, options, allowed):
    chain = parts(7, 200.0, 0.5)
    known = by_scipy(1.0, "DOP853", 3e-13, *chain)
    assert error(chain[0], known) > 0.5, "it moves"
    found = sprung.Stepper(system_of(*chain), method=method).run(1.0, **options)
    assert error(found.state.positions, known) < allowed


def test_a_stiff_chain_is_where_the_implicit_method_of_scipy_has_it():
    chain = parts(5, 1e6, 40.0)
    known = by_scipy(0.5, "Radau", 1e-8, *chain)
    found = sprung.Stepper(system_of(*chain), method="rodas4").run(0.5, rtol=1e-8)
    assert error(found.state.positions, known) < 1e-5


def test_an_equilibrium_is_a_root_for_scipy():
    positions, pairs, masses, *springs = parts(6, 300.0, 0.0)

    def left(x):
        x = np.vstack([positions[:1], x.reshape(-1, 3)])
        return forces(x, np.zeros_like(x), pairs, masses, *springs)[1:].ravel()

    found = sprung.equilibrium(system_of(positions, pairs, masses, *springs))
    known = optimize.root(left, found.positions[1:].ravel() + 0.01, tol=1e-13)
    assert known.success and found.status == "stable"
    assert error(found.positions[1:], known.x.reshape(-1, 3)) < 1e-9


def by_mujoco(mujoco, duration, steps, positions, pairs, masses, stiffness, rest, damping):
    """Bodies on three slides, springs as spatial tendons between their origins."""
    spec = mujoco.MjSpec()
    spec.option.gravity = GRAVITY
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = duration / steps
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    for number, (place, mass) in enumerate(zip(positions, masses)):
        body = spec.worldbody.add_body(name=f"b{number}", pos=place)
        body.add_site(name=f"s{number}")
        if number > 0:
            body.mass, body.inertia, body.explicitinertial = mass, [mass] * 3, True
            for axis in np.eye(3):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    for number, (i, j) in enumerate(pairs):
        tendon = spec.add_tendon(name=f"t{number}", springlength=[rest[number]] * 2)
        tendon.wrap_site(f"s{i}")
        tendon.wrap_site(f"s{j}")
    model = spec.compile()
    model.tendon_stiffness[:] = (stiffness / rest)[:, None] if model.tendon_stiffness.ndim > 1 else stiffness / rest
    model.tendon_damping[:] = damping[:, None] if model.tendon_damping.ndim > 1 else damping
    data = mujoco.MjData(model)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return np.vstack([positions[:1], positions[1:] + data.qpos.reshape(-1, 3)])


def test_a_swinging_chain_is_where_mujoco_has_it():
    mujoco = pytest.importorskip("mujoco")
    chain = parts(7, 200.0, 0.5)
    coarse, fine = (by_mujoco(mujoco, 1.0, steps, *chain) for steps in (1000, 2000))
    found = sprung.Stepper(system_of(*chain), method="dop853").run(1.0, rtol=1e-12).state.positions
    # Fourth order: what the finer steps leave is a sixteenth of what the coarser ones do.
    assert error(found, fine) < 1e-7
    assert error(found, fine) < 0.2 * error(found, coarse) + 1e-10


def growth(step, states, segments, aside):
    """The mean rate at which neighbouring motions part, of each of many (Benettin and others, Meccanica 15, 1980): the distance is scaled back to
    ``aside`` after each segment. ``step`` advances an array of states, one a row, by a segment of half a second."""
    rng = np.random.default_rng(5)
    away = rng.normal(size=states.shape)
    away *= aside / np.linalg.norm(away, axis=1, keepdims=True)
    total = np.zeros(len(states))
    for segment in range(segments):
        after, beside = step(states), step(states + away)
        away = beside - after
        distance = np.linalg.norm(away, axis=1, keepdims=True)
        # The first two seconds turn the distance into the direction that grows.
        total += np.log(distance / aside)[:, 0] * (segment >= 4)
        states, away = after, away * (aside / distance)
    return total / (0.5 * (segments - 4))


def swung(states):
    """Half a second of double pendulums with rigid rods of 1 m and bobs of 1 kg, by angles and angular velocities."""

    def rate(y):
        a, b, p, q = y
        d, g = a - b, 9.81
        scale = 3 - np.cos(2 * d)
        first = -3 * g * np.sin(a) - g * np.sin(a - 2 * b) - 2 * np.sin(d) * (q**2 + p**2 * np.cos(d))
        second = 2 * np.sin(d) * (2 * p**2 + 2 * g * np.cos(a) + q**2 * np.cos(d))
        return np.array([p, q, first / scale, second / scale])

    y, h = states.T, 0.0025
    for _ in range(200):
        k1 = rate(y)
        k2 = rate(y + h / 2 * k1)
        k3 = rate(y + h / 2 * k2)
        k4 = rate(y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return y.T


def test_double_pendulums_are_as_chaotic_as_with_rigid_rods():
    """The Lyapunov exponent of double pendulums that are let go almost horizontally: of stiff springs, and of rigid rods in angles."""
    count = 24
    angles = np.pi / 2 + 0.02 * np.arange(count)
    rigid = growth(swung, np.column_stack([np.full(count, np.pi / 2), angles, np.zeros((count, 2))]), 120, 1e-7)

    anchors, bobs = np.arange(0, 3 * count, 3), np.arange(1, 3 * count, 3)
    first, second = [1.0, 0.0], np.column_stack([np.sin(angles), -np.cos(angles)])
    positions = np.zeros((3 * count, 2))
    positions[bobs], positions[bobs + 1] = first, first + second
    system = sprung.System(
        positions, np.concatenate([np.column_stack([bobs - 1, bobs]), np.column_stack([bobs, bobs + 1])]), masses=1.0,
        stiffness=2e4, rest_lengths=1.0, gravity=[0, -9.81], constraints=[sprung.Constraint(anchors)], name="double pendulums",
    )
    movers = np.sort(np.concatenate([bobs, bobs + 1]))

    def step(states):
        start = system.initial_state()
        start.positions[movers], start.velocities[movers] = np.split(states.reshape(2 * count, 4), 2, axis=1)
        end = sprung.Stepper(system, start, method="verlet").run(0.5, dt=1e-3).state
        return np.hstack([end.positions[movers], end.velocities[movers]]).reshape(count, 8)

    elastic = growth(step, np.hstack([positions[movers], np.zeros((2 * count, 2))]).reshape(count, 8), 120, 1e-7)
    means, errors = [[np.mean(of), np.std(of, ddof=1) / np.sqrt(count)] for of in (rigid, elastic)], 5.0
    (known, of_known), (found, of_found) = means
    assert known > 10 * of_known, "it is chaotic"
    assert abs(found - known) < errors * np.hypot(of_known, of_found)
