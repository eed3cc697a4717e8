"""MuJoCo: particles are bodies on three slides, springs the edges of one-dimensional flexes, all of one stiffness in each."""

import time
from functools import partial

import mujoco
import numpy as np

from .contender import Contender, explicit_steps

NAME = "MuJoCo"
# Steps that are too long are tried on purpose: no log of warnings in the folder that we happen to be in.
if hasattr(mujoco, "set_mju_user_warning"):
    mujoco.set_mju_user_warning(lambda message: None)
# What a step is made of beside the state, and the order that its documentation gives.
INTEGRATORS = {"Euler": ("mjINT_EULER", 1), "implicitfast": ("mjINT_IMPLICITFAST", 1), "RK4": ("mjINT_RK4", 4)}


def version():
    return mujoco.__version__


def model_of(scene):
    """The model, and the number of the first coordinate of every free particle."""
    spec = mujoco.MjSpec()
    spec.option.gravity = scene.gravity
    # Nothing touches and nothing is constrained; a state that is not finite stays as it is.
    spec.option.disableflags = (mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
                                | mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    for number, (position, mass, held) in enumerate(zip(scene.positions, scene.masses, scene.held)):
        body = spec.worldbody.add_body(name=f"p{number}", pos=position)
        if not held:
            # It slides without turning: the inertia has no effect, but must be positive.
            body.mass, body.inertia, body.explicitinertial = mass, [mass] * 3, True
            for axis in np.eye(3):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    kinds, kind_of = np.unique(np.stack([scene.per_length.round(9), scene.damping]), axis=1, return_inverse=True)
    lengths = []
    for number, (stiffness, damping) in enumerate(kinds.T):
        springs = np.flatnonzero(kind_of == number)
        ends, local = np.unique(scene.pairs[springs], return_inverse=True)
        spec.add_flex(name=f"f{number}", dim=1, edgestiffness=stiffness, edgedamping=damping, contype=0, conaffinity=0,
                      vertbody=[f"p{end}" for end in ends], vert=np.zeros(3 * len(ends)), elem=local.ravel())
        lengths.append((springs, ends))
    model = spec.compile()
    # Its edges in its own order, and rest lengths as the scene has them rather than as it lies.
    rest = {tuple(sorted(pair)): length for pair, length in zip(scene.pairs.tolist(), scene.rest_lengths)}
    for flex, (_, ends) in enumerate(lengths):
        first, count = model.flex_edgeadr[flex], model.flex_edgenum[flex]
        for edge in range(first, first + count):
            model.flexedge_length0[edge] = rest[tuple(sorted(ends[model.flex_edge[edge]].tolist()))]
    return model


def runs(scene):
    """`run(integrator, steps)`: positions at the end of the scene and the processor time in s that so many steps to it took."""
    model = model_of(scene)
    data = mujoco.MjData(model)
    free = ~scene.held

    def run(integrator, steps):
        mujoco.mj_resetData(model, data)
        data.qvel = scene.velocities[free].ravel()
        model.opt.integrator = getattr(mujoco.mjtIntegrator, integrator)
        model.opt.timestep = scene.duration / steps
        start = time.thread_time()
        mujoco.mj_step(model, data, steps)
        seconds = time.thread_time() - start
        positions = scene.positions.copy()
        positions[free] += data.qpos.reshape(-1, 3)
        return positions, seconds

    return run


def contenders(scene):
    run = runs(scene)

    def frame(integrator, per_frame):
        return run(integrator, scene.frames * per_frame)

    return [Contender(NAME, method, partial(frame, integrator), explicit_steps(scene), order)
            for method, (integrator, order) in INTEGRATORS.items()]
