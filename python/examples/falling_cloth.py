"""A cloth that sinks onto a stiff floor, which is a function of numpy's: the same motion by four methods.

With its derivatives the floor enters the matrices, and steps need not resolve it. Without them the same steps go wrong: backward Euler throws
the cloth off, Newton's method of BDF2 does not converge, and RODAS4, whose order hangs on exact derivatives, refuses.
"""

import numpy as np
import sprung

SIZE, SIDE, DURATION = 7, 0.8, 0.7
STIFFNESS, LOSS, DRAG = 2e4, 2.0, 0.05


def floor(positions, velocities, time):
    """Pushes up what is below it, more so what sinks in, and brakes everything as air does: `k d (1 - c v)` at the depth d, and `-b v`."""
    force = -DRAG * velocities
    depth = np.maximum(-positions[:, 1], 0)
    force[:, 1] += STIFFNESS * depth * (1 - LOSS * velocities[:, 1])
    return force


def derivatives(positions, velocities, time):
    """df/dx and df/dv, a block for each particle."""
    depth = np.maximum(-positions[:, 1], 0)
    stiffness, damping = np.zeros((2, len(positions), 3, 3))
    stiffness[:, 1, 1] = np.where(depth > 0, -STIFFNESS * (1 - LOSS * velocities[:, 1]), 0)
    damping[:] = -DRAG * np.eye(3)
    damping[:, 1, 1] -= STIFFNESS * LOSS * depth
    return stiffness, damping


def cloth(*forces):
    """A square that is held at one edge, 0.3 m above the floor."""
    number = np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
    side = SIDE / (SIZE - 1)
    across, along = np.meshgrid(np.arange(SIZE) * side, np.arange(SIZE) * side)
    positions = np.stack([along, np.full_like(along, 0.3), across], axis=-1).reshape(-1, 3)
    pairs = np.concatenate([
        np.stack([first.ravel(), second.ravel()], axis=1)
        for first, second in (
            (number[:-1], number[1:]),
            (number[:, :-1], number[:, 1:]),
            (number[:-1, :-1], number[1:, 1:]),
            (number[1:, :-1], number[:-1, 1:]),
        )
    ])  # fmt: skip
    return sprung.System(
        positions, pairs, masses=0.3 / SIZE**2, stiffness=40.0, damping=0.02, gravity=[0, -9.81, 0],
        constraints=[sprung.Constraint(number[0])], forces=forces, name="falling cloth",
    )  # fmt: skip


#: Of one motion, each method with steps that suit it: Verlet's have to resolve the floor, whose contacts take a millisecond.
RUNS = {
    "bdf2": {"dt": 2e-3},
    "linear-backward-euler": {"dt": 1e-3},
    "rodas4": {"rtol": 1e-2},
    "verlet": {"dt": 1e-4},
}


def ends(*forces):
    """Where the cloth is at the end by each method; nothing of one that breaks down or refuses."""
    found = {}
    for method, steps in RUNS.items():
        try:
            run = sprung.Stepper(cloth(*forces), method=method).run(DURATION, every=1000, **steps)
            found[method] = run.state.positions
        except (sprung.Breakdown, ValueError) as error:
            print(f"{method:22} {type(error).__name__}: {str(error).splitlines()[0][:90]}")
    return found


if __name__ == "__main__":
    exact = sprung.Stepper(cloth(sprung.ExternalForce(floor, derivatives)), method="dop853").run(DURATION, rtol=1e-6)
    for force in (sprung.ExternalForce(floor, derivatives), floor):
        print("without derivatives" if force is floor else "with derivatives")
        for method, positions in ends(force).items():
            off = 1e3 * abs(positions - exact.state.positions).max()
            print(f"{method:22} lowest point {1e3 * positions[:, 1].min():8.3f} mm, off by at most {off:8.3f} mm")
