#!/usr/bin/env bash
# Fill docker/wheelhouse with every wheel that the image needs, so that it can be built without network.
set -euo pipefail
cd "$(dirname "$0")/.."
PIP=${PIP:-.venv/bin/pip}
"$PIP" download --quiet --dest docker/wheelhouse -c constraints-cpu.txt . "setuptools>=77" wheel "$@"
rm -f docker/wheelhouse/physid-*
du -sh docker/wheelhouse
