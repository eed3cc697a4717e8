"""Nothing is lost and nothing is kept: reference counts, memory, order of deletion, forked processes."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import weakref

import numpy as np
import pytest
import sprung
from conftest import tangle


def resident() -> int:
    """Bytes of this process in memory."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="no /proc here")
def test_ten_thousand_steps_take_no_memory():
    system = tangle()
    stepper = sprung.Stepper(system, method="bdf2")

    def steps(count):
        for _ in range(count):
            stepper.step(0.001)
            assert stepper.state.positions.shape == (40, 3)

    def others(count):
        for _ in range(count):
            matrices = system.matrices(dt=0.01)
            matrices.factor().solve(matrices.b)
            matrices.operator() @ matrices.b
            sprung.Stepper(system).run(0.02, dt=0.01, callback=lambda number, state: None)

    for work, count in ((steps, 10_000), (others, 500)):
        work(count // 10)
        gc.collect()
        before = resident()
        work(count)
        gc.collect()
        # The arrays handed out in the meantime are some 20 MB in steps, and over 100 MB in the others.
        assert resident() - before < 8e6


def test_reference_counts_come_back():
    system = tangle()
    state = system.initial_state()
    count = [0]

    def callback(number, state):
        count[0] += 1

    def force(x):
        return -x

    kept = (system, system._native, state, state.positions, state.velocities, callback, force)
    before = [sys.getrefcount(each) for each in kept]
    for _ in range(20):
        matrices = system.matrices(state, 0.01)
        matrices.factor().solve(matrices.b)
        matrices.operator() @ matrices.b
        stepper = sprung.Stepper(system, state)
        stepper.run(0.02, dt=0.01, callback=callback)
        stepper.step(0.01)
        sprung.check_jacobian(force, -np.eye(3), np.ones(3))
        sprung.inspect(system, state, 0.01)
        with pytest.raises(ValueError):
            system.matrices(state, -1.0)
        del matrices, stepper
    gc.collect()
    assert [sys.getrefcount(each) for each in kept] == before and count[0] == 40


def test_results_outlive_what_they_came_from():
    system = tangle()
    died = weakref.ref(system)
    stepper = sprung.Stepper(system)
    matrices, operator = system.matrices(dt=0.01), system.operator(dt=0.01)
    b = matrices.b.copy()
    del system
    stepper.step(0.01)
    factor = matrices.factor()
    del matrices
    positions = stepper.state.positions
    del stepper
    gc.collect()
    assert died() is None
    assert np.isfinite(factor.solve(b)).all() and np.isfinite(operator @ b).all() and np.isfinite(positions).all()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no processes are forked here")
def test_forked_processes_compute_too():
    program = """
import multiprocessing, sprung
def compute(_):
    return sprung.Stepper(sprung.System.ready("chain")).run(0.05, dt=0.01).state.positions.tobytes()
if __name__ == "__main__":
    here = compute(0)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(compute, range(4), 1) == [here] * 4
"""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", program], timeout=120, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
