"""Newton on Warp's processor device: vertex block descent, XPBD and semi-implicit Euler, in single precision.

Pairs of steps are recorded and replayed, so that Python's time is not part of theirs.
"""

import time
from functools import partial

import newton
import numpy as np
import warp as wp

from .contender import Contender, explicit_steps
from .scene import RATE

NAME = "Newton"
# Iterations a step: Newton's default, and more, with which fewer steps may do.
ITERATIONS = {"VBD": (newton.solvers.SolverVBD, (10, 100)), "XPBD": (newton.solvers.SolverXPBD, (2, 20))}


def version():
    wp.config.quiet = True
    return f"{newton.__version__} on Warp {wp.config.version}"


def colours(count, pairs):
    """Groups of particles none of which are joined, greedily; Newton colours meshes, but not springs."""
    neighbours = [[] for _ in range(count)]
    for i, j in pairs.tolist():
        neighbours[i].append(j)
        neighbours[j].append(i)
    colour = [-1] * count
    for particle in range(count):
        taken = {colour[other] for other in neighbours[particle]}
        colour[particle] = next(c for c in range(count) if c not in taken)
    return [np.flatnonzero(np.array(colour) == c) for c in range(max(colour) + 1)]


def model_of(scene):
    builder = newton.ModelBuilder()
    count = len(scene.masses)
    active = int(newton.ParticleFlags.ACTIVE)
    builder.add_particles([wp.vec3(*x) for x in scene.positions], [wp.vec3(*v) for v in scene.velocities],
                          np.where(scene.held, 0.0, scene.masses).tolist(), radius=[0.0] * count,
                          flags=[0 if held else active for held in scene.held])
    for (i, j), stiffness, damping in zip(scene.pairs.tolist(), scene.per_length, scene.damping):
        builder.add_spring(i, j, stiffness, damping, 0.0)
    builder.spring_rest_length[:] = scene.rest_lengths.tolist()
    builder.set_coloring(colours(count, scene.pairs))
    model = builder.finalize(device="cpu")
    model.set_gravity(tuple(scene.gravity))
    return model


def contenders(scene):
    model = model_of(scene)
    states = [model.state(), model.state()]
    start = [(wp.clone(state.particle_q), wp.clone(state.particle_qd)) for state in states]

    def run(solver, per_frame):
        dt = 1 / (RATE * per_frame)
        with wp.ScopedCapture(device="cpu") as pair:
            for state_in, state_out in (states, states[::-1]):
                state_in.clear_forces()
                solver.step(state_in, state_out, None, None, dt)
        for state, (positions, velocities) in zip(states, start):
            wp.copy(state.particle_q, positions)
            wp.copy(state.particle_qd, velocities)
        steps, rest = divmod(scene.frames * per_frame, 2)
        if rest:
            raise ValueError("an even number of frames, please")
        begun = time.process_time()
        for _ in range(steps):
            wp.capture_launch(pair.graph)
        seconds = time.process_time() - begun
        return states[0].particle_q.numpy().astype(float), seconds

    found = [Contender(NAME, f"{method}, {count} iterations", partial(run, make(model, iterations=count)))
             for method, (make, counts) in ITERATIONS.items() for count in counts]
    explicit = newton.solvers.SolverSemiImplicit(model)
    return [*found, Contender(NAME, "semi-implicit", partial(run, explicit), explicit_steps(scene))]
