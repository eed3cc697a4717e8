"""Gradients through motions beside differences of the motions themselves."""

from __future__ import annotations

import signal
import threading
import time
import warnings

import numpy as np
import pytest
import sprung

METHODS = ["backward-euler", "implicit-midpoint", "bdf2", "verlet"]
KINDS = ["stiffness", "rest_lengths", "damping", "masses", "gravity", "positions", "velocities"]
T, DT = 0.3, 0.02

PAIRS = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [0, 2], [1, 3], [2, 4], [3, 5], [1, 4]])


def given(seed: int = 0, damping: float = 1.0) -> dict:
    """A random net: stretched, compressed and damped."""
    rng = np.random.default_rng(seed)
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 1], [2, 0, 1], [3, 0, 0]]) + rng.normal(0, 0.1, (6, 3))
    lengths = np.linalg.norm(positions[PAIRS[:, 0]] - positions[PAIRS[:, 1]], axis=1)
    return dict(
        positions=positions,
        velocities=rng.normal(0, 0.5, (6, 3)),
        masses=rng.uniform(0.5, 1.5, 6),
        stiffness=rng.uniform(20, 60, 10),
        rest_lengths=lengths * rng.uniform(0.9, 1.15, 10),
        damping=damping * rng.uniform(0.1, 0.8, 10),
        gravity=rng.normal(0, 3.0, 3),
    )


def system_of(arguments: dict, **changes) -> sprung.System:
    constraints = [sprung.Constraint(0), sprung.Constraint(1, axes="y")]
    return sprung.System(pairs=PAIRS, **{"constraints": constraints, **arguments, **changes})


def differentiable(arguments: dict, method: str, **options) -> sprung.DifferentiableRun:
    return sprung.Stepper(system_of(arguments), method=method).run(T, dt=DT, differentiable=True, **options)


def ordinary(arguments: dict, method: str):
    """An ordinary run; of bdf2, which takes one iteration a step there, one whose steps are solved."""
    if method == "bdf2":
        return differentiable(arguments, method)
    return sprung.Stepper(system_of(arguments), method=method, tolerance=1e-14).run(T, dt=DT)


def slope(cost, arguments: dict, kind: str, direction: np.ndarray) -> float:
    """The derivative along a direction, by central differences of fourth order."""
    h = 2e-3 * np.linalg.norm(arguments[kind]) / np.linalg.norm(direction)
    plus, minus, far, back = (cost({**arguments, kind: arguments[kind] + k * h * direction}) for k in (1, -1, 2, -2))
    return (8 * (plus - minus) - (far - back)) / (12 * h)


@pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", METHODS)
def test_gradients_are_differences_of_ordinary_runs(method, kind):
    arguments = given()
    rng = np.random.default_rng(1)
    x, v = rng.normal(size=(2, 6, 3))
    direction = rng.normal(size=arguments[kind].shape)

    def cost(changed):
        end = ordinary(changed, method).state
        return np.sum(x * end.positions) + np.sum(v * end.velocities)

    run = differentiable(arguments, method)
    gradient = run.gradient(positions=x, velocities=v, check=False)
    assert getattr(gradient, kind).shape == arguments[kind].shape
    expected = np.sum(getattr(gradient, kind) * direction)
    assert abs(expected) > 1e-4
    assert slope(cost, arguments, kind, direction) == pytest.approx(expected, rel=2e-6, abs=1e-8)


@pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")
@pytest.mark.parametrize("method", ["backward-euler", "implicit-midpoint", "verlet"])
def test_a_differentiable_run_is_the_ordinary_run(method):
    run, plain = differentiable(given(), method), ordinary(given(), method)
    assert run.steps == plain.steps == len(run.times) - 1 == 15 and run.status == "completed"
    np.testing.assert_allclose(run.times, plain.times, atol=1e-12)
    np.testing.assert_allclose(run.positions, plain.positions, atol=1e-9)
    np.testing.assert_allclose(run.velocities, plain.velocities, atol=1e-7)
    np.testing.assert_array_equal(run.state.positions, run.positions[-1])


@pytest.mark.parametrize("method", METHODS)
def test_records_on_the_way(method):
    """A cost that looks at several states, by differences of runs; gradients add up."""
    arguments = given(2)
    rng = np.random.default_rng(3)
    weights = {step: rng.normal(size=(2, 6, 3)) for step in (0, 4, 9, 15)}
    direction = rng.normal(size=10)

    def cost(changed):
        run = differentiable(changed, method)
        return sum(np.sum(x * run.positions[k]) + np.sum(v * run.velocities[k]) for k, (x, v) in weights.items())

    run = differentiable(arguments, method)
    records = [(step, x, v) for step, (x, v) in weights.items()]
    gradient = run.gradient(records=records, check=False)
    for kind in ("stiffness", "rest_lengths"):
        expected = np.sum(getattr(gradient, kind) * direction)
        assert slope(cost, arguments, kind, direction) == pytest.approx(expected, rel=2e-6)
    parts = [run.gradient(records=[record], check=False) for record in records]
    np.testing.assert_allclose(sum(part.masses for part in parts), gradient.masses, rtol=1e-9)
    end = run.gradient(records=[(15, *weights[15])], check=False)
    np.testing.assert_array_equal(run.gradient(*weights[15], check=False).positions, end.positions)
    # At the start a cost depends on free coordinates only through themselves.
    start = run.gradient(records=[(0, weights[0][0], None)], check=False)
    np.testing.assert_array_equal(start.positions, weights[0][0])
    assert not start.stiffness.any()
    only = run.gradient(records=[(4, None, weights[4][1])], check=False)
    assert only.damping.any()


@pytest.mark.parametrize("method", METHODS)
def test_checkpoints_give_the_same_bits(method):
    rng = np.random.default_rng(4)
    x, v, way = rng.normal(size=(3, 6, 3))
    whole = differentiable(given(), method).gradient(x, v, records=[(5, way, None)], check=False)
    for checkpoints in (2, 3, 5, 100):
        run = differentiable(given(), method, checkpoints=checkpoints)
        assert len(run.times) == (16 if checkpoints > 15 else 2)
        found = run.gradient(x, v, records=[(5, way, None)], check=False)
        for kind in (*KINDS, "loads"):
            np.testing.assert_array_equal(getattr(found, kind), getattr(whole, kind), err_msg=f"{kind}, {checkpoints}")
        moved = run.tangent(stiffness=np.ones(10), steps=[0, 3, 15])
        np.testing.assert_array_equal(moved, differentiable(given(), method).tangent(stiffness=np.ones(10), steps=[0, 3, 15]))


@pytest.mark.parametrize("method", METHODS)
def test_tangents_are_the_adjoint_of_gradients(method):
    run = differentiable(given(6), method)
    rng = np.random.default_rng(5)
    change = {kind: rng.normal(size=np.shape(given(6)[kind])) for kind in KINDS} | {"loads": rng.normal(size=(6, 3))}
    steps = [0, 1, 7, 15]
    positions, velocities = run.tangent(**change, steps=steps)
    assert positions.shape == velocities.shape == (4, 6, 3)
    for step, moved, faster in zip(steps, positions, velocities):
        x, v = rng.normal(size=(2, 6, 3))
        gradient = run.gradient(records=[(step, x, v)], check=False)
        forward = np.sum(x * moved) + np.sum(v * faster)
        backward = sum(np.sum(getattr(gradient, kind) * value) for kind, value in change.items())
        # Velocities of held coordinates are prescribed.
        assert forward == pytest.approx(backward, rel=1e-10)
    last = run.tangent(**change)
    np.testing.assert_array_equal(last[0][0], positions[-1])


def test_springs_without_rest_length_drag_and_loads():
    """What only scene files have is differentiated too."""
    scene = """
    gravity = [0.0, -3.0]
    drag = { coefficient = 0.4 }
    [particles]
    positions = [[0, 0], [1, 0.2], [2, 0], [1.2, -1]]
    masses = 1.3
    [springs]
    pairs = [[0, 1], [1, 2], [1, 3], [2, 3]]
    stiffness = [30, 40, 20, 25]
    rest_lengths = [0, 1.0, 1.1, 0]
    damping = 0.2
    [[constraints]]
    particles = [0]
    [[forces]]
    particles = [3]
    value = [1.0, 0.5]
    """
    system = sprung.System.parse(scene)
    weights = np.random.default_rng(0).normal(size=(4, 2))
    stiffness = np.array([30.0, 40, 20, 25])
    direction = np.array([1.0, -2.0, 3.0, 0.5])

    for method in METHODS:

        def run(k, method=method):
            return sprung.Stepper(system.with_springs(stiffness=k), method=method).run(T, dt=DT, differentiable=True)

        gradient = run(stiffness).gradient(weights, check=False)
        difference = [np.sum(weights * run(stiffness + h * direction).state.positions) for h in (1e-3, -1e-3)]
        assert (difference[0] - difference[1]) / 2e-3 == pytest.approx(gradient.stiffness @ direction, rel=1e-6), method
        start = system.initial_state()
        moving = np.random.default_rng(1).normal(size=(4, 2))
        moving[0] = 0.0
        ends = []
        for h in (1e-5, -1e-5):
            state = sprung.State(start.positions, h * moving)
            ends.append(np.sum(weights * sprung.Stepper(system, state, method=method).run(T, dt=DT, differentiable=True).state.positions))
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(np.sum(gradient.velocities * moving), rel=1e-6), method


def test_methods_without_a_gradient_name_those_with_one():
    system = system_of(given())
    for method in ("linear-backward-euler", "w2", "rodas4", "dop853", "forward-euler", "symplectic-euler", "auto"):
        with pytest.raises(ValueError, match="backward-euler, implicit-midpoint, bdf2 and verlet have one"):
            sprung.Stepper(system, method=method).run(T, dt=DT, differentiable=True)
    with pytest.raises(ValueError, match="method: must be named"):
        sprung.Stepper(system).run(T, dt=DT, differentiable=True)


def test_systems_without_a_gradient():
    system = system_of(given())
    law = system.with_spring_law(lambda length, rest, k: (k * (length / rest - 1), k / rest))
    pushed = system.with_forces(lambda x, v, t: -x)
    for each in (law, pushed):
        with pytest.raises(ValueError, match="built-in spring law"):
            sprung.Stepper(each, method="bdf2").run(T, dt=DT, differentiable=True)
    moved = system_of(given(), constraints=[sprung.Constraint(0, velocity=[0, 0, 1])])
    with pytest.raises(ValueError, match="moving constraints"):
        sprung.Stepper(moved, method="verlet").run(T, dt=DT, differentiable=True)


@pytest.mark.parametrize("method", ["backward-euler", "implicit-midpoint", "bdf2"])
def test_moving_constraints(method):
    arguments = given()
    weights = np.random.default_rng(7).normal(size=(6, 3))

    def run(**changes):
        constraints = [sprung.Constraint(0, velocity=[0.2, 0, 0.5]), sprung.Constraint(5, axes="z", path=([0, 0.11, 1], [[0, 0, 0], [0, 0, 0.1], [0, 0, 0]]))]
        return sprung.Stepper(system_of({**arguments, **changes}, constraints=constraints), method=method).run(T, dt=DT, differentiable=True)

    gradient = run().gradient(weights, check=False)
    for kind in ("stiffness", "positions", "damping"):
        direction = np.random.default_rng(8).normal(size=arguments[kind].shape)
        ends = [np.sum(weights * run(**{kind: arguments[kind] + h * direction}).state.positions) for h in (1e-5, -1e-5)]
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(np.sum(getattr(gradient, kind) * direction), rel=1e-6)


def test_wrong_arguments():
    stepper = sprung.Stepper(system_of(given()), method="verlet")
    for options in (dict(rtol=1e-3), dict(accuracy=1e-3), dict(callback=print)):
        with pytest.raises(ValueError, match="differentiable"):
            stepper.run(T, dt=DT, differentiable=True, **options)
    with pytest.raises(ValueError, match="checkpoints"):
        stepper.run(T, dt=DT, checkpoints=4)
    for checkpoints in (1, 0, 2.5, True):
        with pytest.raises(ValueError, match="checkpoints = .*at least 2"):
            stepper.run(T, dt=DT, differentiable=True, checkpoints=checkpoints)
    with pytest.raises(ValueError, match="duration"):
        stepper.run(-1.0, dt=DT, differentiable=True)
    run = stepper.run(T, dt=DT, differentiable=True)
    for wrong in (np.zeros((5, 3)), np.zeros((6, 2)), np.zeros(6), [["a"] * 3] * 6):
        with pytest.raises(ValueError, match="positions = "):
            run.gradient(wrong)
        with pytest.raises(ValueError, match=r"records\[0\]\.velocities = "):
            run.gradient(records=[(3, None, wrong)])
    for step in (-1, 16, 1.0, True, "end"):
        with pytest.raises(ValueError, match=r"records\[0\] = step"):
            run.gradient(records=[(step, None, None)])
    with pytest.raises(ValueError, match=r"stiffness = an array of shape \(3,\): must have shape \(10,\)"):
        run.tangent(stiffness=np.ones(3))
    for steps in ([16], [-1], [3, 3], [5, 2]):
        with pytest.raises(ValueError, match="steps = "):
            run.tangent(stiffness=np.ones(10), steps=steps)


def test_the_stepper_goes_on_from_the_end():
    stepper = sprung.Stepper(system_of(given()), method="implicit-midpoint")
    first = stepper.run(0.1, dt=DT, differentiable=True)
    np.testing.assert_array_equal(stepper.state.positions, first.state.positions)
    second = stepper.run(0.1, dt=DT, differentiable=True)
    assert second.times[0] == first.times[-1] and second.state.time == pytest.approx(0.2)
    # The last step is shorter where dt does not divide the duration.
    third = stepper.run(0.05, dt=DT, differentiable=True)
    assert third.steps == 3 and third.state.time == pytest.approx(0.25)
    none = stepper.run(0.0, dt=DT, differentiable=True)
    assert none.steps == 0 and len(none.times) == 1
    weights = np.ones((6, 3))
    np.testing.assert_array_equal(none.gradient(weights).positions, weights)


def test_chaos_is_told():
    """A pendulum of three bobs tumbles: soon its gradients are those of rounding."""
    system = sprung.System(
        [[0, 0], [1, 0.3], [2, 0.5], [2.5, 1.2]], [[0, 1], [1, 2], [2, 3]], masses=1.0, stiffness=2000.0, gravity=[0, -9.81],
        constraints=[sprung.Constraint(0)],
    )  # fmt: skip
    weights = np.ones((4, 2))
    short = sprung.Stepper(system, method="implicit-midpoint").run(0.5, dt=0.01, differentiable=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        short.gradient(weights)
    long = sprung.Stepper(system, method="implicit-midpoint").run(10.0, dt=0.01, differentiable=True)
    with pytest.warns(sprung.DoubtWarning, match="errors are as large as the motion itself"):
        found = long.gradient(weights)
    assert abs(found.positions).max() > 1e6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        long.gradient(weights, check=False)
    assert repr(long) == "<DifferentiableRun of 1000 steps to t = 10 s>"


def test_a_step_that_breaks_down():
    """Explicit steps far beyond stability overflow, and a spring that comes to length zero has no direction."""
    arguments = given(damping=0.0)
    stepper = sprung.Stepper(system_of({**arguments, "stiffness": 1e6 * np.ones(10)}), method="verlet")
    start = stepper.state.positions.copy()
    with pytest.raises(sprung.Breakdown, match=r"step \d+, from t = .*broke down") as raised:
        stepper.run(100.0, dt=1.0, differentiable=True)
    assert raised.value.status == "non-finite" and raised.value.result is None
    np.testing.assert_array_equal(stepper.state.positions, start)
    meet = sprung.System([[0.0], [1.0]], [[0, 1]], masses=1.0, stiffness=1.0, rest_lengths=1.0, velocities=[[0.5], [-0.5]])
    with pytest.raises(sprung.Breakdown) as raised:
        sprung.Stepper(meet, method="verlet").run(3.0, dt=1.0, differentiable=True)
    assert raised.value.status == "degenerate-spring"


def interrupted(task):
    """Sends Ctrl-C to this process while the task computes; says how long the task went on."""
    # In the background shells start programs that ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, lambda: signal.pthread_kill(threading.main_thread().ident, signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            task()
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)
    return time.monotonic() - begun


@pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")
def test_ctrl_c_ends_runs_gradients_and_tangents():
    system = sprung.System.ready("cloth", 12)
    stepper = sprung.Stepper(system, method="verlet")
    assert interrupted(lambda: stepper.run(100.0, dt=1e-4, differentiable=True, checkpoints=3)) < 10
    assert stepper.state.time == 0
    run = stepper.run(2.0, dt=1e-4, differentiable=True, checkpoints=3)
    weights = np.ones(run.state.positions.shape)
    assert interrupted(lambda: run.gradient(weights, check=False)) < 10
    # The run is as good as before.
    short = stepper.run(0.01, dt=1e-4, differentiable=True)
    assert short.gradient(weights, check=False).positions.shape == weights.shape
