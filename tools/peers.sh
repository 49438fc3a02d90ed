#!/bin/sh
# Makes .venv-peers: an interpreter for the peers that cannot live in .venv, from hash-locked requirements. The lock is
# complete, so that nothing is resolved anew (--no-deps): it leaves out what the peers ask for and do not use here.
set -eu

.venv/bin/python -m venv --clear .venv-peers
echo "peers: installing what \`make bench\` compares with (0.9 GB on disk)"
.venv-peers/bin/python -m pip install --quiet --disable-pip-version-check --no-input --no-deps \
    --require-hashes --only-binary :all: -r requirements-peers.txt
touch .venv-peers/.peers
