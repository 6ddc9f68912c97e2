#!/usr/bin/env bash
# Builds the Python package, installs it with what its tests need into a virtual environment under target/python, and
# runs the tests: scripts/python-test.sh [PYTEST-ARGUMENT...]. PYTHON names the interpreter.
#
# PyTorch's wheel brings libraries for GPUs on x86_64; pip's own settings can name a source of smaller ones.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

requirements=crates/hksl-py/tests/requirements.txt
environment=$PWD/target/python
python=$environment/bin/python

mkdir -p target
if ! [ -x "$python" ] || ! cmp -s "$requirements" "$environment/requirements.txt"; then
  "${PYTHON:-python3}" -m venv --clear "$environment"
  "$python" -m pip install --quiet --disable-pip-version-check --requirement "$requirements"
  cp "$requirements" "$environment/requirements.txt"
fi

# The build finds maturin there, and cargo what the workspace has compiled.
PATH=$environment/bin:$PATH "$python" -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation \
  --wheel-dir target/wheels .
"$python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps \
  "$(ls -t target/wheels/hksl-*.whl | head -n 1)"

exec "$python" -m pytest --quiet "$@"
