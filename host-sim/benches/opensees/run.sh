#!/bin/sh
# Compares a step of the solver, interaction included, with a step of a plain moving-load analysis by OpenSeesPy.
#
# Installs OpenSeesPy from PyPI into a virtual environment in the target folder; needs Python 3.11 to 3.13 with venv.
set -eu
cd "$(dirname "$0")/../../.."

version=3.7.1.2
environment=${CARGO_TARGET_DIR:-$PWD/target}/opensees
python=$environment/bin/python
if ! "$python" -m pip show --quiet openseespy 2>/dev/null; then
    "${PYTHON:-python3}" -m venv "$environment"
    "$python" -m pip install --quiet --disable-pip-version-check "openseespy==$version"
fi
# The wheel brings its own BLAS, but does not find it by itself.
for libraries in "$environment"/lib/python3*/site-packages/openseespylinux/lib; do
    LD_LIBRARY_PATH=$libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
done

# Built first: the libraries above are for OpenSees alone.
cargo bench --locked --quiet -p host-sim --bench opensees --no-run
OPENSEES_PYTHON=$python OPENSEES_LIBRARIES=$LD_LIBRARY_PATH cargo bench --locked --quiet -p host-sim --bench opensees
