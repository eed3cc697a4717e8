"""What a preconditioner must know of a system of springs: the motions that cost no energy."""

import numpy as np


def rigid_modes(dofs, positions):
    """Translations and rotations about the centre, one column each: the near-null space."""
    x = positions - positions.mean(axis=0)
    particle, axis = dofs.T
    modes = np.zeros((len(dofs), 6))
    modes[np.arange(len(dofs)), axis] = 1.0
    for rotation, (a, b) in enumerate([(1, 2), (2, 0), (0, 1)]):
        on_a, on_b = axis == a, axis == b
        modes[on_a, 3 + rotation] = -x[particle[on_a], b]
        modes[on_b, 3 + rotation] = x[particle[on_b], a]
    return modes
