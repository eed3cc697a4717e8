"""Makes ubiquitin.json: the elastic network of PDB 1UBI and its eigenvalues by ProDy, which shares nothing with this program.

    pip install prody && python verification/statics/ubiquitin.py

Network: the 76 C-alpha atoms, joined where they are within 15 Angstrom, gamma 1, unit masses (Atilgan et al., Biophys. J. 80, 2001).
"eigenvalues" are those of ProDy's Hessian by its dense solver. "published" are the thirty lowest in five digits that ProDy's tests hold its
results to, anm1ubi_evalues.dat among their data. Coordinates are those of the PDB, which is in the public domain.
"""

import json
from pathlib import Path

import numpy as np
import prody

data = Path(prody.__file__).parent / "tests" / "datafiles"
prody.confProDy(verbosity="none")
atoms = prody.parsePDB(str(data / "pdb1ubi.pdb")).select("calpha")
network = prody.ANM("1UBI")
network.buildHessian(atoms, cutoff=15.0, gamma=1.0)
network.calcModes("all", zeros=True)
positions = atoms.getCoords()
pairs = [[i, j] for i in range(len(positions)) for j in range(i) if np.linalg.norm(positions[i] - positions[j]) <= 15.0]
record = {
    "source": f"ProDy {prody.__version__}, PDB 1UBI",
    "positions": positions.tolist(),
    "pairs": pairs,
    "eigenvalues": network.getEigvals()[6:].tolist(),
    "published": np.loadtxt(data / "anm1ubi_evalues.dat")[6:, 1].tolist(),
}
Path(__file__).with_suffix(".json").write_text(json.dumps(record) + "\n")
