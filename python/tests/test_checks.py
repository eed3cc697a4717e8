"""Inspections, Jacobians and the verification suite."""

from __future__ import annotations

import numpy as np
import pytest
import sprung
from conftest import tangle
from scipy import sparse
from scipy.sparse.linalg import eigsh


def test_inspections_are_what_eigenvalue_solvers_find():
    system = tangle(constraints=[])
    for dt in (0.01, 1.0):
        inspection = sprung.inspect(system, dt=dt)
        eigenvalues = np.linalg.eigvalsh(system.matrices(dt=dt).A.toarray())
        assert inspection.inertia == (int((eigenvalues < 0).sum()), 0, int((eigenvalues > 0).sum()))
        assert inspection.definite == (eigenvalues[0] > 0)
        found = inspection.eigenvalues
        # Eigenvalues are found to some digits of the largest one.
        np.testing.assert_allclose(found, eigenvalues[: len(found)], rtol=0, atol=1e-9 * abs(eigenvalues).max())
        vectors = inspection.eigenvectors
        assert vectors.shape == (len(eigenvalues), len(found))
        residual = system.matrices(dt=dt).A @ vectors - vectors * found
        assert abs(residual).max() <= 1e-8 * abs(eigenvalues).max()
        assert inspection.condition == pytest.approx(abs(eigenvalues).max() / abs(eigenvalues).min(), rel=1e-6)
        assert inspection.options["tension"]["definite"] and inspection.stiffness == "full"


def test_critical_steps_are_where_definiteness_ends():
    column = sprung.System.ready("column")
    critical = sprung.inspect(column, dt=0.1).critical_dt
    for dt, definite in ((0.999 * critical, True), (1.001 * critical, False)):
        inspection = sprung.inspect(column, dt=dt)
        assert inspection.definite == definite
        assert (eigsh(column.matrices(dt=dt).A, k=1, which="SA", return_eigenvectors=False)[0] > 0) == definite
    worst = inspection.culprits[0]
    assert worst["strain"] < 0 and worst["particles"] == column.pairs[worst["spring"]].tolist()
    assert np.isinf(sprung.inspect(column, dt=0.1, stiffness="tension").critical_dt)


def test_inspections_read_well(tmp_path):
    inspection = sprung.inspect(sprung.System.ready("column"), dt=0.1)
    assert "INDEFINITE" in str(inspection) and "negative eigenvalues" in repr(inspection)
    page = inspection.to_html(tmp_path / "inspect.html")
    assert page == (tmp_path / "inspect.html").read_text(encoding="utf-8") and "<svg" in page
    assert inspection._repr_html_().startswith("<iframe srcdoc=")
    with pytest.raises(ValueError, match="dt = 0.0"):
        sprung.inspect(tangle(), dt=0.0)


def cubic(order: int):
    """A force with neighbours, ``f = −x³ + products``, and its Jacobian."""

    def force(x):
        x = x.ravel()
        return -(x**3) + np.roll(x, 1) * np.roll(x, -1)

    def jacobian(x):
        x = x.ravel()
        at = np.arange(order)
        whole = np.zeros((order, order))
        whole[at, at] -= 3 * x**2
        whole[at, (at - 1) % order] += np.roll(x, -1)
        whole[at, (at + 1) % order] += np.roll(x, 1)
        return whole

    return force, jacobian


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_array, sparse.coo_matrix, sparse.dia_array, np.asfortranarray, list])
def test_right_jacobians_of_any_type_pass(kind):
    force, jacobian = cubic(12)
    x = np.random.default_rng(2).uniform(1, 2, 12)
    check = sprung.check_jacobian(force, kind(jacobian(x)), x)
    assert check and check.passed and check.wrong == 0 and check.compared >= 36
    np.testing.assert_allclose(check.numeric.toarray(), jacobian(x), rtol=0, atol=1e-7)
    assert "agree" in str(check)


def test_jacobians_may_be_callables_and_points_of_any_shape():
    force, jacobian = cubic(12)
    x = np.random.default_rng(2).uniform(1, 2, (4, 3)).astype(np.float32)
    shapes = set()

    def watched(x):
        shapes.add(x.shape)
        return force(x).reshape(x.shape).tolist()

    assert sprung.check_jacobian(watched, jacobian, x).passed and shapes == {(4, 3)}


def test_wrong_entries_are_named():
    force, jacobian = cubic(12)
    x = np.random.default_rng(3).uniform(1, 2, 12)
    wrong = jacobian(x)
    wrong[4, 5] *= -1
    wrong[7, 7] *= 1.25
    check = sprung.check_jacobian(force, sparse.csc_matrix(wrong), x)
    assert not check and check.wrong == 2
    verdicts = {(entry.row, entry.column): entry.verdict for entry in check.worst[:2]}
    assert verdicts == {(4, 5): "sign flipped", (7, 7): "25.0 % too large"}
    assert "2 of" in str(check) and "row 4, column 5" in str(check)
    assert check._repr_html_().startswith("<iframe")
    assert sprung.check_jacobian(force, -jacobian(x), x).overall == "sign flipped"
    skewed = jacobian(x)
    assert sprung.check_jacobian(force, skewed.T, x).overall == "transposed"


def test_large_jacobians_are_measured_in_groups():
    force, jacobian = cubic(400)
    x = np.random.default_rng(4).uniform(1, 2, 400)
    calls = 0

    def counted(x):
        nonlocal calls
        calls += 1
        return force(x)

    check = sprung.check_jacobian(counted, sparse.csr_array(jacobian(x)), x)
    assert check.passed and calls == 28 * check.groups and check.groups < 10
    wrong = sparse.lil_array(jacobian(x))
    wrong[300, 301] = 0
    assert not sprung.check_jacobian(force, wrong, x).passed


def test_springs_are_named_where_they_are_known():
    system = tangle()
    state = system.initial_state()

    def force(reduced):
        moved = state.copy()
        moved.positions = system.scatter(reduced, state.positions)
        return system.gather(system.force(moved, "elastic"))

    x = system.gather(state.positions)
    right = system.matrices(state, 0.01).K
    for coloured in (False, True):
        assert sprung.check_jacobian(force, right, x, springs=(system, state), coloured=coloured).passed
    check = sprung.check_jacobian(force, system.matrices(state, 0.01, "axial").K, x, springs=(system, state))
    assert any(entry.spring is not None for entry in check.worst)


def test_what_a_force_raises_comes_out():
    calls = 0

    def force(x):
        nonlocal calls
        calls += 1
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        sprung.check_jacobian(force, np.eye(3), np.ones(3))
    assert calls == 1
    for arguments, message in (
        ((lambda x: x[:2], np.eye(3), np.ones(3)), r"force\(x\) = a vector of 2: must have 3 entries"),
        ((lambda x: x * 1j, np.eye(3), np.ones(3)), r"force\(x\) = an array of complex128"),
        ((np.copy, np.eye(4), np.ones(3)), r"jacobian = a matrix of shape \(4, 4\): must be 3 × 3"),
        ((np.copy, 1j * np.eye(3), np.ones(3)), "jacobian = an array of complex128"),
        ((np.copy, sparse.csc_array(1j * np.eye(3)), np.ones(3)), "jacobian = a matrix of complex128"),
        ((np.copy, np.eye(3), [1.0, np.nan, 1.0]), r"point\[1\] = NaN: must be finite"),
        ((np.copy, np.zeros((0, 0)), []), r"point = \[\]: must have at least one coordinate"),
    ):
        with pytest.raises(ValueError, match=message):
            sprung.check_jacobian(*arguments)
    with pytest.raises(ValueError, match="options.tolerance = 0"):
        sprung.check_jacobian(np.copy, np.eye(3), np.ones(3), tolerance=0)


def test_the_suite_passes_and_reads_well(tmp_path):
    verification = sprung.verify(sprung.System.ready("pendulum"))
    assert verification and verification.passed > 50 and verification.failures == []
    assert len(verification.checks) == verification.passed
    assert all(check["value"] <= check["bound"] for check in verification.checks)
    assert "0 failed" in str(verification) and "passed" in repr(verification)
    assert verification.to_html(tmp_path / "report.html") and (tmp_path / "report.html").stat().st_size > 1000
    assert verification._repr_html_().startswith("<iframe")


def test_motions_show_in_notebooks(tmp_path):
    system = tangle(dimension=2)
    result = sprung.Stepper(system, method="bdf2").run(0.1, dt=0.01)
    frame = result._repr_html_()
    assert frame.startswith("<iframe srcdoc=") and "kinetic" in frame and "bdf2, stiffness on-demand" in frame and "dt = 0.01 s" in frame
    page = result.to_html(tmp_path / "view.html")
    assert page == (tmp_path / "view.html").read_text(encoding="utf-8") and "<canvas" in page
    assert "completed at t = 0.1 s after 10 steps" in repr(result)
    # As the command's page does: of a run that chose its steps dt is only the distance of its records.
    adaptive = sprung.Stepper(system).run(0.1, rtol=1e-3).to_html()
    assert "steps by rtol 0.001" in adaptive and "dt =" not in adaptive
    assert "iframe" in system._repr_html_()
