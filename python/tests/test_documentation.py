"""The examples, in files and in docstrings, run; the types fit what is there."""

from __future__ import annotations

import ast
import doctest
import importlib
import os
import pkgutil
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import sprung
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
    for name in sorted(needed & {"jax", "autograd"}):
        pytest.importorskip(name, reason=f"{name} is not installed: {path.name} did not run")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out


ROOT = Path(__file__).resolve().parents[2]
PAGES = ["README.md", "python/README.md", "docs/guide/src/how-to/python.md"]


@pytest.mark.filterwarnings("ignore::sprung.DoubtWarning")
@pytest.mark.parametrize("page", PAGES)
def test_pages(page, tmp_path, monkeypatch):
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks), {})


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
    tests = [Path(__file__).with_name(f"test_{name}.py") for name in ("system", "matrices", "runs", "checks", "lifetime")]
    command = [sys.executable, "-X", "dev", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-x", "-k", "not thousand"]
    environment = {**os.environ, "PYTHONMALLOC": "debug"}
    done = subprocess.run([*command, *map(str, tests)], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
