#!/bin/sh
# Writes the two lock files anew: the same versions for Python 3.11, 3.12 and 3.13, wheels only, with hashes, and without
# any index address. Versions that are locked stay unless UPGRADE=1. Needs uv, which users of Sinew never do.
set -eu

uv=$(command -v uv || command -v .venv/bin/uv) || {
    echo "lock: found no uv; install it, for example with: .venv/bin/python -m pip install uv" >&2
    exit 2
}

compile() {
    out=$1
    shift
    "$uv" pip compile --quiet pyproject.toml requirements.in "$@" --only-binary :all: \
        --generate-hashes --no-emit-index-url --no-annotate --no-header --output-file "$out" >/dev/null
}

pins() {
    grep '==' "$1" | cut -d ' ' -f 1
}

compile requirements.txt --python-version 3.11 ${UPGRADE:+--upgrade}
compile requirements-dev.txt --python-version 3.11 --extra dev --constraint requirements.txt ${UPGRADE:+--upgrade}

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
for version in 3.12 3.13; do
    compile "$scratch/dev" --python-version "$version" --extra dev --constraint requirements-dev.txt
    pins requirements-dev.txt >"$scratch/locked"
    pins "$scratch/dev" >"$scratch/needed"
    if ! diff "$scratch/locked" "$scratch/needed"; then
        echo "lock: Python $version needs other packages than 3.11; see the difference above" >&2
        exit 1
    fi
done
