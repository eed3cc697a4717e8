"""Examples in files, docstrings and pages run; the stubs match the native module."""

from __future__ import annotations

import ast
import doctest
import importlib
import importlib.util
import os
import pkgutil
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import sprung
from conftest import ROOT, command
from sprung import _native

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.py"))
MODULES = ["sprung", *(f"sprung.{module.name}" for module in pkgutil.iter_modules(sprung.__path__))]


@pytest.mark.parametrize("module", MODULES)
def test_docstrings(module):
    failed, _ = doctest.testmod(importlib.import_module(module))
    assert failed == 0


@pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples(path, tmp_path, monkeypatch, capsys):
    needed = {
        name.name.partition(".")[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import)
        for name in node.names
    }
    for name in sorted(needed & {"jax", "autograd", "torch"}):
        pytest.importorskip(name, reason=f"{name} is not installed: {path.name} did not run")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out


PAGES = [
    page.relative_to(ROOT).as_posix()
    for page in [ROOT / "README.md", ROOT / "python/README.md", *sorted((ROOT / "docs/guide/src").glob("**/*.md"))]
    if "```python\n" in page.read_text(encoding="utf-8")
]


def matrices_of_a_string() -> dict:
    """The files of ``sprung matrix``."""
    from scipy.io import mmwrite

    matrices = sprung.System.ready("string").matrices(dt=0.01)
    for name in "KM":
        mmwrite(f"{name}.mtx", getattr(matrices, name), symmetry="symmetric")
    return {}


def arrays_of_a_cloth() -> dict:
    """The arrays of a scene."""
    system = sprung.System.ready("cloth", 4)
    return {"positions": system.initial_state().positions, "masses": system.masses, "pairs": system.pairs}


def run_of_a_cloth() -> dict:
    """The files of a run with frames."""
    program = command()
    if program is None:
        pytest.skip("the command sprung is not built: set SPRUNG_COMMAND, or cargo build --release")
    sprung.System.ready("cloth", 4).save("cloth.toml")
    arguments = ["run", "cloth.toml", "--duration", "0.1", "--frames", "5", "--quiet", "--out", "out/cloth"]
    subprocess.run([program, *arguments], check=True, timeout=300)
    return {}


def modes_of_a_string() -> dict[str, object]:
    """The files that the command writes with normal modes."""
    program = command()
    if program is None:
        pytest.skip("the command sprung is not built: set SPRUNG_COMMAND, or cargo build --release")
    sprung.System.ready("string", 5).save("string.toml")
    subprocess.run([program, "modes", "string.toml", "-n", "3", "--quiet", "--out", "out/string"], check=True, timeout=300)
    return {}


#: The input of pages whose blocks continue from files or arrays.
INPUTS = {
    "k-alone": matrices_of_a_string,
    "large-scenes": arrays_of_a_cloth,
    "modes": modes_of_a_string,
    "reading-results": run_of_a_cloth,
}


def imported(code: str) -> set[str]:
    """The top-level modules that a block imports."""
    nodes = list(ast.walk(ast.parse(code)))
    plain = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    return {name.partition(".")[0] for name in plain | {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}}


@pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")
@pytest.mark.parametrize("page", PAGES)
def test_pages(page, tmp_path, monkeypatch):
    """The Python blocks of a page run one after the other; those that import a package that is not installed are left out."""
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = INPUTS.get(Path(page).stem, dict)()
    ran = 0
    for block in blocks:
        if all(importlib.util.find_spec(name) for name in imported(block)):
            exec(compile(block, page, "exec"), names)
            ran += 1
    assert ran, "every block imports a package that is not installed"


def test_scenes_as_arrays_can_be_loaded(tmp_path, monkeypatch):
    """The file that the page on large scenes writes is a scene."""
    page = (ROOT / "docs/guide/src/how-to/large-scenes.md").read_text(encoding="utf-8")
    block = page.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(block, arrays_of_a_cloth())
    assert len(sprung.System.load("net.npz").masses) == 16


def test_everything_public_is_documented():
    for name in sprung.__all__:
        each = getattr(sprung, name)
        if name == "__version__":
            continue
        assert each.__doc__, name
        for key, member in vars(each).items() if isinstance(each, type) else ():
            if not key.startswith("_") and (callable(member) or isinstance(member, property)):
                assert (member.fget if isinstance(member, property) else member).__doc__, f"{name}.{key}"


def test_the_native_types_are_those_of_the_native_half():
    stub = Path(sprung.__file__).with_name("_native.pyi")
    tree = ast.parse(stub.read_text(encoding="utf-8"))
    declared = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    present = {name for name in vars(_native) if not name.startswith("__")}
    assert present - {"_native"} == set(declared)
    for name, node in declared.items():
        if isinstance(node, ast.ClassDef):
            members = {member.name for member in node.body if isinstance(member, ast.FunctionDef)} - {"__new__"}
            assert members == {key for key in vars(getattr(_native, name)) if not key.startswith("_")}, name


@pytest.mark.skipif(os.environ.get("PYTHONMALLOC") == "debug", reason="this is that run")
def test_memory_is_used_in_order():
    """The other tests again, with an allocator that finds what is written outside of memory or after it was freed."""
    tests = [Path(__file__).with_name(f"test_{name}.py") for name in ("system", "matrices", "runs", "checks", "statics", "gradient", "lifetime")]
    command = [sys.executable, "-X", "dev", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-x", "-k", "not thousand"]
    environment = {**os.environ, "PYTHONMALLOC": "debug"}
    done = subprocess.run([*command, *map(str, tests)], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
