"""What the tests share: systems, an assembly by numpy and scipy, and the command."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sprung

ROOT = Path(__file__).resolve().parents[2]


def command() -> str | None:
    """The command `sprung`: as SPRUNG_COMMAND says, the one built last in this checkout, or that on the path."""
    if "SPRUNG_COMMAND" in os.environ:
        return os.environ["SPRUNG_COMMAND"]
    built = [path for path in (ROOT / "target").glob("*/sprung") if path.is_file()]
    return str(max(built, key=lambda path: path.stat().st_mtime)) if built else shutil.which("sprung")


@pytest.fixture
def run_command(tmp_path):
    """Runs the command on a system's scene; gives the output folder."""
    program = command()
    if program is None:
        pytest.skip("the command sprung is not built: set SPRUNG_COMMAND, or cargo build --release")

    def run(system: sprung.System, *arguments: str, state: sprung.State | None = None) -> Path:
        scene = tmp_path / "scene.json"
        system.save(scene, state)
        out = tmp_path / "out"
        told = [program, "run", str(scene), "--quiet", "--out", str(out), *arguments]
        done = subprocess.run(told, capture_output=True, text=True, timeout=300)
        assert done.returncode in (0, 1), done.stderr
        return out

    return run


def tangle(particles: int = 40, springs: int = 110, dimension: int = 3, seed: int = 0, **changes) -> sprung.System:
    """A random system with nothing equal: stretched, compressed and damped springs, a held particle and a roller."""
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(particles, dimension))
    pairs = np.array([rng.choice(particles, 2, replace=False) for _ in range(springs)])
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    arguments = dict(
        masses=rng.uniform(0.5, 2.0, particles),
        stiffness=rng.uniform(10.0, 100.0, springs),
        rest_lengths=lengths * rng.uniform(0.8, 1.25, springs),
        damping=np.where(rng.random(springs) < 0.7, rng.uniform(0.0, 1.0, springs), 0.0),
        velocities=rng.normal(size=(particles, dimension)),
        gravity=rng.normal(size=dimension),
        constraints=[sprung.Constraint(0), sprung.Constraint([3, 5], axes="x", velocity=rng.normal(size=dimension))],
        name="tangle",
    )
    return sprung.System(positions, pairs, **{**arguments, **changes})


@pytest.fixture(params=[1, 2, 3])
def system(request) -> sprung.System:
    """A tangle in one, two and three dimensions."""
    return tangle(dimension=request.param)


def assemble(system: sprung.System, state: sprung.State, dt: float, stiffness: str):
    """A, M, G, K, b and the entries' scales by numpy and scipy alone, from the formulas of one spring."""
    from scipy import sparse

    x, v, pairs = state.positions, state.velocities, system.pairs.astype(int)
    n, dimension = x.shape
    k, l0, damping = system.stiffness, system.rest_lengths, system.damping
    d = x[pairs[:, 0]] - x[pairs[:, 1]]
    length = np.linalg.norm(d, axis=1)
    normal = d / length[:, None]
    outer = normal[:, :, None] * normal[:, None, :]
    across = k * (length - l0) / (l0 * length)
    if stiffness == "tension":
        across = np.where(length < l0, 0.0, across)
    elif stiffness == "axial":
        across = np.zeros_like(across)
    elif stiffness == "absolute":
        across = abs(across)
    blocks = across[:, None, None] * (np.eye(dimension) - outer) + (k / l0)[:, None, None] * outer

    def scattered(blocks):
        rows, columns, values = [], [], []
        for a, b, sign in ((0, 0, -1), (1, 1, -1), (0, 1, 1), (1, 0, 1)):
            for r in range(dimension):
                for c in range(dimension):
                    rows.append(pairs[:, a] * dimension + r)
                    columns.append(pairs[:, b] * dimension + c)
                    values.append(sign * blocks[:, r, c])
        shape = (n * dimension, n * dimension)
        return sparse.coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape).tocsr()

    def force_of(parts):
        f = np.zeros_like(x)
        np.add.at(f, pairs[:, 0], parts)
        np.add.at(f, pairs[:, 1], -parts)
        return f

    free = (system.dofs[:, 0] * dimension + system.dofs[:, 1]).astype(int)
    take = lambda matrix: matrix[free][:, free]
    K_all, G_all = scattered(blocks), scattered(damping[:, None, None] * outer)
    M_all = sparse.diags_array(np.repeat(system.masses, dimension)).tocsr()
    A_all = M_all / dt**2 - G_all / dt - K_all
    f = force_of(-(k * (length - l0) / l0)[:, None] * normal)
    b = (system.masses[:, None] * (v / dt + system.gravity) + f).ravel()
    displacement = np.zeros(n * dimension)
    held = np.setdiff1d(np.arange(n * dimension), free)
    displacement[held] = (v * dt).ravel()[held]
    b = (b - A_all @ displacement)[free]
    scale = abs(scattered(abs(blocks)))
    return {"A": take(A_all), "M": take(M_all), "G": take(G_all), "K": take(K_all), "b": b, "scale": take(scale)}
