"""Inspections, Jacobians and the verification suite."""

from __future__ import annotations

import subprocess
import sys

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


def quartic(n: int, scale: float = 1.0, seed: int = 0):
    """A function of coupled coordinates with its gradient and minus its Hessian, at a point."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n)) / n
    x = rng.uniform(1, 2, n) * scale

    def f(x):
        y = A @ (x / scale)
        return np.sum(y**4) + np.sum((x / scale) ** 3)

    def gradient(x):
        return (A.T @ (4 * (A @ (x / scale)) ** 3) + 3 * (x / scale) ** 2) / scale

    def K(x):
        return -(A.T @ np.diag(12 * (A @ (x / scale)) ** 2) @ A + np.diag(6 * x / scale)) / scale**2

    return f, gradient, K, x


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("seed", range(4))
def test_right_gradients_pass_at_any_scale(scale, seed):
    f, gradient, K, x = quartic(9, scale, seed)
    check = sprung.check_gradient(f, gradient, x, seed=seed)
    assert check and check.passed and check.worst == [] and len(check.orders) == 3
    assert all(abs(first - 1) < 0.05 and second > 1.8 for first, second in check.orders)
    assert all(table.shape == (5, 3) for table in check.remainders)
    assert "second order" in check.verdict and "orders 1.00 without and 2.0" in str(check)
    # An offset of the function costs digits, not the verdict.
    assert sprung.check_gradient(lambda x: f(x) + 1e6, gradient, x)
    assert sprung.check_hessian(f, lambda x: -gradient(x), K, x)


@pytest.mark.parametrize("factor", [-1.0, 0.0, 1.01, 1.0001, 3.0])
def test_wrong_gradients_are_named(factor):
    f, gradient, _, x = quartic(12)
    wrong = gradient(x)
    wrong[5] *= factor
    check = sprung.check_gradient(f, wrong, x)
    verdict = {-1.0: "sign flipped", 0.0: "missing", 1.01: "1 % too large", 1.0001: "0.01 % too large", 3.0: "3.000 times too large"}
    assert not check and len(check.worst) == 1 and (check.worst[0].row, check.worst[0].verdict) == (5, verdict[factor])
    assert "entry 5:" in str(check) and "not 2" in check.verdict
    assert sprung.check_gradient(f, -gradient(x), x).verdict == "sign flipped"
    assert sprung.check_gradient(f, 2 * gradient(x), x).verdict == "off by the factor 2"


def test_gradients_of_special_functions():
    x = np.linspace(1, 2, 5)
    # Of a linear function there is nothing but rounding, and a wrong slope shows nevertheless.
    weights = np.arange(5.0)
    check = sprung.check_gradient(lambda x: weights @ x, weights, x)
    assert check and "rounding" in check.verdict
    assert not sprung.check_gradient(lambda x: weights @ x, 1.001 * weights, x)
    noise = np.random.default_rng(0)
    lost = sprung.check_gradient(lambda x: np.sum(x) + noise.normal(), np.ones(5), x)
    assert not lost and "cannot be measured" in lost.verdict
    # A constant, a cubic without a second derivative, single precision, a shape, and a domain that ends nearby.
    assert sprung.check_gradient(lambda x: 7.0, np.zeros(5), x)
    assert sprung.check_gradient(lambda x: np.sum(x**3), np.zeros(5), np.zeros(5))
    for kind in (np.float32, lambda x: np.float64(np.float32(x))):
        single = lambda x: kind(np.sum(np.asarray(x, dtype=np.float32) ** 2))
        assert sprung.check_gradient(single, 2 * x, x)
        assert not sprung.check_gradient(single, 2.2 * x, x)
    grid = np.ones((2, 3)) + np.arange(6).reshape(2, 3)
    assert sprung.check_gradient(lambda x: np.sum(x**2), lambda x: (2 * x).ravel(), grid)
    with np.errstate(invalid="ignore"):
        assert sprung.check_gradient(lambda x: np.sum(np.sqrt(x)), lambda x: 0.5 / np.sqrt(x), np.array([1e-3, 1.0, 2.0]))
    mixed = np.array([1e-6, 1e3])
    assert sprung.check_gradient(lambda x: (x[0] * 1e6) ** 3 + (x[1] / 1e3) ** 3, [3e6, 3e-3], mixed, length=mixed)
    assert not sprung.check_gradient(lambda x: (x[0] * 1e6) ** 3 + (x[1] / 1e3) ** 3, [3.03e6, 3e-3], mixed, length=mixed)


def test_hessians_are_checked_three_times():
    f, gradient, K, x = quartic(6)
    force = lambda x: -gradient(x)
    check = sprung.check_hessian(f, force, K, x)
    assert check and check.asymmetry < 1e-14 and check.worst == []
    assert check.verdict == "the force is minus the gradient of energy; K is the Jacobian of the force; K is symmetric"
    for wrong in (lambda: sprung.check_hessian(f, gradient, K, x), lambda: sprung.check_hessian(f, force, lambda x: -K(x), x)):
        assert not wrong()
    skewed = K(x)
    skewed[1, 4] *= 1.01
    found = sprung.check_hessian(f, force, sparse.csc_array(skewed), x)
    assert not found and found.gradient and not found.jacobian and (found.worst[0].row, found.worst[0].column) == (1, 4)
    assert "K is not symmetric" in str(found) and "not the mirror image" in str(found)


def test_adjoints_are_checked_by_dot_products():
    rng = np.random.default_rng(1)
    T = rng.normal(size=(4, 6))
    right = sprung.check_adjoint(lambda x: T @ x.ravel(), lambda y: (T.T @ y).reshape(2, 3), (2, 3), 4)
    assert right and right.value <= right.bound < 1e-12 and "agrees" in str(right)
    wrong = T.T.copy()
    wrong[2, 1] *= -1
    found = sprung.check_adjoint(lambda x: T @ x, lambda y: wrong @ y, 6, 4)
    assert not found and [(e.row, e.column, e.verdict) for e in found.worst] == [(2, 1, "sign flipped")]
    square = rng.normal(size=(5, 5))
    assert not sprung.check_adjoint(lambda x: square @ x, lambda y: square @ y, 5, 5)
    assert not sprung.check_adjoint(lambda x: square @ x, lambda y: 1.0000001 * square.T @ y, 5, 5)
    assert "tangent is not linear" in sprung.check_adjoint(lambda x: square @ x + 1, lambda y: square.T @ y, 5, 5).verdict
    assert sprung.check_adjoint(lambda x: np.zeros(2), lambda y: np.zeros(3), 3, 2)


def test_a_run_is_the_adjoint_of_its_tangent():
    system = tangle(constraints=[sprung.Constraint(0)])
    run = sprung.Stepper(system, method="implicit-midpoint").run(0.02, dt=0.005, differentiable=True)
    count = len(system.pairs)
    assert sprung.check_adjoint(
        lambda k: run.tangent(stiffness=k)[0][0], lambda x: run.gradient(x, check=False).stiffness, count, (40, 3), samples=2
    )


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: sprung.check_gradient(1.0, [1.0], [1.0]), TypeError, "f = float: must be callable"),
        (lambda: sprung.check_gradient(np.sum, [1.0], []), ValueError, "at least one coordinate"),
        (lambda: sprung.check_gradient(np.sum, [1.0, 2.0], [1.0]), ValueError, r"grad = an array of shape \(2,\): must have shape \(1,\)"),
        (lambda: sprung.check_gradient(np.sum, [np.nan], [1.0]), ValueError, r"grad\[0\] = nan: must be finite"),
        (lambda: sprung.check_gradient(np.sum, [1.0], [np.inf]), ValueError, r"x\[0\] = inf"),
        (lambda: sprung.check_gradient(np.sum, [1.0], ["a"]), ValueError, "x = an array of"),
        (lambda: sprung.check_gradient(np.copy, [1.0, 1.0], [1.0, 2.0]), ValueError, "must be one real number"),
        (lambda: sprung.check_gradient(lambda x: 1j, [1.0], [1.0]), ValueError, "must be one real number"),
        (lambda: sprung.check_gradient(lambda x: np.nan, [1.0], [1.0]), ValueError, r"f\(x\) = nan: must be finite"),
        (lambda: sprung.check_gradient(np.sum, [1.0], [1.0], directions=0), ValueError, "directions = 0"),
        (lambda: sprung.check_gradient(np.sum, [1.0], [1.0], length=-1.0), ValueError, "length = -1.0: must be positive"),
        (lambda: sprung.check_hessian(np.sum, None, np.eye(1), [1.0]), TypeError, "force = NoneType"),
        (lambda: sprung.check_hessian(np.sum, np.negative, np.eye(2), [1.0]), ValueError, "must be 1 × 1"),
        (lambda: sprung.check_adjoint(np.copy, 3, 2, 2), TypeError, "adjoint = int"),
        (lambda: sprung.check_adjoint(np.copy, np.copy, 2, 3), ValueError, r"tangent\(…\) = an array of shape \(2,\): must have shape \(3,\)"),
        (lambda: sprung.check_adjoint(np.copy, np.copy, 2.5, 2), ValueError, "x_shape = 2.5"),
        (lambda: sprung.check_adjoint(np.copy, np.copy, 2, 2, samples=True), ValueError, "samples = True"),
    ],
)
def test_wrong_arguments_of_checks(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_the_plugin_asserts(tmp_path):
    """In a process of its own: fixtures are there, fail with the report, and nothing heavy is imported before they are called."""
    (tmp_path / "test_mine.py").write_text(
        "import sys\n"
        "def test_light():\n"
        "    assert 'sprung_pytest' in sys.modules and 'sprung' not in sys.modules and 'numpy' not in sys.modules\n"
        "def test_right(assert_gradient, assert_jacobian, assert_hessian, assert_adjoint):\n"
        "    assert assert_gradient(lambda x: (x**2).sum(), [2.0, 4.0], [1.0, 2.0]).passed\n"
        "    assert_jacobian(lambda x: x**2, [[2.0, 0.0], [0.0, 4.0]], [1.0, 2.0])\n"
        "    assert_hessian(lambda x: (x**2).sum(), lambda x: -2 * x, [[-2.0, 0.0], [0.0, -2.0]], [1.0, 2.0])\n"
        "    assert_adjoint(lambda x: 2 * x, lambda y: 2 * y, 2, 2)\n"
        "def test_wrong(assert_gradient):\n"
        "    assert_gradient(lambda x: (x**2).sum(), [2.0, -4.0], [1.0, 2.0])\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)], capture_output=True, text=True, timeout=120, cwd=tmp_path
    )
    assert "1 failed, 2 passed" in done.stdout and "entry 1: -4, measured 4: sign flipped" in done.stdout, done.stdout
