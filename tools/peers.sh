#!/bin/sh
# Makes .venv-peers: an interpreter for the peers that cannot live in .venv, from hash-locked requirements. The lock is
# complete, so that nothing is resolved anew (--no-deps): it leaves out what the peers ask for and do not use here.
# With `masters` only the masters of the bus that are built, where cargo is there: a program that tests/peers asks.
set -eu

if [ "${1:-all}" != masters ]; then
    .venv/bin/python -m venv --clear .venv-peers
    echo "peers: installing what \`make bench\` compares with (0.9 GB on disk)"
    .venv-peers/bin/python -m pip install --quiet --disable-pip-version-check --no-input --no-deps \
        --require-hashes --only-binary :all: -r requirements-peers.txt
    touch .venv-peers/.peers
fi
if command -v cargo >/dev/null; then
    target=$(mktemp -d)
    trap 'rm -rf "$target"' EXIT
    echo "peers: building dynamixel2-master"
    cargo install --quiet --path tests/peers/dynamixel2 --root .venv-peers --target-dir "$target"
else
    echo "peers: there is no cargo, so no dynamixel2-master; its tests are skipped" >&2
fi
