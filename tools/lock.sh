#!/bin/sh
# Writes the lock files anew: the same versions for Python 3.11, 3.12 and 3.13, wheels only, with hashes, and without
# any index address. Versions that are locked stay unless UPGRADE=1. Needs uv, which users of Sinew never do.
set -eu

uv=$(command -v uv || command -v .venv/bin/uv) || {
    echo "lock: found no uv; install it, for example with: .venv/bin/python -m pip install uv" >&2
    exit 2
}

lock() {
    out=$1
    shift
    "$uv" pip compile --quiet "$@" --only-binary :all: \
        --generate-hashes --no-emit-index-url --no-annotate --no-header --output-file "$out" >/dev/null
}

compile() {
    out=$1
    shift
    lock "$out" pyproject.toml requirements.in "$@"
}

peers() {
    out=$1
    shift
    lock "$out" requirements-peers.in --override "$scratch/override" "$@"
}

pins() {
    grep '==' "$1" | cut -d ' ' -f 1
}

compile requirements.txt --python-version 3.11 ${UPGRADE:+--upgrade}
compile requirements-dev.txt --python-version 3.11 --extra dev --constraint requirements.txt ${UPGRADE:+--upgrade}
compile requirements-serve.txt --python-version 3.11 --extra dashboard --constraint requirements-dev.txt

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# A server of pages, some hundred packages, not imported; and one JAX for all peers: pyHarm-os bounds it below 0.6 and
# runs with 0.10, which SoRoMoX needs.
printf '%s\n' 'notebook ; python_version < "3"' 'jax>=0.10' >"$scratch/override"
peers requirements-peers.txt --python-version 3.11 ${UPGRADE:+--upgrade}
for version in 3.12 3.13; do
    compile "$scratch/dev" --python-version "$version" --extra dev --constraint requirements-dev.txt
    pins requirements-dev.txt >"$scratch/locked"
    pins "$scratch/dev" >"$scratch/needed"
    if ! diff "$scratch/locked" "$scratch/needed"; then
        echo "lock: Python $version needs other packages than 3.11; see the difference above" >&2
        exit 1
    fi
    peers "$scratch/peers" --python-version "$version" --constraint requirements-peers.txt
    pins requirements-peers.txt >"$scratch/locked"
    pins "$scratch/peers" >"$scratch/needed"
    if ! diff "$scratch/locked" "$scratch/needed"; then
        echo "lock: Python $version needs other peers than 3.11; see the difference above" >&2
        exit 1
    fi
done
