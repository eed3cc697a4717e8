"""Taichi, a language rather than a simulator: mass-spring programs as its examples write them, in double precision.

Symplectic Euler as in its `mass_spring_game`, all steps in one kernel on one thread, which so needs no atomic sums; and
implicit Euler linearised where the step begins as in its `implicit_mass_spring`, with its sparse matrices and their Cholesky
factorization, whose triplets are sorted anew in every step: the way that the language offers.
"""

import time
from functools import partial

import numpy as np
import taichi as ti

from .contender import Contender, explicit_steps
from .scene import RATE

NAME = "Taichi"


def version():
    return ".".join(map(str, ti.__version__))


@ti.data_oriented
class Springs:
    """The scene in fields; `number` is the first row of a free particle in the linear system, -1 of a held one."""

    def __init__(self, scene):
        self.scene = scene
        self.particles, self.springs = count, springs = len(scene.masses), len(scene.pairs)
        self.x, self.v, self.f = (ti.Vector.field(3, ti.f64, count) for _ in range(3))
        self.mass, self.number = ti.field(ti.f64, count), ti.field(ti.i32, count)
        self.pairs = ti.Vector.field(2, ti.i32, springs)
        self.k, self.l0, self.b = (ti.field(ti.f64, springs) for _ in range(3))
        self.free = 3 * int((~scene.held).sum())
        self.gravity = ti.Vector(scene.gravity.tolist())
        self.mass.from_numpy(scene.masses)
        self.number.from_numpy(np.where(scene.held, -1, 3 * (np.cumsum(~scene.held) - 1)).astype(np.int32))
        self.pairs.from_numpy(scene.pairs.astype(np.int32))
        for field, values in ((self.k, scene.per_length), (self.l0, scene.rest_lengths), (self.b, scene.damping)):
            field.from_numpy(values)
        self.builder = None

    def restart(self):
        self.x.from_numpy(self.scene.positions)
        self.v.from_numpy(self.scene.velocities)

    @ti.func
    def add_forces(self):
        for i in range(self.particles):
            self.f[i] = self.mass[i] * self.gravity
        for s in range(self.springs):
            i, j = self.pairs[s][0], self.pairs[s][1]
            d = self.x[i] - self.x[j]
            length = d.norm()
            n = d / length
            force = (self.k[s] * (length - self.l0[s]) + self.b[s] * n.dot(self.v[i] - self.v[j])) * n
            self.f[i] = self.f[i] - force
            self.f[j] = self.f[j] + force

    @ti.kernel
    def symplectic_euler(self, dt: ti.f64, steps: ti.i32):
        ti.loop_config(serialize=True)
        for _ in range(steps):
            self.add_forces()
            for i in range(self.particles):
                if self.number[i] >= 0:
                    self.v[i] = self.v[i] + dt * self.f[i] / self.mass[i]
                    self.x[i] = self.x[i] + dt * self.v[i]

    @ti.kernel
    def assemble(self, a: ti.types.sparse_matrix_builder(), b: ti.types.ndarray(), dt: ti.f64):
        """(M - dt D - dt² K) dv = dt (f + dt K v), D the damping's derivative by velocities and K that of forces by positions."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.add_forces()
        for i in self.x:
            row = self.number[i]
            if row >= 0:
                for m in ti.static(range(3)):
                    a[row + m, row + m] += self.mass[i]
                    b[row + m] = dt * self.f[i][m]
        for s in self.pairs:
            ends = self.pairs[s]
            d = self.x[ends[0]] - self.x[ends[1]]
            length = d.norm()
            n = d / length
            nn = n.outer_product(n)
            k = self.k[s] * (ti.Matrix.identity(ti.f64, 3) - self.l0[s] / length * (ti.Matrix.identity(ti.f64, 3) - nn))
            block = dt * dt * k + dt * self.b[s] * nn
            change = dt * dt * (k @ (self.v[ends[0]] - self.v[ends[1]]))
            for p, q in ti.static(ti.ndrange(2, 2)):
                row, column = self.number[ends[p]], self.number[ends[q]]
                if row >= 0 and column >= 0:
                    for m, o in ti.static(ti.ndrange(3, 3)):
                        a[row + m, column + o] += block[m, o] if p == q else -block[m, o]
            for p in ti.static(range(2)):
                row = self.number[ends[p]]
                if row >= 0:
                    for m in ti.static(range(3)):
                        b[row + m] += -change[m] if p == 0 else change[m]

    @ti.kernel
    def move(self, dv: ti.types.ndarray(), dt: ti.f64):
        for i in self.x:
            row = self.number[i]
            if row >= 0:
                self.v[i] += ti.Vector([dv[row], dv[row + 1], dv[row + 2]])
                self.x[i] += dt * self.v[i]

    def implicit_euler(self, dt, steps):
        for _ in range(steps):
            self.implicit_step(dt)

    def implicit_step(self, dt):
        if self.builder is None:
            entries = self.free + 36 * len(self.scene.pairs)
            self.builder = ti.linalg.SparseMatrixBuilder(self.free, self.free, max_num_triplets=entries, dtype=ti.f64)
            self.b_vector = ti.ndarray(ti.f64, self.free)
            self.solver, self.is_analysed = ti.linalg.SparseSolver(dtype=ti.f64, solver_type="LLT"), False
        self.assemble(self.builder, self.b_vector, dt)
        a = self.builder.build()
        if not self.is_analysed:
            self.solver.analyze_pattern(a)
            self.is_analysed = True
        self.solver.factorize(a)
        self.move(self.solver.solve(self.b_vector), dt)


def contenders(scene):
    ti.init(arch=ti.cpu, cpu_max_num_threads=1, default_fp=ti.f64, log_level=ti.ERROR, fast_math=True)
    springs = Springs(scene)
    compiled = set()

    def run(method, per_frame):
        step, dt = getattr(springs, method), 1 / (RATE * per_frame)
        if method not in compiled:
            springs.restart()
            step(dt, 1)
            compiled.add(method)
        springs.restart()
        ti.sync()
        start = time.process_time()
        step(dt, scene.frames * per_frame)
        ti.sync()
        seconds = time.process_time() - start
        return springs.x.to_numpy(), seconds

    return [Contender(NAME, "symplectic Euler", partial(run, "symplectic_euler"), explicit_steps(scene)),
            Contender(NAME, "implicit Euler", partial(run, "implicit_euler"))]
