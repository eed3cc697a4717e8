"""Runs: equal to the command's to the bit, and what they hand out, warn of and refuse."""

from __future__ import annotations

import csv
import json
import signal
import threading
import time
import warnings

import numpy as np
import pytest
import sprung
from conftest import tangle

pytestmark = pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")


def energies_of(folder):
    with open(folder / "energy.csv", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    columns = np.array(rows[1:], dtype=float).T
    return dict(zip(rows[0], columns))


def without_times(summary):
    """What two runs of one thing must have in common."""
    kept = {key: value for key, value in summary.items() if key not in ("wall_seconds", "warnings", "factor", "solver_choice")}
    kept["factor"] = {k: v for k, v in summary.get("factor", {}).items() if not k.endswith("seconds")}
    return json.loads(json.dumps(kept))


RUNS = {
    "default": ({}, {}),
    "fixed": ({}, {"dt": 0.01}),
    "divided": ({"method": "bdf2"}, {"dt": 0.0123}),
    "bdf2": ({"method": "bdf2", "stiffness": "tension"}, {"dt": 0.02}),
    "conjugate gradients": ({"solver": "cg", "preconditioner": "jacobi", "tolerance": 1e-6}, {"dt": 0.01}),
    "adaptive": ({}, {"rtol": 1e-3}),
    "adaptive with dt": ({"method": "bdf2"}, {"rtol": 1e-3, "dt": 0.05}),
    "newton": ({"method": "backward-euler", "solver": "ldlt"}, {"dt": 0.02}),
    "explicit": ({"method": "verlet"}, {"dt": 0.001}),
    "high order": ({"method": "dop853"}, {}),
    "auto": ({"method": "auto"}, {"dt": 0.01}),
    "accuracy": ({}, {"accuracy": 1e-2}),
}


@pytest.mark.parametrize("name", RUNS)
def test_runs_are_those_of_the_command_to_the_bit(name, run_command):
    made, ran = RUNS[name]
    system = tangle()
    arguments = [f"--{key}={value}" for key, value in {**made, **ran, "duration": 0.25}.items()]
    folder = run_command(system, *arguments)
    result = sprung.Stepper(system, **made).run(0.25, **ran)
    final = json.loads((folder / "final.json").read_text())
    np.testing.assert_array_equal(result.state.positions, final["positions"])
    np.testing.assert_array_equal(result.state.velocities, final["velocities"])
    assert (result.state.time, result.steps) == (final["time"], final["steps"])
    expected = energies_of(folder)
    assert list(result.energies) == list(expected)
    for column in expected:
        np.testing.assert_array_equal(result.energies[column], expected[column], err_msg=column)
    command = json.loads((folder / "summary.json").read_text())
    ours = {**result.summary, "scene": command["scene"]}
    assert without_times(ours) == without_times(command)


def test_frames_are_those_of_the_command_to_the_bit(run_command):
    system = tangle(dimension=2)
    folder = run_command(system, "--dt=0.01", "--duration=0.2", "--frames=3")
    with np.load(folder / "trajectory.npz") as kept:
        result = sprung.Stepper(system).run(0.2, dt=0.01, every=3)
        frames = len(kept["times"])
        np.testing.assert_array_equal(result.times[:frames], kept["times"])
        np.testing.assert_array_equal(result.positions[:frames], kept["positions"])
    np.testing.assert_array_equal(result.positions[-1], result.state.positions)
    np.testing.assert_array_equal(result.velocities[0], system.initial_state().velocities)
    assert result.times[-1] == 0.2 and len(result.energies["time"]) == 21


def test_steps_are_those_of_a_run():
    system = tangle()
    for method in ("linear-backward-euler", "bdf2", "w2", "verlet"):
        stepper, runner = sprung.Stepper(system, method=method), sprung.Stepper(system, method=method)
        for _ in range(10):
            stepper.step(0.01)
        runner.run(0.1, dt=0.01)
        # A sum of steps and a product are the same time but for rounding, and so is where moving constraints are.
        np.testing.assert_allclose(stepper.state.positions, runner.state.positions, rtol=0, atol=1e-13)
        assert stepper.statistics["work"]["force_evaluations"] > 0


def test_a_step_is_the_solution_of_the_handed_out_system():
    system = tangle()
    matrices = system.matrices(dt=0.01)
    stepper = sprung.Stepper(system, method="linear-backward-euler", stiffness="full", solver="llt")
    stepper.step(0.01)
    moved = system.gather(stepper.state.positions - system.initial_state().positions)
    expected = matrices.factor().solve(matrices.b)
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_stepping_goes_on_from_the_state_that_is_assigned():
    system = tangle()
    stepper = sprung.Stepper(system, method="bdf2")
    stepper.step(0.01)
    middle = stepper.state
    stepper.step(0.01)
    after = stepper.state.positions
    stepper.state = middle
    fresh = sprung.Stepper(system, middle, method="bdf2")
    stepper.step(0.01)
    fresh.step(0.01)
    np.testing.assert_array_equal(stepper.state.positions, fresh.state.positions)
    assert (stepper.state.positions != after).any() and stepper.state.time == middle.time + 0.01


def test_dense_output_lies_on_the_motion():
    system = sprung.System.ready("string")
    coarse = sprung.Stepper(system, method="dop853").run(0.2, rtol=1e-6, dt=0.01)
    fine = sprung.Stepper(system, method="dop853").run(0.2, rtol=1e-6, dt=0.0025)
    # Records lie between the method's own steps, whatever their interval.
    scale = abs(fine.positions - fine.positions.mean(axis=1, keepdims=True)).max()
    np.testing.assert_allclose(coarse.positions[:20], fine.positions[::4][:20], rtol=0, atol=1e-5 * scale)
    assert coarse.steps < len(fine.times)
    np.testing.assert_allclose(fine.at(fine.times), fine.positions, rtol=0, atol=1e-15)
    between = 0.5 * (fine.times[:-1] + fine.times[1:])
    moved = abs(np.diff(fine.positions, axis=0)).max()
    assert abs(fine.at(between) - fine.positions[:-1]).max() <= moved
    assert fine.at(0.1).shape == fine.positions.shape[1:]
    with pytest.raises(ValueError, match=r"times\[1\] = 0.3: must be within the run"):
        fine.at([0.1, 0.3])


def test_callbacks_see_every_frame_in_the_calling_thread():
    system = tangle()
    seen = []

    def callback(number, state):
        assert threading.current_thread() is threading.main_thread()
        seen.append((number, state.time, state.positions))

    result = sprung.Stepper(system).run(0.1, dt=0.01, every=2, callback=callback)
    assert [number for number, _, _ in seen] == [2, 4, 6, 8, 10]
    for (_, time, positions), frame_time, frame in zip(seen, result.times[1:], result.positions[1:]):
        assert time == frame_time
        np.testing.assert_array_equal(positions, frame)


def test_callbacks_may_end_a_run_or_fail():
    def stop(number, state):
        if number == 3:
            raise StopIteration

    def fail(number, state):
        raise KeyError("mine")

    def reenter(number, state):
        stepper.step(0.01)

    stepper = sprung.Stepper(tangle())
    result = stepper.run(0.1, dt=0.01, callback=stop)
    assert (result.status, result.steps, stepper.state.time) == ("interrupted", 3, 0.03)
    with pytest.raises(KeyError, match="mine"):
        stepper.run(0.1, dt=0.01, callback=fail)
    assert stepper.state.time == pytest.approx(0.04)
    with pytest.raises(RuntimeError, match="this stepper is computing"):
        stepper.run(0.1, dt=0.01, callback=reenter)
    stepper.step(0.01)


def test_broken_runs_keep_the_last_good_state():
    column = sprung.System.ready("column")
    stepper = sprung.Stepper(column, stiffness="full", solver="llt")
    with pytest.raises(sprung.Breakdown, match="indefinite in step") as raised:
        stepper.run(1.0, dt=0.1)
    broken = raised.value
    assert broken.status == "indefinite" and broken.result.status == "indefinite"
    assert stepper.state.time == broken.result.state.time < 1.0
    before = stepper.state
    with pytest.raises(sprung.Breakdown) as raised:
        stepper.step(0.1)
    assert raised.value.status == "indefinite" and raised.value.result is None
    np.testing.assert_array_equal(stepper.state.positions, before.positions)
    stiff = sprung.System([[0.0], [1.1]], [[0, 1]], masses=1e-3, stiffness=1e3, rest_lengths=1.0)
    with pytest.raises(sprung.Breakdown, match="unstable"):
        sprung.Stepper(stiff, method="symplectic-euler").run(1.0, dt=0.01)


def test_doubtful_runs_warn():
    pendulum = sprung.System.ready("pendulum")
    with pytest.warns(sprung.DoubtWarning, match="relative position error") as caught:
        result = sprung.Stepper(pendulum).run(1.0, dt=0.02)
    assert [str(warning.message) for warning in caught] == result.warnings
    assert result.error > 0.01 and result.error_kind == "indicator"
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        precise = sprung.Stepper(pendulum, method="bdf2").run(0.1, rtol=1e-4)
    assert precise.error < result.error and precise.warnings == []


def test_unusable_arguments_are_named():
    system = tangle()
    stepper = sprung.Stepper(system)
    for call, message in (
        (lambda: sprung.Stepper(system, method="rk4"), 'method = "rk4": must be one of linear-backward-euler, '),
        (lambda: sprung.Stepper(system, stiffness="none"), 'stiffness = "none": must be one of on-demand, progressive, full'),
        (lambda: sprung.Stepper(system, solver="lu"), 'solver = "lu": must be one of auto, llt'),
        (lambda: sprung.Stepper(system, preconditioner="ilu"), 'preconditioner = "ilu": must be one of none, jacobi'),
        (lambda: sprung.Stepper(system, tolerance=0.0), "tolerance = 0: must be finite and positive"),
        (lambda: stepper.step(-0.1), "dt = -0.1: must be finite and positive"),
        (lambda: stepper.run(0.0), "duration = 0: must be finite and positive"),
        (lambda: stepper.run(np.inf, dt=0.1), "duration = inf: must be finite and positive"),
        (lambda: stepper.run(1.0, dt="0.1"), "dt = an array of <U3"),
        (lambda: stepper.run(1.0, dt=1e-300), "dt = 1e-300: is too short"),
        (lambda: stepper.run(1.0, rtol=1.5), "rtol = 1.5: must be between 0 and 1"),
        (lambda: stepper.run(1.0, accuracy=0.0), "accuracy = 0: must be between 0 and 1"),
        (lambda: stepper.run(1.0, accuracy=0.1, rtol=0.1), "accuracy and rtol: give only one of the two"),
        (lambda: stepper.run(1.0, accuracy=0.1, callback=print), "callback: has no run to follow"),
        (lambda: stepper.run(1.0, every=0), "every = 0: must be a positive integer"),
        (lambda: sprung.Stepper(system, method="verlet").run(1.0, rtol=0.1), "verlet has none: use bdf2, w2"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    with pytest.raises(MemoryError, match="every=N keeps fewer frames"):
        stepper.run(1.0, dt=1e-12)


#: Some minutes of work each.
LONG = {
    "a run of short steps": (lambda: sprung.Stepper(tangle(), method="verlet"), 300.0, dict(dt=1e-5, every=10**9)),
    "adaptive steps": (lambda: sprung.Stepper(tangle()), 1e3, dict(rtol=1e-6, dt=1.0)),
    "a search": (lambda: sprung.Stepper(sprung.System.ready("cloth", 16)), 20.0, dict(accuracy=1e-5)),
}


@pytest.mark.parametrize("what", LONG)
def test_ctrl_c_ends_a_computation_early(what):
    made, duration, how = LONG[what]
    stepper = made()
    # In the background shells start programs that ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, lambda: signal.pthread_kill(threading.main_thread().ident, signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            stepper.run(duration, **how)
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)
    assert stepper.state.time < duration
    stepper.step(1e-5)


def test_other_threads_go_on_while_it_computes():
    counted = 0
    stop = threading.Event()

    def count():
        nonlocal counted
        while not stop.is_set():
            counted += 1
            time.sleep(0.0005)

    thread = threading.Thread(target=count)
    thread.start()
    before = counted
    sprung.Stepper(tangle(), method="verlet").run(2.0, dt=2e-5, every=10**6)
    during = counted - before
    stop.set()
    thread.join()
    assert during > 10


def test_threads_compute_side_by_side():
    system = tangle()
    alone = sprung.Stepper(system).run(0.2, dt=0.01).state.positions
    found = [None] * 6

    def compute(at):
        found[at] = sprung.Stepper(system).run(0.2, dt=0.01).state.positions

    threads = [threading.Thread(target=compute, args=(at,)) for at in range(len(found))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for positions in found:
        np.testing.assert_array_equal(positions, alone)
