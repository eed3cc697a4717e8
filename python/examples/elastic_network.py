"""Normal modes of a protein as an elastic network: an anisotropic network model.

Every pair of C-alpha atoms within a cut-off is joined by a spring at rest with the same k/l0. Minus K is the Hessian of the model. The
fluctuation of an atom is the sum of |phi|**2 / omega**2 over the modes; B factors of crystals are compared with it. The coordinates are
those of two ideal helices side by side, in the columns of a PDB file; the text of a real file works as well.
"""

import numpy as np
import sprung


def helix(residues, shift, first):
    """The C-alpha atoms of an ideal helix, 100 degrees and 1.5 Å a residue, as lines of a PDB file."""
    turn = np.radians(100) * np.arange(residues)
    x = np.column_stack([2.3 * np.cos(turn), 2.3 * np.sin(turn), 1.5 * np.arange(residues)]) + shift
    line = "ATOM  {0:5d}  CA  ALA A{0:4d}    {1:8.3f}{2:8.3f}{3:8.3f}  1.00 20.00           C  "
    return [line.format(first + n, *row) for n, row in enumerate(x)]


def carbons(text):
    """Coordinates in Å and B factors of the C-alpha atoms of a PDB file."""
    lines = [line for line in text.splitlines() if line.startswith("ATOM") and line[12:16].strip() == "CA" and line[16] in " A"]
    places = [[float(line[30:38]), float(line[38:46]), float(line[46:54])] for line in lines]
    return np.array(places), np.array([float(line[60:66]) for line in lines])


text = "\n".join(helix(18, [0, 0, 0], 1) + helix(18, [9.5, 1, 1], 19))
x, _ = carbons(text)
cutoff, gamma = 15.0, 1.0
first, second = np.triu_indices(len(x), 1)
lengths = np.linalg.norm(x[first] - x[second], axis=1)
near = lengths <= cutoff
network = sprung.System(
    x, np.column_stack([first, second])[near], masses=1.0, stiffness=gamma * lengths[near], name="elastic network"
)  # fmt: skip
print(f"{len(x)} residues, {near.sum()} springs")

# The Hessian of the model, pair by pair, is minus K.
hessian = np.zeros((3 * len(x), 3 * len(x)))
for i, j in network.pairs.astype(int):
    d = x[i] - x[j]
    block = gamma * np.outer(d, d) / (d @ d)
    for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
        hessian[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * block
difference = abs(hessian + network.matrices(dt=1.0).K.toarray()).max()
print(f"largest difference between the Hessian and -K: {difference:.1e}")
assert difference < 1e-12 * abs(hessian).max()

modes = sprung.modes(network, 20)
print(f"{modes.zero_modes} zero modes, complete: {modes.complete}")
for number, value in enumerate(modes.eigenvalues[:5], 1):
    print(f"mode {number}: eigenvalue {value:.6f}")
expected = np.linalg.eigvalsh(hessian)[6:26]
np.testing.assert_allclose(modes.eigenvalues, expected, rtol=1e-9)
assert modes.zero_modes == 6 and modes.complete

# The ends of the helices fluctuate most.
fluctuations = ((modes.shapes**2).sum(axis=2) / modes.eigenvalues[:, None]).sum(axis=0)
print("residues that fluctuate most:", sorted(np.argsort(fluctuations)[-4:].tolist()))
