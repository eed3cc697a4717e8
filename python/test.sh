#!/usr/bin/env bash
# Builds the wheel of the Python package, installs it into an environment of its own and tests it there, with the arguments for pytest.
# SPRUNG_WHEEL=FILE tests a wheel that there is already. Where there is no Python 3.10 with pip, or its packages cannot be had, it says
# so and does nothing.
set -euo pipefail
wheel=${SPRUNG_WHEEL:+$(realpath "$SPRUNG_WHEEL")}
cd "$(dirname "$0")/.."
root=$PWD
environment=$root/target/python-venv

skip() {
  echo "the Python package was not tested: $1"
  exit 0
}

python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || skip "no Python 3.10 or later here"
if [ ! -x "$environment/bin/python" ]; then
  python3 -m venv "$environment" 2>/dev/null || { rm -rf "$environment"; skip "Python makes no environments here"; }
fi
python=$environment/bin/python
"$python" -m pip --version >/dev/null 2>&1 || skip "no pip here"
has() { "$python" -c "import $1" 2>/dev/null; }
for package in maturin numpy scipy pytest; do
  has "$package" || "$python" -m pip install --quiet "$package" || skip "$package cannot be installed"
done
# Forces of autograd and of JAX and meshes of meshio are checked where they are to be had; the tests say where they are not.
for package in autograd jax meshio; do
  has "$package" || "$python" -m pip install --quiet "$package" 2>/dev/null || true
done

export PATH=$environment/bin:$PATH
if [ -z "$wheel" ]; then
  rm -rf "$root/target/wheels"
  python/wheel.sh "$root/target/wheels"
  wheel=$(echo "$root"/target/wheels/sprung-*.whl)
fi
"$python" -m pip uninstall --quiet --yes sprung 2>/dev/null
"$python" -m pip install --quiet "$wheel"
"$python" -m pytest python/tests "$@"
