"""Matrices, operators and factors against an assembly by numpy and scipy."""

from __future__ import annotations

import numpy as np
import pytest
import sprung
from conftest import assemble, tangle
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg, eigsh, spsolve

DT = 0.02

#: Of the largest entry. An entry is a sum of some ten terms of a few roundings each, 1.1e-16 every one, that mostly cancel.
ROUNDING = 1e-15


def largest(matrix) -> float:
    return abs(matrix).max() if matrix.shape[0] else 0.0


@pytest.mark.parametrize("stiffness", ["full", "tension", "axial", "absolute"])
def test_matrices_are_those_of_the_formulas(system, stiffness):
    state = system.initial_state()
    ours, theirs = system.matrices(state, DT, stiffness), assemble(system, state, DT, stiffness)
    for name in "AMGK":
        matrix = getattr(ours, name)
        assert isinstance(matrix, sparse.csc_array) and matrix.indices.dtype == np.int32
        assert matrix.has_canonical_format and matrix.has_sorted_indices
        sparse.csc_array((matrix.data, matrix.indices, matrix.indptr), matrix.shape).check_format(full_check=True)
        assert largest(matrix - theirs[name]) <= ROUNDING * largest(theirs[name]), name
        assert (matrix != matrix.T).nnz == 0, f"{name} is not symmetric to the bit"
    np.testing.assert_allclose(ours.b, theirs["b"], rtol=0, atol=4 * ROUNDING * abs(theirs["b"]).max())
    np.testing.assert_array_equal(ours.dofs, system.dofs)
    # Each entry of A is one sum, so it is right to rounding of what the sum is made of.
    together = ours.M / DT**2 - ours.G / DT - ours.K
    assert largest(ours.A - together) <= ROUNDING * largest(ours.A)


def test_canonical_format_is_no_mere_claim(system):
    for name in "AMGK":
        matrix = getattr(system.matrices(dt=DT), name)
        fresh = sparse.csc_array((matrix.data, matrix.indices, matrix.indptr), matrix.shape)
        assert fresh.has_canonical_format


def test_states_may_be_of_any_layout_and_time(system):
    state = system.initial_state()
    other = sprung.State(np.asfortranarray(state.positions), state.velocities[::-1][::-1].astype(">f8"), time=0.0)
    np.testing.assert_array_equal(system.matrices(state, DT).A.data, system.matrices(other, DT).A.data)
    other.positions = other.positions * 1.01
    assert (system.matrices(state, DT).b != system.matrices(other, DT).b).any()


def test_arrays_are_the_users_own(system):
    first, second = system.matrices(dt=DT), system.matrices(dt=DT)
    kept = second.K.toarray()
    first.A.data[:] = 0.0
    first.A.eliminate_zeros()
    np.testing.assert_array_equal(first.K.toarray(), kept)
    np.testing.assert_array_equal(system.matrices(dt=DT).K.toarray(), kept)
    assert first.A.nnz == 0 and second.A.nnz > 0


@pytest.mark.parametrize("name", "AMGK")
def test_operators_are_the_matrices(system, name):
    matrices = system.matrices(dt=DT)
    operator = matrices.operator(name)
    assert isinstance(operator, LinearOperator) and operator.shape == matrices.A.shape
    w = np.random.default_rng(1).normal(size=(operator.shape[0], 3))
    expected = getattr(matrices, name) @ w
    bound = 1e-14 * abs(getattr(matrices, name)).sum(axis=0).max() * abs(w).max()
    np.testing.assert_allclose(operator @ w, expected, rtol=0, atol=bound)
    np.testing.assert_allclose(operator.T @ w[:, 0], expected[:, 0], rtol=0, atol=bound)
    np.testing.assert_allclose(system.operator(dt=DT, matrix=name) @ w[:, 1], expected[:, 1], rtol=0, atol=bound)


def test_operators_keep_their_state(system):
    state = system.initial_state()
    matrices = system.matrices(state, DT)
    w = np.ones(len(matrices.b))
    before = matrices.A @ w
    state.positions *= 2.0
    np.testing.assert_allclose(matrices.operator() @ w, before, rtol=0, atol=1e-13 * abs(before).max())


@pytest.mark.parametrize("kind", ["llt", "ldlt"])
def test_factors_solve(system, kind):
    matrices = system.matrices(dt=DT)
    factor = matrices.factor(kind)
    for b in (matrices.b, np.column_stack([matrices.b, np.arange(len(matrices.b))]), np.arange(len(matrices.b))):
        x = factor.solve(b)
        assert x.shape == b.shape
        # A backward-stable solution leaves a residual of roundings of |A| |x|.
        scale = abs(matrices.A).sum(axis=0).max() * abs(x).max()
        assert abs(matrices.A @ x - b).max() <= 1e-14 * scale
    np.testing.assert_allclose(factor.solve(matrices.b), spsolve(matrices.A, matrices.b), rtol=1e-9)
    assert factor.entries > 0 and factor.shape == matrices.A.shape
    solution, failed = cg(matrices.A, matrices.b, rtol=1e-12, M=factor.operator(), maxiter=3)
    assert failed == 0
    np.testing.assert_allclose(solution, system.factor(dt=DT, kind=kind).solve(matrices.b), rtol=1e-9)


def test_indefinite_matrices_are_refused_with_the_coordinate():
    column = sprung.System.ready("column")
    matrices = column.matrices(dt=0.1)
    assert eigsh(matrices.A, k=1, which="SA", return_eigenvectors=False)[0] < 0
    with pytest.raises(sprung.NotPositiveDefinite, match=r"A has a pivot that is not positive, in row \d+") as raised:
        matrices.factor()
    assert isinstance(raised.value, np.linalg.LinAlgError)
    assert column.dofs[raised.value.row].tolist() == [raised.value.particle, raised.value.axis]
    x = matrices.factor("ldlt").solve(matrices.b)
    np.testing.assert_allclose(matrices.A @ x, matrices.b, rtol=0, atol=1e-9 * abs(matrices.b).max())
    assert column.matrices(dt=0.1, stiffness="tension").factor().entries > 0


def test_systems_that_cannot_move_have_empty_matrices():
    held = sprung.System([[0, 0], [1, 0]], [[0, 1]], masses=1, stiffness=1, constraints=[sprung.Constraint([0, 1])])
    matrices = held.matrices(dt=DT)
    assert matrices.A.shape == (0, 0) and len(matrices.b) == 0 and matrices.dofs.shape == (0, 2)


def test_unusable_arguments_are_named():
    system = tangle()
    matrices = system.matrices(dt=DT)
    for call, message in (
        (lambda: system.matrices(dt=0.0), "dt = 0.0: must be finite and positive"),
        (lambda: system.matrices(dt=np.nan), "dt = nan: must be finite and positive"),
        (lambda: system.matrices(dt=[1, 2]), r"dt = an array of shape \(2,\): must be one number"),
        (lambda: system.matrices(dt=DT, stiffness="on-demand"), 'stiffness = "on-demand": must be one of full, tension, axial'),
        (lambda: system.operator(dt=DT, matrix="B"), 'matrix = "B": must be one of A, M, G, K'),
        (lambda: matrices.factor("lu"), 'kind = "lu": must be one of llt, ldlt'),
        (lambda: matrices.factor().solve([1.0, 2.0]), f"b = an array of 2 rows: must have {len(matrices.b)} rows"),
        (lambda: matrices.factor().solve(np.ones((1, 1, 1))), r"b = an array of shape \(1, 1, 1\)"),
        (lambda: matrices.factor().solve(matrices.b * 1j), "b = an array of complex128"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    collapsed = system.initial_state()
    collapsed.positions[system.pairs[7]] = 0.0
    with pytest.raises(ValueError, match="has length zero"):
        system.matrices(collapsed, DT)
