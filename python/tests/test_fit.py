"""Parameters from measured motions and shapes."""

from __future__ import annotations

import numpy as np
import pytest
import sprung

DT = 0.02


def net(seed: int = 0, side: int = 3) -> sprung.System:
    """A cable net, held at its corners, that is thrown."""
    rng = np.random.default_rng(seed)
    count, springs = side * side, 2 * side * (side - 1)
    y, x = np.mgrid[:side, :side].astype(float)
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(count)]) + rng.normal(0, 0.05, (count, 3))
    number = np.arange(count).reshape(side, side)
    pairs = np.concatenate([np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]), np.column_stack([number[:-1].ravel(), number[1:].ravel()])])
    return sprung.System(
        positions, pairs, masses=rng.uniform(0.5, 1.5, count), stiffness=rng.uniform(40, 80, springs), rest_lengths=rng.uniform(0.85, 0.95, springs),
        damping=rng.uniform(0.2, 0.6, springs), velocities=rng.normal(0, 1, (count, 3)), gravity=[0, 0, -9.81],
        constraints=[sprung.Constraint(number[[0, 0, -1, -1], [0, -1, 0, -1]])],
    )  # fmt: skip


def motion(system: sprung.System, steps: np.ndarray, method: str = "implicit-midpoint") -> np.ndarray:
    run = sprung.Stepper(system, method=method).run(DT * steps[-1], dt=DT, differentiable=True)
    return run.positions[steps]


STEPS = np.arange(5, 61, 5)


def test_stiffnesses_from_a_noisy_motion():
    truth = net()
    noise = 1e-3 * np.random.default_rng(1).normal(size=(12, 9, 3))
    noise[:, [0, 2, 6, 8]] = 0.0
    measured = motion(truth, STEPS) + noise
    found = sprung.fit(truth.with_springs(stiffness=60.0), measured, steps=STEPS, dt=DT)
    errors = found.standard_errors["stiffness"]
    assert found.success and found.covariance.shape == (12, 12)
    deviation = (found.stiffness - truth.stiffness) / errors
    assert abs(deviation).max() < 4 and 0.3 < np.sqrt(np.mean(deviation**2)) < 2
    assert (errors < 0.05 * truth.stiffness).all()
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), errors, rtol=1e-10)
    np.testing.assert_array_equal(found.system.stiffness, found.stiffness)
    np.testing.assert_array_equal(found.system.rest_lengths, truth.rest_lengths)
    # Held coordinates have no noise, and do not count.
    assert found.sigma == pytest.approx(1e-3, rel=0.15)
    assert found.cost == pytest.approx(0.5 * np.nansum(found.residual**2))
    assert np.isnan(found.residual[:, [0, 2, 6, 8]]).all() and np.isfinite(found.residual[:, [1, 3, 4, 5, 7]]).all()
    assert "stiffness" in repr(found)


def test_intervals_hold_the_truth():
    """A tenth of the net of verification/identification.py."""
    truth = net(7, side=8)
    measured = motion(truth, STEPS)
    measured += 1e-3 * np.random.default_rng(8).normal(size=measured.shape)
    found = sprung.fit(truth.with_springs(stiffness=60.0), measured, steps=STEPS, dt=DT)
    error, count = found.stiffness - truth.stiffness, len(truth.pairs)
    assert found.success and 0.89 < np.mean(abs(error) < 1.96 * found.standard_errors["stiffness"]) < 0.995
    # χ² with n degrees of freedom has the mean n and the variance 2n.
    squares = error @ np.linalg.solve(found.covariance, error)
    assert abs(squares - count) < 3 * np.sqrt(2 * count)


@pytest.mark.parametrize("method", ["backward-euler", "bdf2", "verlet"])
def test_all_parameters_from_an_exact_motion(method):
    truth = net(1)
    rng = np.random.default_rng(2)
    start = truth.with_springs(
        stiffness=truth.stiffness * rng.uniform(0.9, 1.1, 12), rest_lengths=truth.rest_lengths * rng.uniform(0.97, 1.03, 12), damping=0.0
    )
    moving = [1, 3, 4, 5, 7]
    measured = motion(truth, STEPS, method)[:, moving]
    found = sprung.fit(start, measured, ["stiffness", "rest_lengths", "damping"], times=DT * STEPS, dt=DT, particles=moving, method=method)
    np.testing.assert_allclose(found.stiffness, truth.stiffness, rtol=1e-5)
    np.testing.assert_allclose(found.rest_lengths, truth.rest_lengths, rtol=1e-5)
    np.testing.assert_allclose(found.damping, truth.damping, atol=1e-5)
    assert list(found.standard_errors) == ["stiffness", "rest_lengths", "damping"]


def test_common_factors_and_groups():
    truth = net(2)
    measured = motion(truth, STEPS)
    groups = np.repeat([7, 3], 6)
    start = truth.with_springs(stiffness=truth.stiffness / np.where(groups == 7, 1.3, 0.8), damping=truth.damping / 2)
    found = sprung.fit(start, measured, {"stiffness": groups, "damping": "common"}, steps=STEPS, dt=DT)
    np.testing.assert_allclose(found.stiffness, truth.stiffness, rtol=1e-7)
    np.testing.assert_allclose(found.damping, truth.damping, rtol=1e-6)
    assert found.covariance.shape == (3, 3)
    # All springs of a group have the same relative error.
    relative = found.standard_errors["stiffness"] / found.stiffness
    np.testing.assert_allclose(relative[:6], relative[0], rtol=1e-6)


def test_fewer_measurements_than_parameters():
    """Rows by gradients; what the measurements leave open has no finite error."""
    truth = net(3)
    steps = np.array([30])
    start = truth.with_springs(stiffness=1.05 * truth.stiffness)
    measured = motion(truth, steps)[:, [4]]
    found = sprung.fit(start, measured, steps=steps, dt=DT, particles=[4], sigma=1e-3)
    assert found.cost < 1e-16
    assert np.isinf(found.standard_errors["stiffness"]).any()
    by_sigma = sprung.fit(start, measured, {"stiffness": "common"}, steps=steps, dt=DT, particles=[4], sigma=1e-3)
    np.testing.assert_allclose(by_sigma.stiffness, truth.stiffness, rtol=1e-8)
    assert np.isfinite(by_sigma.standard_errors["stiffness"]).all() and by_sigma.sigma == 1e-3


def test_tangents_and_gradients_give_the_same_jacobian():
    from sprung._fit import _Motion, _Unknowns

    system = net(4)
    unknowns = _Unknowns(system, {"stiffness": "each", "damping": "common"})
    steps = np.array([3, 20])
    how = dict(state=None, method="backward-euler", dt=DT, steps=steps)
    few = np.zeros((2, 2, 3), dtype=bool)
    few[0, 0, 2] = few[1, 1, 0] = few[1, 0, 1] = True
    by_rows = _Motion(unknowns, few, np.array([4, 7]), **how)
    by_columns = _Motion(unknowns, np.ones((2, 2, 3), dtype=bool), np.array([4, 7]), **how)
    unknowns_many = len(unknowns)
    assert few.sum() < unknowns_many
    run = by_rows.run(unknowns.start)
    zeros = [np.zeros(shape) for shape in run._shapes()]
    changes = [(*change.values(), *zeros[3:]) for change in unknowns.changes()]
    whole = run._tangents(changes, steps.tolist())[0][:, :, [4, 7]]
    np.testing.assert_allclose(by_rows.jacobian(run), whole[:, few].T, rtol=1e-9, atol=1e-14)
    assert by_columns.jacobian(run).shape == (12, unknowns_many)


def test_rest_lengths_from_a_hanging_shape():
    truth = net(5)
    shape = sprung.equilibrium(truth).positions
    moving = [1, 3, 4, 5, 7]
    noise = 1e-4 * np.random.default_rng(3).normal(size=(5, 3))
    start = truth.with_springs(rest_lengths=0.97 * truth.rest_lengths)
    found = sprung.fit(start, shape[moving] + noise, "rest_lengths", particles=moving)
    errors = found.standard_errors["rest_lengths"]
    assert found.success and (abs(found.rest_lengths - truth.rest_lengths) < 5 * errors).all() and (errors < 0.01).all()
    exact = sprung.fit(start, shape, {"rest_lengths": "common"})
    np.testing.assert_allclose(exact.rest_lengths, truth.rest_lengths, rtol=1e-8)


def test_gaps_in_the_measurements():
    truth = net(6)
    measured = motion(truth, STEPS)
    measured[::2, 4] = np.nan
    measured[:, :, 1] = np.nan
    found = sprung.fit(truth.with_springs(stiffness=1.1 * truth.stiffness), measured, steps=STEPS, dt=DT)
    np.testing.assert_allclose(found.stiffness, truth.stiffness, rtol=1e-6)
    measured[:, [0, 2, 6, 8]] = np.nan
    np.testing.assert_array_equal(np.isnan(found.residual), np.isnan(measured))


def test_wrong_arguments():
    system = net()
    measured = motion(system, STEPS)
    options = dict(steps=STEPS, dt=DT)
    for parameters in ("masses", ["stiffness", "mass"], {"k": "each"}):
        with pytest.raises(ValueError, match="must be stiffness, rest_lengths or damping"):
            sprung.fit(system, measured, parameters, **options)
    with pytest.raises(ValueError, match="must name at least one"):
        sprung.fit(system, measured, [], **options)
    with pytest.raises(ValueError, match=r"parameters\['stiffness'\] = 'all'"):
        sprung.fit(system, measured, {"stiffness": "all"}, **options)
    with pytest.raises(ValueError, match=r"parameters\['stiffness'\] = an array of shape \(3,\)"):
        sprung.fit(system, measured, {"stiffness": [0, 1, 2]}, **options)
    with pytest.raises(ValueError, match=r"measurements = an array of shape .*must have shape \(12, 9, 3\)"):
        sprung.fit(system, measured[:5], **options)
    with pytest.raises(ValueError, match=r"must have shape \(9, 3\)"):
        sprung.fit(system, measured)
    with pytest.raises(ValueError, match="measurements: must be finite"):
        sprung.fit(system, np.full_like(measured, np.nan), **options)
    with pytest.raises(ValueError, match="hold a free coordinate"):
        sprung.fit(system, measured[:, [0, 2]], particles=[0, 2], **options)
    with pytest.raises(ValueError, match="particles = "):
        sprung.fit(system, measured, particles=[9], **options)
    with pytest.raises(ValueError, match="one of the two"):
        sprung.fit(system, measured, times=DT * STEPS, **options)
    with pytest.raises(ValueError, match=r"times\[0\]: must be a whole number of steps"):
        sprung.fit(system, measured, times=DT * STEPS + 0.005, dt=DT)
    with pytest.raises(ValueError, match="ascends"):
        sprung.fit(system, measured, steps=STEPS[::-1], dt=DT)
    with pytest.raises(ValueError, match="have one"):
        sprung.fit(system, measured, method="w2", **options)
    with pytest.raises(ValueError, match=r"rest_lengths\[0\] = 0.0"):
        sprung.fit(system.with_springs(rest_lengths=0.0), measured, "rest_lengths", **options)
    with pytest.raises(ValueError, match="sigma"):
        sprung.fit(system, measured, sigma=0.0, **options)
    loose = sprung.System([[0.0, 0], [1, 0]], [[0, 1]], masses=1.0, stiffness=1.0)
    with pytest.raises(ValueError, match="'indifferent': a fit needs a stable one"):
        sprung.fit(loose, np.zeros((2, 2)))
