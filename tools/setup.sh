#!/bin/sh
# Makes .venv from the hash-locked requirements, with nothing but a Python and its venv module.
#   setup.sh runtime   the interpreter, what Sinew needs, and Sinew itself, editable
#   setup.sh serve     what the dashboard needs, into the same .venv
#   setup.sh dev       what testing, checking and the documentation need, into the same .venv
# PYTHON in the environment picks the interpreter; else the first of the list below that fits.
set -eu

fits='import sys; raise SystemExit(not (3, 11) <= sys.version_info[:2] < (3, 14))'

find_python() {
    without_venv=
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
        "$candidate" -c "$fits" >/dev/null 2>&1 || continue
        if "$candidate" -c 'import ensurepip, venv' >/dev/null 2>&1; then
            command -v "$candidate"
            return
        fi
        without_venv=$candidate
    done
    if [ -n "$without_venv" ]; then
        version=$("$without_venv" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        echo "setup: $without_venv is Python $version without ensurepip; install it with: apt-get install python$version-venv" >&2
    else
        echo "setup: found no Python >= 3.11 and < 3.14 among: ${PYTHON:-python3 python3.13 python3.12 python3.11}; install one or name it, as in: make setup PYTHON=/path/to/python3.11" >&2
    fi
    return 1
}

install() {
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-input "$@"
}

case ${1:-} in
runtime)
    if ! .venv/bin/python -c "$fits" >/dev/null 2>&1 || ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
        python=$(find_python)
        echo "setup: making .venv with $python"
        "$python" -m venv --clear .venv
    fi
    echo "setup: installing the locked requirements (a minute or two, 0.9 GB on disk)"
    install --require-hashes --only-binary :all: -r requirements.txt
    # A .venv may still hold Sinew under the name that its distribution had before, or what another project publishes
    # under it. Either would keep `sinew` from being this one, and removing it later would take the command along.
    if .venv/bin/python -m pip show --quiet sinew >/dev/null 2>&1; then
        .venv/bin/python -m pip uninstall --quiet --disable-pip-version-check --yes sinew
    fi
    rm -rf src/sinew.egg-info
    install --no-deps --no-build-isolation --editable .
    touch .venv/.runtime
    ;;
serve)
    echo "setup: installing what the dashboard needs"
    install --require-hashes --only-binary :all: -r requirements-serve.txt
    touch .venv/.serve
    ;;
dev)
    echo "setup: installing what tests, checks and documentation need"
    install --require-hashes --only-binary :all: -r requirements-dev.txt
    touch .venv/.dev
    ;;
*)
    echo "usage: setup.sh runtime|serve|dev" >&2
    exit 2
    ;;
esac
