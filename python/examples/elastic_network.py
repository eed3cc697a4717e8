"""Normal modes of a protein as an elastic network: an anisotropic network model.

    python elastic_network.py [FILE.pdb or FILE.cif]

Every pair of C-alpha atoms within a cut-off of 15 Å is joined by a spring at rest with the same k/l0. Minus K is the Hessian of the model.
The fluctuation of an atom is the sum of |phi|**2 / omega**2 over the modes; B factors of crystals are proportional to it, as far as the
model is right. Without a file the atoms are those of two ideal helices side by side, in the columns of a PDB file.
"""

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
import sprung
from scipy.spatial import cKDTree


def helix(residues, shift, first):
    """The C-alpha atoms of an ideal helix, 100 degrees and 1.5 Å a residue, as lines of a PDB file."""
    turn = np.radians(100) * np.arange(residues)
    x = np.column_stack([2.3 * np.cos(turn), 2.3 * np.sin(turn), 1.5 * np.arange(residues)]) + shift
    line = "ATOM  {0:5d}  CA  ALA A{0:4d}    {1:8.3f}{2:8.3f}{3:8.3f}  1.00 20.00           C  "
    return "".join(line.format(first + n, *row) + "\n" for n, row in enumerate(x))


def carbons(text):
    """Coordinates in Å and B factors of the C-alpha atoms of the first model of a PDB or mmCIF file."""
    lines = text.partition("\nENDMDL")[0].splitlines()
    names = [line.strip() for line in lines if line.startswith("_atom_site.")]
    if names:
        atoms = [dict(zip(names, line.split())) for line in lines if line.startswith("ATOM ")]
        read = ("label_atom_id", "label_alt_id", "pdbx_PDB_model_num", "Cartn_x", "Cartn_y", "Cartn_z", "B_iso_or_equiv")
        rows = [[atom.get(f"_atom_site.{name}", ".") for name in read] for atom in atoms]
        rows = [row for row in rows if row[2] == rows[0][2]]
    else:
        cuts = ((12, 16), (16, 17), (0, 0), (30, 38), (38, 46), (46, 54), (60, 66))
        rows = [[line[a:b].strip() for a, b in cuts] for line in lines if line.startswith("ATOM")]
    table = np.array([row[3:] for row in rows if row[0].strip('"') == "CA" and row[1] in ("", ".", "?", "A")], dtype=float)
    return table[:, :3], table[:, 3]


def network(x, cutoff=15.0, gamma=1.0):
    """The elastic network of atoms."""
    pairs = cKDTree(x).query_pairs(cutoff, output_type="ndarray")
    lengths = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    return sprung.System(x, pairs, masses=1.0, stiffness=gamma * lengths, name="elastic network")


def hessian(x, pairs, gamma=1.0):
    """The Hessian of the model, pair by pair."""
    i, j = pairs.T.astype(int)
    d = x[i] - x[j]
    block = gamma * d[:, :, None] * d[:, None, :] / (d**2).sum(axis=1)[:, None, None]
    axes = np.indices((3, 3))
    rows, columns = (3 * np.concatenate(ends)[:, None, None] + axis for ends, axis in zip([(i, j, i, j), (i, j, j, i)], axes))
    values = np.concatenate([block, block, -block, -block])
    return sparse.coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(x.size, x.size)).tocsr()


def main(files):
    text = Path(files[0]).read_text() if files else helix(18, [0, 0, 0], 1) + helix(18, [9.5, 1, 1], 19)
    x, b_factors = carbons(text)
    system = network(x)
    print(f"{len(x)} residues, {len(system.pairs)} springs")

    model = hessian(x, system.pairs)
    difference = abs(model + system.matrices(dt=1.0).K).max()
    print(f"largest difference between the Hessian and -K: {difference:.1e}")
    assert difference < 1e-12 * abs(model).max()

    modes = sprung.modes(system, 20)
    print(f"{modes.zero_modes} zero modes, complete: {modes.complete}")
    for number, value in enumerate(modes.eigenvalues[:5], 1):
        print(f"mode {number}: eigenvalue {value:.6f}")
    if len(x) <= 500:
        expected = np.linalg.eigvalsh(model.toarray())[modes.zero_modes :][:20]
        np.testing.assert_allclose(modes.eigenvalues, expected, rtol=1e-9)

    fluctuations = ((modes.shapes**2).sum(axis=2) / modes.eigenvalues[:, None]).sum(axis=0)
    print("residues that fluctuate most:", sorted(np.argsort(fluctuations)[-4:].tolist()))
    if np.ptp(b_factors) > 0:
        print(f"correlation with B factors: {np.corrcoef(fluctuations, b_factors)[0, 1]:.2f}")


if __name__ == "__main__":
    main([name for name in sys.argv[1:] if name.endswith((".pdb", ".ent", ".cif"))])
