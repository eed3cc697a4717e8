"""Reads every scene of the suite and holds it to the rules of a scene file: finite positive masses, stiffnesses and rest lengths, rows
of one length, pairs in range, no spring of zero length; and prints what each one is like at its start."""

import tomllib
from pathlib import Path

from mpmath import mp

from answers import FOLDER
from springs import System, cholesky_succeeds, norm, sub

SCENES = FOLDER.parent / "scenes", FOLDER.parents[1] / "src/verify/scenes"
TABLES = {"name", "gravity", "particles", "springs", "mesh", "constraints", "time"}


def with_mesh(scene, folder):
    """Fill positions and pairs from a Wavefront file, each edge once."""
    vertices, edges = [], {}
    for line in (folder / scene["mesh"]["file"]).read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(c) * scene["mesh"].get("scale", 1.0) for c in rest[:3]])
        elif word == "f":
            corners = [int(c.split("/")[0]) - 1 for c in rest]
            for i, j in zip(corners, corners[1:] + corners[:1]):
                edges[min(i, j), max(i, j)] = None
    scene["particles"]["positions"], scene["springs"]["pairs"] = vertices, [list(e) for e in edges]
    return scene


def check(path):
    scene = tomllib.loads(path.read_text())
    assert not set(scene) - TABLES, path
    if "mesh" in scene:
        scene = with_mesh(scene, path.parent)
    particles, springs = scene["particles"], scene["springs"]
    rows = particles["positions"]
    count, dim = len(rows), len(rows[0])
    assert all(len(r) == dim for r in rows + particles.get("velocities", [])), path
    assert "velocities" not in particles or len(particles["velocities"]) == count, path
    assert len(scene.get("gravity", [0] * dim)) == dim, path
    for values, wanted, least in ((particles["masses"], count, 0), (springs["stiffness"], len(springs["pairs"]), 0),
                                  (springs.get("rest_lengths", 1.0), len(springs["pairs"]), 0),
                                  (springs.get("damping", 1.0), len(springs["pairs"]), -1)):
        assert not isinstance(values, list) or len(values) == wanted, path
        assert all(v > least for v in (values if isinstance(values, list) else [values])), path
    assert all(0 <= i < count and 0 <= j < count and i != j for i, j in springs["pairs"]), path
    system = System(scene)
    stretches = [norm(sub(system.positions[i], system.positions[j])) / l0 for (i, j), l0 in zip(system.pairs, system.rest_lengths)]
    assert min(stretches) > 0, path
    definite = "not assembled" if len(system.free) > 100 else (
        "definite" if cholesky_succeeds(system.restrict(system.A(system.positions, system.dt, "full"))) else "INDEFINITE")
    print(f"{path.name}: {count} particles of {dim} axes, {len(system.pairs)} springs, {len(system.free)} free, l/l0 from "
          f"{mp.nstr(min(stretches), 4)} to {mp.nstr(max(stretches), 4)}, full at dt = {scene['time']['dt']}: {definite}")


def main():
    for path in sorted(path for folder in SCENES for path in Path(folder).glob("*.toml")):
        check(path)


if __name__ == "__main__":
    main()
