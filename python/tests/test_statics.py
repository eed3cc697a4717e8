"""Equilibria, normal modes and mechanisms beside dense linear algebra and known answers."""

from __future__ import annotations

import numpy as np
import pytest
import sprung
from conftest import tangle
from scipy import linalg, signal
from scipy.sparse.linalg import spsolve


def network(particles: int = 25, cutoff: float = 2.2, seed: int = 1) -> sprung.System:
    """An elastic network: unit springs at rest between all particles within a distance of a compact heap."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-2, 2, (particles, 3))
    first, second = np.triu_indices(particles, 1)
    lengths = np.linalg.norm(positions[first] - positions[second], axis=1)
    near = lengths < cutoff
    return sprung.System(positions, np.column_stack([first, second])[near], masses=1.0, stiffness=lengths[near])


def dense(system: sprung.System, state: sprung.State | None = None):
    """Minus K, M and minus G as arrays."""
    matrices = system.matrices(state, dt=0.01)
    return -matrices.K.toarray(), matrices.M.toarray(), -matrices.G.toarray()


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_modes_of_random_systems_are_those_of_a_dense_solver(dimension, seed):
    system = tangle(particles=14, springs=30, dimension=dimension, seed=seed)
    stiffness, masses, damping = dense(system)
    expected, vectors = linalg.eigh(stiffness, masses)
    scale = abs(expected).max()
    zeros = int(np.count_nonzero(abs(expected) < 1e-12 * scale))
    found = sprung.modes(system, 6)
    assert found.zero_modes == zeros
    others = expected[abs(expected) >= 1e-12 * scale]
    np.testing.assert_allclose(found.eigenvalues, others[: len(found)], atol=1e-10 * scale)
    assert (abs(found.eigenvalues - others[: len(found)]) <= found.error_bounds + 1e-13 * scale).all()
    assert (found.error_bounds[:-1] < 1e-9 * scale).all()
    assert len(found) == min(6, len(others)) and found.complete and found.proven
    # The count includes zero modes.
    below = np.count_nonzero(expected < found.counted_below)
    reported = np.concatenate([found.eigenvalues, np.zeros(found.zero_modes)])
    assert below == np.count_nonzero(reported < found.counted_below)
    phi = np.array([system.gather(shape) for shape in found.shapes])
    np.testing.assert_allclose(phi @ masses @ phi.T, np.eye(len(phi)), atol=1e-10)
    np.testing.assert_allclose(phi @ stiffness, found.eigenvalues[:, None] * (phi @ masses), atol=1e-8 * scale)
    positive = found.eigenvalues > 0
    ratios = np.einsum("ki,ij,kj->k", phi, damping, phi)[positive] / (2 * np.sqrt(found.eigenvalues[positive]))
    np.testing.assert_allclose(found.damping_ratios[positive], ratios, rtol=1e-8, atol=1e-12)
    assert np.isnan(found.damping_ratios[~positive]).all() and np.isnan(found.frequencies[~positive]).all()
    np.testing.assert_allclose(found.frequencies[positive], np.sqrt(found.eigenvalues[positive]) / (2 * np.pi))
    assert found.imbalance > 0


def test_an_elastic_network_has_six_zero_modes():
    system = network()
    stiffness, masses, _ = dense(system)
    expected = linalg.eigvalsh(stiffness, masses)
    found = sprung.modes(system, 20)
    assert (found.zero_modes, found.rigid_motions, found.complete, found.imbalance) == (6, 6, True, 0.0)
    np.testing.assert_allclose(found.eigenvalues, expected[6:26], rtol=1e-10)
    zero = np.array([system.gather(shape) for shape in found.zero_shapes])
    np.testing.assert_allclose(zero @ masses @ zero.T, np.eye(6), atol=1e-12)
    assert abs(zero @ stiffness).max() < 1e-12 * expected[-1]
    assert "6 zero modes" in repr(found)


def test_all_modes_can_be_asked_for():
    system = network(8, 5.0)
    found = sprung.modes(system, 1000)
    assert len(found) + found.zero_modes == 24
    # Effective masses of all modes are the mass, along every axis.
    rigid = np.array([system.gather(shape) for shape in found.zero_shapes])
    _, masses, _ = dense(system)
    along = np.tile(np.eye(3), (8, 1)).T
    total = found.effective_masses.sum(axis=0) + ((rigid @ masses @ along.T) ** 2).sum(axis=0)
    np.testing.assert_allclose(total, 8.0, rtol=1e-10)


def test_known_frequencies_of_a_triangle():
    corners = np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    system = sprung.System(corners, [[0, 1], [1, 2], [2, 0]], masses=2.0, stiffness=50.0)
    found = sprung.modes(system, 3)
    np.testing.assert_allclose(found.eigenvalues, [37.5, 37.5, 75.0], rtol=1e-12)
    assert found.zero_modes == 3 and found.complete


def damped_net(seed: int = 5) -> sprung.System:
    system = network(12, 4.0, seed)
    rng = np.random.default_rng(seed)
    return sprung.System(
        system.initial_state().positions, system.pairs, masses=rng.uniform(0.5, 2.0, 12), stiffness=40 * system.stiffness,
        damping=rng.uniform(0.0, 0.4, len(system.pairs)), constraints=[sprung.Constraint([0, 1, 2])],
    )  # fmt: skip


def test_harmonic_response_is_that_of_the_full_system():
    system = damped_net()
    matrices = system.matrices(dt=0.01)
    found = sprung.modes(system, len(system.dofs))
    rng = np.random.default_rng(0)
    force = rng.normal(size=len(system.dofs))
    frequencies = np.concatenate([[0.0], rng.uniform(0.1, 4.0, 5), found.frequencies[:3]])
    response = found.harmonic_response(force, frequencies)
    assert response.shape == (len(frequencies), len(force)) and response.dtype == complex
    for amplitude, frequency in zip(response, frequencies):
        omega = 2 * np.pi * frequency
        full = spsolve((-matrices.K - omega**2 * matrices.M - 1j * omega * matrices.G).tocsc(), force.astype(complex))
        np.testing.assert_allclose(amplitude, full, atol=1e-9 * abs(full).max())
    np.testing.assert_array_equal(found.harmonic_response(force, 0.5), found.harmonic_response(force, [0.5]))
    with pytest.raises(ValueError, match=r"force = an array of shape \(3,\)"):
        found.harmonic_response(np.zeros(3), [1.0])
    with pytest.raises(ValueError, match="frequencies = an array of shape"):
        found.harmonic_response(force, np.zeros((2, 2)))


def test_scipy_takes_the_state_space():
    system = damped_net()
    found = sprung.modes(system, len(system.dofs))
    inputs, outputs = [0, 4], [0, 7, 11]
    space = signal.StateSpace(*found.state_space(inputs, outputs))
    assert (space.A.shape, space.B.shape, space.C.shape) == ((2 * len(found),) * 2, (2 * len(found), 2), (3, 2 * len(found)))
    omega = 2 * np.pi * 0.7
    transfer = space.C @ np.linalg.solve(1j * omega * np.eye(len(space.A)) - space.A, space.B)
    force = np.zeros(len(system.dofs))
    force[4] = 1.0
    np.testing.assert_allclose(transfer[:, 1], found.harmonic_response(force, [0.7])[0, outputs], rtol=1e-9)
    with pytest.raises(ValueError, match=r"inputs\[1\] = 999"):
        found.state_space([0, 999], [0])
    with pytest.raises(ValueError, match=r"outputs\[0\] = 999"):
        found.state_space([0], [999])


@pytest.mark.parametrize("n", [0, -1, 1.5, True, "3"])
def test_wrong_numbers_of_modes(n):
    with pytest.raises(ValueError, match="n = "):
        sprung.modes(network(5, 9.0), n)


def hanging_chain(links: int = 6, **changes) -> sprung.System:
    """A chain of free particles below a support, given aslant."""
    rng = np.random.default_rng(4)
    positions = np.cumsum(np.vstack([np.zeros(3), rng.normal([0.5, -1.0, 0.2], 0.2, (links, 3))]), axis=0)
    arguments = dict(
        masses=rng.uniform(0.5, 2.0, links + 1), stiffness=rng.uniform(100, 300, links), rest_lengths=rng.uniform(0.5, 1.0, links),
        gravity=[0, -9.81, 0], constraints=[sprung.Constraint(0)],
    )  # fmt: skip
    pairs = np.column_stack([np.arange(links), np.arange(1, links + 1)])
    return sprung.System(positions, pairs, **{**arguments, **changes})


def test_a_chain_hangs_as_it_must():
    system = hanging_chain()
    found = sprung.equilibrium(system)
    carried = np.cumsum(system.masses[:0:-1])[::-1] * 9.81
    lengths = system.rest_lengths * (1 + carried / system.stiffness)
    expected = np.zeros((7, 3))
    expected[1:, 1] = -np.cumsum(lengths)
    np.testing.assert_allclose(found.positions, expected, atol=1e-9)
    assert found.status == "stable" and found.residual < 1e-10 and found.falling == []
    assert found.inertia == (0, 0, 18) and found.iterations > 0
    energy = system.energy(found.state)
    assert found.energy == pytest.approx(energy.elastic + energy.gravitational, rel=1e-12)
    half = sprung.equilibrium(system, load=0.5)
    np.testing.assert_allclose(np.diff(half.positions[:, 1]), -system.rest_lengths * (1 + 0.5 * carried / system.stiffness), rtol=1e-9)
    again = sprung.equilibrium(system, found.state)
    assert again.iterations <= 1


def column() -> sprung.System:
    """Two compressed bars in a line, braced by nothing: straight, it stands on a saddle."""
    return sprung.System(
        [[0, 0], [0, 0.8], [0, 1.6]], [[0, 1], [1, 2]], masses=1.0, stiffness=100.0, rest_lengths=1.0,
        constraints=[sprung.Constraint([0, 2])],
    )  # fmt: skip


def test_status_of_a_saddle():
    at = sprung.equilibrium(column(), leave_saddles=False)
    assert at.status == "unstable" and at.inertia.negative == 1
    np.testing.assert_allclose(at.positions, column().initial_state().positions, atol=1e-12)
    left = sprung.equilibrium(column())
    assert left.status == "stable" and abs(left.positions[1, 0]) == pytest.approx(0.6, rel=1e-8)


def test_status_of_what_falls_and_of_what_is_free():
    loose = sprung.System([[0, 0], [1, 0], [5, 5]], [[0, 1]], masses=1.0, stiffness=10.0, gravity=[0, -9.81], constraints=[{"particles": [0]}])
    falls = sprung.equilibrium(loose)
    assert falls.status == "none" and falls.falling == [2]
    with pytest.raises(ValueError, match="isolated equilibrium"):
        falls.gradient(np.zeros((3, 2)))
    free = sprung.equilibrium(sprung.System([[0, 0], [1.2, 0]], [[0, 1]], masses=1.0, stiffness=10.0, rest_lengths=1.0))
    assert free.status == "indifferent" and free.inertia.zero == 3
    assert np.linalg.norm(free.positions[1] - free.positions[0]) == pytest.approx(1.0, rel=1e-9)
    with pytest.raises(ValueError, match="isolated equilibrium"):
        free.gradient(np.zeros((2, 2)))


@pytest.mark.parametrize("load", [1.0, 0.4])
def test_gradient_of_an_equilibrium(load):
    """Beside central differences of the equilibrium itself, for every kind of parameter."""
    rng = np.random.default_rng(8)
    positions = np.array([[0, 0], [1, 0], [2, 0], [0, -1], [1, -1], [2, -1]]) + rng.normal(0, 0.05, (6, 2))
    pairs = np.array([[0, 3], [3, 4], [4, 5], [5, 2], [1, 4], [0, 4], [2, 4]])
    given = dict(
        masses=rng.uniform(0.5, 1.5, 6), stiffness=rng.uniform(50, 100, 7), rest_lengths=rng.uniform(0.8, 1.1, 7), gravity=np.array([0.3, -9.81]),
        positions=positions,
    )  # fmt: skip
    weights = rng.normal(size=(6, 2))

    def at(**changes):
        arguments = {**given, **changes}
        system = sprung.System(pairs=pairs, constraints=[sprung.Constraint([0, 1, 2])], **arguments)
        return sprung.equilibrium(system, load=load)

    found = at()
    assert found.status == "stable"
    gradient = found.gradient(weights)
    for name, value in given.items():
        direction = rng.normal(size=value.shape)
        h = 1e-5
        plus, minus = (np.sum(weights * at(**{name: value + sign * h * direction}).positions) for sign in (1, -1))
        expected = np.sum(getattr(gradient, name) * direction)
        assert (plus - minus) / (2 * h) == pytest.approx(expected, rel=1e-6), name
    assert not gradient.damping.any() and not gradient.velocities.any()
    with pytest.raises(ValueError, match="positions"):
        found.gradient(np.zeros((6, 3)))
    with pytest.raises(ValueError, match="positions"):
        found.gradient(np.zeros((5, 2)))


def test_springs_without_a_rest_length():
    """Force densities: one linear solve, and its derivative."""
    held = np.array([[0, 0, 0], [2, 0, 1], [2, 2, 0], [0, 2, 1.0]])
    positions = np.vstack([held, [[1, 1, 0.2]]])
    pairs = np.column_stack([np.arange(4), np.full(4, 4)])
    density = np.array([1.0, 2.0, 3.0, 4.0])

    def at(density):
        net = sprung.System(positions, pairs, masses=1.0, stiffness=density, rest_lengths=0.0, constraints=[sprung.Constraint(range(4))])
        return sprung.equilibrium(net)

    found = at(density)
    np.testing.assert_allclose(found.positions[4], density @ held / density.sum(), atol=1e-12)
    weights = np.zeros((5, 3))
    weights[4] = [1.0, -2.0, 0.5]
    expected = (held - found.positions[4]) @ weights[4] / density.sum()
    np.testing.assert_allclose(found.gradient(weights).stiffness, expected, rtol=1e-9)


def square(diagonals: int) -> sprung.System:
    pairs = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]][: 4 + diagonals]
    return sprung.System([[0, 0], [1, 0], [1, 1], [0, 1]], pairs, masses=1.0, stiffness=10.0)


@pytest.mark.parametrize("diagonals, rank, mechanisms, stresses", [(0, 4, 4, 0), (1, 5, 3, 0), (2, 5, 3, 1)])
def test_mechanisms_of_a_square(diagonals, rank, mechanisms, stresses):
    system = square(diagonals)
    found = sprung.mechanisms(system)
    assert (found.degrees_of_freedom, found.springs, found.rank) == (8, 4 + diagonals, rank)
    assert (found.mechanisms, found.rigid_motions, found.self_stresses, found.decided) == (mechanisms, 3, stresses, True)
    assert found.proven and found.rank_is_exact and 0 < found.proven_gap[0] <= found.gap[0] and found.proven_gap[1] == 0
    assert found.motions.shape == (mechanisms - 3, 4, 2) and found.self_stress.shape == (stresses, 4 + diagonals)
    first, second = system.pairs.T.astype(int)
    x = system.initial_state().positions
    normals = (x[first] - x[second]) / np.linalg.norm(x[first] - x[second], axis=1)[:, None]
    for motion in found.motions:
        rates = np.sum(normals * (motion[first] - motion[second]), axis=1)
        assert abs(rates).max() < 1e-12 * abs(motion).max()
    for stress in found.self_stress:
        forces = np.zeros((4, 2))
        np.add.at(forces, first, stress[:, None] * normals)
        np.add.at(forces, second, -stress[:, None] * normals)
        assert abs(forces).max() < 1e-12 * abs(stress).max()
    assert len(found.movers) == len(found.motions) and len(found.added_springs) == mechanisms - 3


def prism(turn: float) -> sprung.System:
    """Three struts and nine cables between two triangles, the upper one turned."""
    angles = 2 * np.pi * np.arange(3) / 3
    lower = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    upper = np.column_stack([np.cos(angles + turn), np.sin(angles + turn), np.ones(3)])
    around = [[i, (i + 1) % 3] for i in range(3)]
    pairs = [*around, *[[3 + i, 3 + j] for i, j in around], *[[i, 3 + i] for i in range(3)], *[[i, 3 + (i + 1) % 3] for i in range(3)]]
    return sprung.System(np.vstack([lower, upper]), pairs, masses=1.0, stiffness=10.0)


def test_mechanisms_of_a_tensegrity_prism():
    found = sprung.mechanisms(prism(np.radians(30)))
    assert (found.degrees_of_freedom, found.springs, found.rank) == (18, 12, 11)
    assert (found.mechanisms, found.rigid_motions, found.self_stresses) == (7, 6, 1)
    assert found.prestress_stable is True and found.decided
    assert found.proven and not found.rank_is_exact and 0 < found.proven_gap[1] < 1e-13
    stress = found.self_stress[0] / found.self_stress[0, 6]
    # Cables in tension, struts in compression.
    np.testing.assert_allclose(stress[6:], [1, 1, 1, *3 * [stress[9]]], rtol=1e-9)
    assert (stress[:9] > 0).all() and (stress[9:] < 0).all()
    turned = sprung.mechanisms(prism(np.radians(31)))
    assert (turned.rank, turned.mechanisms, turned.self_stresses) == (12, 6, 0) and turned.self_stress.shape == (0, 12)
    assert found.gap[0] > 1e3 * found.gap[1] and turned.gap[0] > 0


def test_many_mechanisms_of_a_large_system_are_counted():
    system = sprung.System.ready("cloth", 16)
    found = sprung.mechanisms(system)
    first, second = system.pairs.T.astype(int)
    x = system.initial_state().positions
    normals = (x[first] - x[second]) / np.linalg.norm(x[first] - x[second], axis=1)[:, None]
    directions = np.zeros((len(first), *x.shape))
    directions[np.arange(len(first)), first], directions[np.arange(len(first)), second] = normals, -normals
    free = directions[:, system.dofs[:, 0], system.dofs[:, 1]]
    squares = np.linalg.eigvalsh(free.T @ free)
    assert found.rank == np.count_nonzero(squares > 1e-10 * squares[-1])
    assert found.mechanisms == len(system.dofs) - found.rank > 100 and found.decided
    assert found.motions.shape == (0, 256, 3) and found.self_stress.shape == (0, len(first)) and found.prestress_stable is None


def test_states_of_another_system():
    with pytest.raises(ValueError, match="positions"):
        sprung.modes(square(1), 2, sprung.State(np.zeros((3, 2))))
    with pytest.raises(ValueError, match="positions"):
        sprung.equilibrium(square(1), sprung.State(np.zeros((3, 2))))
    with pytest.raises(ValueError, match="positions"):
        sprung.mechanisms(square(1), sprung.State(np.zeros((3, 2))))
    with pytest.raises(ValueError, match="load"):
        sprung.equilibrium(square(1), load=np.nan)
