#!/bin/sh
# Runs a command on the Python client, in an environment of its own below target/: check.sh WHAT COMMAND...
# What cannot be had is said, and WHAT is left out.
set -eu
cd "$(dirname "$0")"
what=$1
shift

usable() {
    python3 -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

if ! usable && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -qq && apt-get install -qqy python3-venv || true
fi
if ! usable; then
    echo "The Python client's $what is left out: it needs Python 3.11 or later with venv and pip (Debian: apt-get install python3-venv)."
    exit 0
fi

environment=../../target/python
made=$environment/made
if [ ! -e "$made" ] || [ -n "$(find pyproject.toml hatch_build.py ../../proto/kerf -newer "$made")" ]; then
    python3 -m venv "$environment"
    "$environment/bin/pip" install --quiet --disable-pip-version-check --editable '.[dev]'
    touch "$made"
fi
PATH="$PWD/$environment/bin:$PATH" exec "$@"
