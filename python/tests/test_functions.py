"""Forces and spring laws that are functions: they move systems as the library's own do, and what they raise is raised."""

from __future__ import annotations

import gc
import runpy
import threading
import traceback
import weakref

import numpy as np
import pytest
import sprung
from conftest import ROOT, tangle

pytestmark = pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")

METHODS = [
    "linear-backward-euler", "backward-euler", "bdf2", "w2", "rodas4", "implicit-midpoint", "verlet", "dop853", "forward-euler",
    "symplectic-euler",
]  # fmt: skip


def anchors(positions, velocities, time):
    """Pulls every particle to where it is to be, as a spring without a rest length does."""
    return -KAPPA * (positions - PLACES)


def of_anchors(positions, velocities, time):
    return np.broadcast_to(-KAPPA * np.eye(3), (len(positions), 3, 3)), None


KAPPA = 300.0
PLACES = np.random.default_rng(1).normal(size=(6, 3))
START = PLACES + 0.3 * np.random.default_rng(2).normal(size=(6, 3))
PAIRS = [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [0, 2]]
PLAIN = dict(masses=[1.0, 2.0, 1.5, 1.0, 3.0, 1.0], damping=0.4, gravity=[0, -9.81, 1.0])


def anchored(**changes):
    return sprung.System(START, PAIRS, stiffness=50.0, rest_lengths=1.3, **{**PLAIN, **changes})


def with_springs():
    """The same forces by springs to held particles."""
    ties = [[particle, 6 + particle] for particle in range(6)]
    return sprung.System(
        np.vstack([START, PLACES]), PAIRS + ties, masses=PLAIN["masses"] + [1.0] * 6, gravity=PLAIN["gravity"],
        stiffness=[50.0] * 6 + [KAPPA] * 6, rest_lengths=[1.3] * 6 + [0.0] * 6, damping=[0.4] * 6 + [0.0] * 6,
        constraints=[sprung.Constraint(range(6, 12))],
    )  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
def test_forces_with_derivatives_move_as_springs_do(method):
    system = anchored(forces=[sprung.ExternalForce(anchors, of_anchors)])
    ours, theirs = (sprung.Stepper(each, method=method).run(0.1, dt=0.004) for each in (system, with_springs()))
    np.testing.assert_allclose(ours.state.positions, theirs.state.positions[:6], rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.state.velocities, theirs.state.velocities[:6], rtol=0, atol=1e-7)


@pytest.mark.parametrize("run", [{}, {"rtol": 1e-5}, {"accuracy": 1e-3}])
def test_runs_of_any_kind_take_forces(run):
    system = anchored(forces=[sprung.ExternalForce(anchors, of_anchors)])
    ours, theirs = (sprung.Stepper(each).run(0.3, **run) for each in (system, with_springs()))
    np.testing.assert_allclose(ours.state.positions, theirs.state.positions[:6], rtol=0, atol=2e-2)
    assert ours.status == "completed"


def test_forces_enter_the_matrices(system):
    n, dimension = len(system.masses), system.dimension
    rng = np.random.default_rng(3)
    stiffness, damping = (-(b @ b.transpose(0, 2, 1)) for b in rng.normal(size=(2, n, dimension, dimension)))
    value, state = rng.normal(size=(n, dimension)), system.initial_state()
    seen = []

    def force(positions, velocities, time):
        seen.append((positions.copy(), velocities.copy(), time))
        positions[:] = np.nan  # they are this function's own
        return value

    state.time = 0.75
    more = system.with_forces(sprung.ExternalForce(force, lambda *at: (stiffness, None)))
    more = more.with_forces(sprung.ExternalForce(lambda *at: 2 * value, lambda *at: (None, damping)))
    np.testing.assert_allclose(more.force(state), system.force(state) + 3 * value, atol=1e-12)
    np.testing.assert_allclose(more.force(state, kind="external"), 3 * value, atol=1e-12)
    np.testing.assert_array_equal(seen[0][0], state.positions)
    np.testing.assert_array_equal(seen[0][1], state.velocities)
    assert seen[0][2] == 0.75
    before, after = system.matrices(state, dt=0.01), more.matrices(state, dt=0.01)
    row = system.dofs[:, 0] * dimension + system.dofs[:, 1]
    for name, blocks in (("K", stiffness), ("G", damping), ("A", -damping / 0.01 - stiffness)):
        expected = np.zeros((n, dimension, n, dimension))
        expected[np.arange(n), :, np.arange(n), :] = blocks
        expected = expected.reshape(n * dimension, n * dimension)[np.ix_(row, row)]
        difference = (getattr(after, name) - getattr(before, name)).toarray()
        np.testing.assert_allclose(difference, expected, atol=1e-9 * abs(before.A).max(), err_msg=name)
        product = after.operator(name) @ np.ones(len(row))
        np.testing.assert_allclose(product, getattr(after, name) @ np.ones(len(row)), atol=1e-9 * abs(before.A).max())
    assert sprung.inspect(more, state, dt=0.01).definite


def test_reactions_and_energies_see_functions():
    held = sprung.System([[0.0], [2.0]], [[0, 1]], masses=1.0, stiffness=3.0, rest_lengths=1.0, constraints=[sprung.Constraint(0)])
    system = held.with_forces(lambda x, v, t: np.full_like(x, 5.0))
    system = system.with_spring_law(lambda length, rest, k: (length**2, 2 * length, length**3 / 3))
    assert system.reactions().tolist() == [[-9.0], [0.0]]
    assert system.force(kind="elastic").tolist() == [[4.0], [-4.0]]
    assert system.energy().elastic == pytest.approx(8 / 3)
    assert held.energy().elastic == pytest.approx(1.5)


def test_forces_may_depend_on_time_and_on_all_particles():
    """Two free particles that are drawn to their midpoint, and shaken: the exact solution, to the fourth order where the rate is known."""

    def force(positions, velocities, time):
        return -4.0 * (positions - positions.mean(axis=0)) + np.cos(3 * time)

    blocks = lambda *at: (np.full((2, 1, 1), -4.0), None)  # noqa: E731
    rate = lambda positions, velocities, time: np.full_like(positions, -3 * np.sin(3 * time))  # noqa: E731
    ends = np.array([[-1.0], [1.0]])
    exact = ends * np.cos(2.0) + (1 - np.cos(3.0)) / 9
    system = sprung.System(ends, masses=1.0, forces=[force])
    result = sprung.Stepper(system, method="dop853").run(1.0, rtol=1e-9)
    np.testing.assert_allclose(result.state.positions, exact, atol=1e-8)
    assert abs(sprung.Stepper(system, method="bdf2").run(1.0, dt=0.01).state.positions - exact).max() < 1e-3
    # A force of its own on each particle, so that blocks say all.
    shaken = lambda x, v, t: -4.0 * x + np.cos(3 * t)  # noqa: E731
    exact = ends * np.cos(2.0) + (np.cos(2.0) - np.cos(3.0)) / 5
    errors = []
    for given in (rate, None):
        system = sprung.System(ends, masses=1.0, forces=[sprung.ExternalForce(shaken, blocks, given)])
        moved = sprung.Stepper(system, method="rodas4").run(1.0, dt=0.05).state.positions
        errors.append(abs(moved - exact).max())
    assert errors[0] < 1e-6 and errors[1] > 20 * errors[0]
    with pytest.raises(ValueError, match="rodas4"):
        sprung.Stepper(sprung.System(ends, masses=1.0, forces=[shaken]), method="rodas4").run(1.0, dt=0.05)


def builtin(lengths, rest_lengths, stiffness):
    strain = lengths / rest_lengths - 1
    return stiffness * strain, stiffness / rest_lengths, stiffness * rest_lengths * strain**2 / 2


LAWS = {"energy": builtin, "without": lambda *at: builtin(*at)[:2]}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_a_law_moves_as_the_one_that_it_is(method, law):
    plain = tangle(particles=12, springs=25)
    calls = []

    def counted(lengths, rest_lengths, stiffness):
        calls.append(lengths)
        np.testing.assert_array_equal(rest_lengths, plain.rest_lengths)
        np.testing.assert_array_equal(stiffness, plain.stiffness)
        return LAWS[law](lengths, rest_lengths, stiffness)

    ours, theirs = (
        sprung.Stepper(each, method=method).run(0.1, dt=0.002) for each in (plain.with_spring_law(counted), plain)
    )
    np.testing.assert_allclose(ours.state.positions, theirs.state.positions, rtol=0, atol=1e-7)
    for kind in ("elastic", "work", "dissipated"):
        np.testing.assert_allclose(ours.energies[kind], theirs.energies[kind], rtol=1e-5, atol=1e-5, err_msg=kind)
    # All springs in every call, and few calls an evaluation: for the force, for energies, and for prescribed motion.
    assert all(lengths.shape == (25,) for lengths in calls)
    if law == "energy":
        assert len(calls) <= 4 * ours.work["force_evaluations"] + 4 * ours.steps + 20


def test_a_law_of_many_springs_is_asked_once_for_all():
    """Enough springs for several threads to share them."""
    plain = sprung.System.ready("lattice", 16)
    calls = []

    def law(*at):
        calls.append(threading.get_ident())
        return builtin(*at)

    system, state = plain.with_spring_law(law), plain.initial_state()
    state.positions *= 1 + 0.01 * np.random.default_rng(0).normal(size=state.positions.shape)
    np.testing.assert_allclose(system.force(state), plain.force(state), atol=1e-9 * abs(plain.force(state)).max())
    assert len(calls) == 1
    ours, theirs = (sprung.Stepper(each, state, method="verlet").run(2e-3, dt=1e-3) for each in (system, plain))
    np.testing.assert_allclose(ours.state.positions, theirs.state.positions, atol=1e-9)
    assert len(calls) < 20


class Broken(Exception):
    pass


def failing(after):
    """A force that raises from a call on, until it is mended."""
    count = [0]

    def force(positions, velocities, time):
        count[0] += 1
        if count[0] > after:
            raise Broken(f"call {count[0]}")
        return anchors(positions, velocities, time)

    def mend():
        count[0] = -(10**9)

    return force, mend


@pytest.mark.parametrize("after", [0, 1, 7])
@pytest.mark.parametrize("method", METHODS)
def test_exceptions_end_a_run_and_the_stepper_goes_on(method, after):
    force, mend = failing(after)
    system = anchored(forces=[sprung.ExternalForce(force, of_anchors)])
    stepper = sprung.Stepper(system, method=method)
    with pytest.raises(Broken, match=f"^call {after + 1}$") as caught:
        stepper.run(0.1, dt=0.004)
    # Where it was raised, and who asked.
    assert {"force", "run"} <= {frame.name for frame in traceback.extract_tb(caught.value.__traceback__)}
    state = stepper.state
    assert np.isfinite(state.positions).all() and np.isfinite(state.velocities).all() and state.time < 0.1
    # The state is one of the undisturbed run.
    mend()
    whole = sprung.Stepper(system, method=method).run(0.1, dt=0.004)
    at = np.argmin(abs(whole.times - state.time))
    assert whole.times[at] == state.time
    np.testing.assert_array_equal(state.positions, whole.positions[at])
    result = stepper.run(0.1 - state.time, dt=0.004)
    np.testing.assert_allclose(result.state.positions, whole.state.positions, atol=1e-2)


@pytest.mark.parametrize("run", [{"rtol": 1e-4}, {"accuracy": 1e-3}, {}])
def test_exceptions_end_adaptive_runs(run):
    force, mend = failing(100)
    stepper = sprung.Stepper(anchored(forces=[sprung.ExternalForce(force, of_anchors)]))
    with pytest.raises(Broken, match="^call 101$"):
        stepper.run(1.0, **run)
    mend()
    assert stepper.run(0.1, **run).status == "completed"


@pytest.mark.parametrize("method", METHODS)
def test_exceptions_end_a_step(method):
    force, mend = failing(0)
    stepper = sprung.Stepper(anchored(forces=[sprung.ExternalForce(force, of_anchors)]), method=method)
    with pytest.raises(Broken):
        stepper.step(0.004)
    np.testing.assert_array_equal(stepper.state.positions, START)
    mend()
    stepper.step(0.004)
    assert stepper.state.time == 0.004


def test_exceptions_of_every_function_come_out():
    def raising(*at):
        raise Broken(at[2])

    good = anchors
    for force in (sprung.ExternalForce(good, raising), sprung.ExternalForce(good, of_anchors, raising)):
        system = anchored(forces=[force])
        with pytest.raises(Broken):
            sprung.Stepper(system, method="rodas4").run(0.1, dt=0.01)
    system = anchored(forces=[sprung.ExternalForce(raising, raising)])
    law = anchored(spring_law=raising)
    for ask in (
        lambda system: system.force(),
        lambda system: system.matrices(dt=0.01).A,
        lambda system: sprung.inspect(system, dt=0.01),
    ):
        for each in (system, law):
            with pytest.raises(Broken):
                ask(each)
    with pytest.raises(Broken):
        law.energy()
    with pytest.raises(Broken):
        sprung.Stepper(law).run(0.1)
    with pytest.raises(Broken):
        anchored(constraints=[sprung.Constraint(0)], spring_law=raising).reactions()


GIVEN = {
    "shape": (lambda x, v, t: x[0], r"forces\[0\] at t = 0 s = an array of shape \(3,\): must have the shape \(6, 3\)"),
    "one row": (lambda x, v, t: x[:1], r"an array of shape \(1, 3\)"),
    "type": (lambda x, v, t: x * 1j, r"forces\[0\] at t = 0 s = an array of complex128: must be an array of real numbers"),
    "nothing": (lambda x, v, t: None, r"forces\[0\] at t = 0 s = an array of object"),
    "nan": (lambda x, v, t: np.where(np.eye(6, 3, -2), np.nan, x), r"forces\[0\]\[2, 0\] at t = 0 s = nan: must be finite"),
}


@pytest.mark.parametrize("name", GIVEN)
def test_wrong_arrays_of_forces_are_named(name):
    function, message = GIVEN[name]
    stepper = sprung.Stepper(anchored(forces=[function]))
    with pytest.raises(ValueError, match=message):
        stepper.run(0.1, dt=0.01)
    with pytest.raises(ValueError, match=message):
        stepper.step(0.01)
    # Integers, views and lists are arrays too.
    for good in (lambda x, v, t: np.zeros((6, 3), dtype=int), lambda x, v, t: x[:, ::-1], lambda x, v, t: [[0, 0, 0]] * 6):
        sprung.Stepper(anchored(forces=[good])).run(0.02, dt=0.01)


BLOCKS = {
    "one": (np.zeros((6, 3, 3)), r"forces\[1\]\.derivatives at t = 0 s = a ndarray: must be \(stiffness, damping\)"),
    "shape": ((np.zeros((6, 3)), None), r"forces\[1\]\.derivatives: stiffness at t = 0 s = an array of shape \(6, 3\)"),
    "inf": ((None, np.full((6, 3, 3), np.inf)), r"forces\[1\]\.derivatives: damping\[0, 0, 0\] at t = 0 s = inf"),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_wrong_arrays_of_derivatives_are_named(name):
    given, message = BLOCKS[name]
    system = anchored(forces=[anchors]).with_forces(sprung.ExternalForce(anchors, lambda *at: given))
    with pytest.raises(ValueError, match=message):
        sprung.Stepper(system).run(0.1, dt=0.01)


LAW = {
    "one": (lambda *at: at[0], r"spring_law = a ndarray: must be \(tension, slope\) or \(tension, slope, energy\)"),
    "shape": (lambda *at: (at[0], 1.0), r"spring_law: slope = an array of shape \(\): must have the shape \(6,\)"),
    "nan": (lambda *at: (at[0] * np.nan, at[0]), r"spring_law: tension\[0\] = nan: must be finite"),
    "energy": (lambda *at: (at[0], at[0], at[0][1:]), r"spring_law: energy = an array of shape \(5,\)"),
}


@pytest.mark.parametrize("name", LAW)
def test_wrong_arrays_of_laws_are_named(name):
    function, message = LAW[name]
    with pytest.raises(ValueError, match=message):
        sprung.Stepper(anchored(spring_law=function)).run(0.1, dt=0.01)


def test_what_is_no_function_is_named():
    with pytest.raises(ValueError, match=r"forces\[1\] = 3: must be a function"):
        anchored(forces=[anchors, 3])
    with pytest.raises(ValueError, match=r"forces\[1\]\.rate = 3: must be a function"):
        anchored(forces=[anchors]).with_forces(sprung.ExternalForce(anchors, rate=3))
    with pytest.raises(ValueError, match="forces = <function"):
        anchored(forces=anchors)
    with pytest.raises(ValueError, match="spring_law = 3: must be a function"):
        anchored(spring_law=3)


def test_functions_cannot_be_written(tmp_path):
    for system in (anchored(forces=[anchors]), anchored(spring_law=builtin)):
        for write in (system.to_toml, system.to_json, lambda: system.save(tmp_path / "scene.toml")):
            with pytest.raises(ValueError, match="cannot be written to a scene file"):
                write()


def test_several_threads_call_back_at_once():
    """Runs of one system in several threads have the bits of one alone; one that raises disturbs no other."""
    barrier = threading.Barrier(4)
    system = anchored(forces=[sprung.ExternalForce(anchors, of_anchors)], spring_law=builtin)
    alone = sprung.Stepper(system, method="bdf2").run(0.3, dt=0.002).positions
    outcomes: list = [None] * 4

    def late(positions, velocities, time):
        if time > 0.1:
            raise Broken
        return np.zeros_like(positions)

    def work(number):
        stepper = sprung.Stepper(system.with_forces(late) if number == 3 else system, method="bdf2")
        barrier.wait()
        try:
            outcomes[number] = stepper.run(0.3, dt=0.002).positions
        except Broken as error:
            outcomes[number] = error

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    for found in outcomes[:3]:
        np.testing.assert_array_equal(found, alone)
    assert isinstance(outcomes[3], Broken)


def test_one_system_raises_where_it_was_asked():
    """Two steppers of one system: each gets its own exceptions."""
    bad = threading.Event()

    def force(positions, velocities, time):
        if time > 0.05 and positions[0, 0] > 50:
            bad.set()
            raise Broken
        return np.zeros_like(positions)

    system = sprung.System([[0.0]], masses=1.0, forces=[force])
    far = system.initial_state()
    far.positions += 100
    found: list = []

    def work():
        with pytest.raises(Broken):
            sprung.Stepper(system, far, method="verlet").run(1.0, dt=0.01)
        found.append("raised")

    thread = threading.Thread(target=work)
    thread.start()
    for _ in range(20):
        assert sprung.Stepper(system, method="verlet").run(1.0, dt=0.01).status == "completed"
    thread.join()
    assert found == ["raised"] and bad.is_set()


def test_functions_may_compute_in_turn():
    """A force that is that of another system, which moves meanwhile, on however many threads there are."""
    other = anchored()
    inner = sprung.Stepper(other, method="verlet")

    def force(positions, velocities, time):
        state = other.initial_state()
        state.positions = positions
        inner.run(0.01, dt=0.005)
        return other.force(state, kind="weight")

    system = sprung.System(START, masses=PLAIN["masses"], forces=[force])
    expected = sprung.System(START, masses=PLAIN["masses"], gravity=PLAIN["gravity"])
    ours, theirs = (sprung.Stepper(each, method="verlet").run(0.1, dt=0.01) for each in (system, expected))
    np.testing.assert_allclose(ours.state.positions, theirs.state.positions, atol=1e-12)
    assert inner.state.time > 0.1


def test_a_stepper_is_not_to_be_asked_by_its_own_force():
    system = anchored(forces=[lambda x, v, t: stepper.state.positions])
    stepper = sprung.Stepper(system)
    with pytest.raises(RuntimeError, match="this stepper is computing"):
        stepper.run(0.1, dt=0.01)


def test_functions_that_refer_to_their_system_go_with_it():
    def make():
        def force(positions, velocities, time):
            return np.zeros_like(positions) * len(system.masses)

        system = anchored(forces=[sprung.ExternalForce(force, of_anchors)], spring_law=lambda *at: builtin(*at))
        sprung.Stepper(system).run(0.02, dt=0.01)
        return weakref.ref(force)

    kept = make()
    gc.collect()
    assert kept() is None


def test_a_stiff_floor_is_the_same_for_all_methods():
    """With its blocks steps of one or two milliseconds find the motion of steps of a tenth; without, they do not."""
    scene = runpy.run_path(str(ROOT / "python/examples/falling_cloth.py"))
    floor = scene["floor"]
    found = scene["ends"](sprung.ExternalForce(floor, scene["derivatives"]))
    assert set(found) == {"bdf2", "linear-backward-euler", "rodas4", "verlet"}
    for positions in found.values():
        assert abs(positions - found["verlet"]).max() < 2e-3
        assert abs(positions[:, 1].min()) < 1e-4
    plain = scene["ends"](floor)
    np.testing.assert_array_equal(plain["verlet"], found["verlet"])
    assert "rodas4" not in plain
    for method in ("bdf2", "linear-backward-euler"):
        assert method not in plain or abs(plain[method] - found["verlet"]).max() > 0.01


def test_the_derivatives_of_the_floor_are_right():
    scene = runpy.run_path(str(ROOT / "python/examples/falling_cloth.py"))
    rng = np.random.default_rng(0)
    x, v = 0.01 * rng.normal(size=(2, 8, 3))
    for index, blocks in enumerate(scene["derivatives"](x, v, 0.0)):
        for axis in range(3):
            step = np.zeros((2, 8, 3))
            step[index, :, axis] = 1e-7
            above, below = (scene["floor"](x + sign * step[0], v + sign * step[1], 0.0) for sign in (1, -1))
            np.testing.assert_allclose((above - below) / 2e-7, blocks[:, :, axis], rtol=1e-5, atol=1e-4)
