"""Force, energy and blocks of single springs, from ordinary to extreme states.

Straight from the formulas of springs.py in 50 digits, from the doubles of the scene: lengths near the rest length, near zero, far
from the origin, tiny and huge, along an axis and across, in three, two and one dimensions. What doubles can reach depends on the
state: x_i - x_j is exact to one rounding, but l/l0 - 1 and 1/l0 - 1/l lose digits to cancellation near l = l0. The condition
numbers of that are given as strain_condition = l / |l - l0| (null where l = l0): relative errors of a few u times it are to be
expected in the force and in the transverse part of K^s, and twice that in the energy.
"""

from mpmath import mp, mpf

import answers
from springs import (OPTIONS, System, damping_block, damping_force, direction, elastic_energy, elastic_force, stiffness_block)


def two_particles(label, xi, xj, k, l0, b=0.3, vi=(0.4, -0.7, 0.2), vj=(-0.1, 0.3, 0.9)):
    dim = len(xi)
    return {
        "name": label,
        "particles": {"positions": [list(xi), list(xj)], "velocities": [list(vi[:dim]), list(vj[:dim])], "masses": [0.8, 1.7]},
        "springs": {"pairs": [[0, 1]], "stiffness": k, "rest_lengths": l0, "damping": b},
        "time": {"dt": 0.01, "duration": 0.01},
    }


def scaled(row, factor):
    return [c * factor for c in row]


def states():
    oblique, end = [0.31, -0.74, 0.52], [-0.23, 0.18, -0.41]
    yield two_particles("stretched, oblique", oblique, end, 140.0, 0.9)
    yield two_particles("compressed, oblique", oblique, end, 140.0, 1.9)
    yield two_particles("ends the other way round", end, oblique, 140.0, 1.9)
    yield two_particles("stretched to twice its length", [1.2, 0.5, -0.3], [-0.6, -0.9, 0.8], 35.0, 1.25)
    yield two_particles("stretched tenfold", [6.1, -4.4, 5.3], [-0.2, 0.1, 0.4], 35.0, 0.93)
    yield two_particles("compressed to half", [0.3, 0.2, -0.1], [-0.1, -0.2, 0.3], 210.0, 1.3)
    yield two_particles("compressed to a tenth", [0.03, 0.05, -0.07], [-0.01, 0.02, 0.04], 210.0, 1.25)
    for axis in range(3):
        far = [0.0, 0.0, 0.0]
        far[axis] = 1.7
        yield two_particles(f"stretched along {'xyz'[axis]}", far, [0, 0, 0], 90.0, 1.3)
        yield two_particles(f"compressed along {'xyz'[axis]}", [0, 0, 0], far, 90.0, 2.1)
    yield two_particles("at rest exactly, along x", [1.5, 0.25, -0.5], [0.25, 0.25, -0.5], 77.0, 1.25)
    yield two_particles("at rest exactly, oblique", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 3.0)
    yield two_particles("near rest, strain 1e-3", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 2.997)
    yield two_particles("near rest, strain 1e-8", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 2.99999997)
    yield two_particles("near rest, strain -1e-8", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 3.00000003)
    yield two_particles("near rest, one unit in the last place longer", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 2.9999999999999996)
    yield two_particles("near rest, one unit in the last place shorter", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 3.0000000000000004)
    yield two_particles("near rest, oblique, strain 1e-12", [0.6, -0.1, 0.3], [-0.2, 0.7, 0.1], 12.0, 1.1489125293064857)
    yield two_particles("collapsed to 1e-6 of its length", [1e-6, 0.0, 0.0], [0.0, 0.0, 0.0], 64.0, 1.0)
    yield two_particles("collapsed to 1e-6, oblique", [0.4e-6, -0.7e-6, 0.9e-6], [-0.1e-6, 0.2e-6, 0.3e-6], 64.0, 1.3)
    yield two_particles("collapsed to 1e-6 at an offset", [0.500001, 0.25, 0.125], [0.5, 0.2500005, 0.125], 64.0, 1.1)
    far_i, far_j = [1000000.3, -999999.6, 1000000.9], [999999.4, -1000000.2, 1000000.1]
    yield two_particles("far from the origin, stretched", far_i, far_j, 140.0, 1.1)
    yield two_particles("far from the origin, compressed", far_i, far_j, 140.0, 1.7)
    yield two_particles("far from the origin along x", [1000001.3, 0.2, 0.1], [999999.9, 0.2, 0.1], 140.0, 1.1)
    for label, factor in (("tiny, 1e-6 m", 1e-6), ("huge, 1e6 m", 1e6)):
        yield two_particles(f"{label}, stretched", scaled(oblique, factor), scaled(end, factor), 140.0, 0.9 * factor)
        yield two_particles(f"{label}, compressed", scaled(oblique, factor), scaled(end, factor), 140.0, 1.9 * factor)
        yield two_particles(f"{label}, along y", [0.0, 1.3 * factor, 0.0], [0.0, 0.0, 0.0], 140.0, 0.7 * factor)
    yield two_particles("stiff as steel", oblique, end, 2.1e11, 1.3, b=4.0e5)
    yield two_particles("soft as nothing", oblique, end, 2.1e-9, 1.9, b=4.0e-10)
    yield two_particles("nearly along x", [1.4, 1.0e-9, -2.0e-9], [0.0, 0.0, 0.0], 90.0, 1.1)
    yield two_particles("moving along itself", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 2.5, vi=(0.25, 0.5, 0.5), vj=(0.0, 0.0, 0.0))
    yield two_particles("moving across itself", [1.0, 2.0, 2.0], [0.0, 0.0, 0.0], 77.0, 2.5, vi=(0.0, 0.5, -0.5), vj=(0.0, 0.0, 0.0))
    yield two_particles("no damping", oblique, end, 140.0, 0.9, b=0.0)
    yield two_particles("planar, stretched", [0.7, -0.4], [-0.2, 0.9], 51.0, 1.2)
    yield two_particles("planar, compressed", [0.7, -0.4], [-0.2, 0.9], 51.0, 2.2)
    yield two_particles("one-dimensional, stretched", [0.7], [-0.6], 51.0, 1.2)
    yield two_particles("one-dimensional, compressed", [-0.6], [0.7], 51.0, 2.2)


def answer(scene):
    system = System(scene)
    (xi, xj), (vi, vj) = system.positions, system.velocities
    k, l0, b = system.stiffness[0], system.rest_lengths[0], system.damping[0]
    length, _ = direction(xi, xj)
    tiny = mpf(10) ** -45 * k * max(length / l0, 1)
    return {
        "name": scene["name"],
        "scene": scene,
        "length": length,
        "strain": length / l0 - 1,
        "strain_condition": None if length == l0 else length / abs(length - l0),
        "force": answers.settle(elastic_force(xi, xj, k, l0)),
        "energy": elastic_energy(xi, xj, k, l0),
        "stiffness_blocks": {option: stiffness_block(xi, xj, k, l0, option) for option in OPTIONS},
        "damping_force": [mpf(0) if abs(c) < tiny else c for c in damping_force(xi, xj, vi, vj, b)],
        "damping_block": damping_block(xi, xj, b),
    }


def main():
    answers.write(
        "spring_blocks",
        "Force, energy and matrix blocks of one spring",
        "The formulas of one spring in 50 digits, from the exact values of the scene's doubles, correctly rounded. force and "
        "damping_force act on particle 0 (the first end of the pair); stiffness_blocks are K^s, so that K has -K^s on its "
        "diagonal blocks; damping_block is b n n^T, so that G has -b n n^T on its diagonal blocks; strain_condition is l/|l - "
        "l0|, by which near the rest length rounding grows in the force and the transverse term (null where l = l0).",
        [answer(scene) for scene in states()])


if __name__ == "__main__":
    main()
