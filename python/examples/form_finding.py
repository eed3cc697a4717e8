"""Form finding: a cable net from force densities, and a tensegrity prism that turns itself to its equilibrium.

A spring without a rest length pulls with the force density k, in N/m, times its length. The equilibrium of a net of such springs is one linear
solve. The prism has three struts that push and nine cables that pull. It is in equilibrium with the upper triangle turned by 30 degrees
against the lower one, whatever the prestress.
"""

import numpy as np
import sprung

# A net over a saddle: the edge is held on a curve, the inner nodes find their places.
SIZE = 9
number = np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
y, x = np.mgrid[-1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j]
edge = (abs(x) == 1) | (abs(y) == 1)
start = np.stack([x.ravel(), y.ravel(), np.where(edge, 0.5 * (x**2 - y**2), 0.0).ravel()], axis=1)
pairs = np.concatenate([
    np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
    np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
])  # fmt: skip
densities = np.where(np.arange(len(pairs)) < len(pairs) // 2, 20.0, 30.0)  # N/m, more along y than along x
net = sprung.System(
    start, pairs, masses=0.1, stiffness=densities, rest_lengths=0.0, constraints=[sprung.Constraint(number[edge])], name="cable net"
)  # fmt: skip
form = sprung.equilibrium(net)
print(f"cable net: {form.status} after {form.iterations} steps, {len(pairs)} cables")
assert form.status == "stable" and form.iterations <= 2

# The same by numpy: C^T Q C z = 0 for the free nodes.
branch = np.zeros((len(pairs), SIZE * SIZE))
branch[np.arange(len(pairs)), pairs[:, 0]], branch[np.arange(len(pairs)), pairs[:, 1]] = 1.0, -1.0
laplacian = branch.T @ (densities[:, None] * branch)
free, held = number[~edge], number[edge]
expected = np.linalg.solve(laplacian[np.ix_(free, free)], -laplacian[np.ix_(free, held)] @ start[held])
np.testing.assert_allclose(form.positions[free], expected, atol=1e-12)
print(f"height of the middle: {form.positions[number[SIZE // 2, SIZE // 2], 2]:.4f} m")

# A prism, built with a wrong turn.
angles, turn = 2 * np.pi * np.arange(3) / 3, np.radians(10)


def ring(turn, height):
    return np.column_stack([np.cos(angles + turn), np.sin(angles + turn), np.full(3, height)])


corners = np.vstack([ring(0.0, 0.0), ring(turn, 1.2)])
around = [(i, (i + 1) % 3) for i in range(3)]
cables = around + [(3 + i, 3 + j) for i, j in around] + [(i, 3 + i) for i in range(3)]
struts = [(i, 3 + (i + 1) % 3) for i in range(3)]
prism = sprung.System(
    corners, cables + struts, masses=1.0, stiffness=[200.0] * 9 + [2000.0] * 3,
    rest_lengths=[1.5] * 6 + [1.0] * 3 + [2.3] * 3, name="tensegrity prism",
)  # fmt: skip
found = sprung.equilibrium(prism, tolerance=1e-13)  # so exact that the rank of its members can be decided
x = found.positions


def turn_of(x):
    """The turn of the upper triangle about the axis of the prism, in degrees."""
    centres = x[:3].mean(axis=0), x[3:].mean(axis=0)
    axis = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    lower, upper = x[0] - centres[0], x[3] - centres[1]
    return np.degrees(np.arctan2(axis @ np.cross(lower, upper), lower @ upper))


strains = np.linalg.norm(x[prism.pairs[:, 0]] - x[prism.pairs[:, 1]], axis=1) / prism.rest_lengths - 1
tensions = prism.stiffness * strains
print(f"prism: {found.status}, turned by {turn_of(x):.6f} degrees")
print(f"cables pull with {tensions[:9].min():.1f} to {tensions[:9].max():.1f} N, struts push with {-tensions[9]:.1f} N")
assert abs(turn_of(x) - 30) < 1e-6 and (tensions[:9] > 0).all() and (tensions[9:] < 0).all()

# It has a mechanism beside rigid motions, which prestress makes stiff; the tensions are its only state of self-stress.
at = sprung.mechanisms(prism, found.state)
print(f"rank {at.rank} of {at.springs} members, {at.mechanisms - at.rigid_motions} mechanism, stiffened by prestress: {at.prestress_stable}")
assert at.decided and (at.rank, at.mechanisms - at.rigid_motions, at.self_stresses, at.prestress_stable) == (11, 1, 1, True)
stress = at.self_stress[0] * tensions[0] / at.self_stress[0, 0]
np.testing.assert_allclose(stress, tensions, rtol=1e-6)
modes = sprung.modes(prism, 2, found.state)
print(f"its lowest frequencies: {modes.frequencies[0]:.3f} and {modes.frequencies[1]:.3f} Hz beside {modes.zero_modes} rigid motions")
