#!/bin/sh
# Sees to the system's GL and to the pinned environment in .venv, then runs what follows:
#   ./go pipetwin demo     ./go pytest     ./go check (lint, types, import contracts)
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd -P)
gl="libegl1 libgl1 libgl1-mesa-dri"
stamp="$here $(cat "$here/requirements.lock" "$here/pyproject.toml" | cksum)"
say() { echo "go: $*" >&2; }
have() { ! command -v dpkg >/dev/null || dpkg -s "$@" >/dev/null 2>&1; }
fresh() { [ "$(cat "$here/.venv/go-stamp" 2>/dev/null)" = "$stamp" ]; }
pip() { "$here/.venv/bin/python" -m pip --disable-pip-version-check --quiet "$@" >&2; }
need() { # installs system packages, or says the one line that does
    as=none
    if [ "$(id -u)" = 0 ]; then as=env; elif sudo -n true 2>/dev/null; then as=sudo; fi
    if [ $as != none ] && $as apt-get update >&2 && $as apt-get install -y "$@" >&2; then return; fi
    say "this machine lacks $*; type once: sudo apt-get update && sudo apt-get install -y $*"
    return 1
}
[ $# -gt 0 ] || { say "give a command: pipetwin, pytest, check, python"; exit 2; }

# shellcheck disable=SC2086  gl is a list of names
if ! fresh || ! have $gl; then
    exec 9<"$here/go" # of two first calls at once the second waits here, and then finds all done
    if command -v flock >/dev/null; then flock 9; fi
    have $gl || need $gl || say "going on, but no picture can be drawn"
    if ! fresh; then
        say "setting up $here/.venv (a minute or more the first time)"
        rm -f "$here/.venv/go-stamp"
        # an environment that was moved still names its old place; a half-made one has no pip
        if ! grep -qsF "$here/.venv/bin/python" "$here/.venv/bin/pip"; then
            python3 -c 'import ensurepip' 2>/dev/null || need python3-venv || exit 1
            python3 -m venv --clear "$here/.venv" >&2
        fi
        pip install --no-deps --require-hashes -r "$here/requirements.lock"
        pip install --no-deps --no-build-isolation -e "$here"
        echo "$stamp" >"$here/.venv/go-stamp"
    fi
    exec 9<&-
fi

export PYOPENGL_PLATFORM=egl PYGLET_HEADLESS=1 MUJOCO_GL=egl
# numba looks only at a function's own file: its compiled code is kept apart for each state of all our sources
NUMBA_CACHE_DIR=$here/.venv/numba/$(cd "$here" && find twin sensor_model algorithms scenarios -name '*.py' | sort | xargs cat | cksum | tr ' ' -)
export NUMBA_CACHE_DIR
for old in "$here"/.venv/numba/*; do [ "$old" = "$NUMBA_CACHE_DIR" ] || rm -rf "$old"; done
PATH="$here/.venv/bin:$PATH"
if [ "$1" = check ]; then
    cd "$here"
    ruff check . && ruff format --check . && mypy && exec lint-imports
    exit 1
fi
[ -x "$here/.venv/bin/$1" ] || { say "no command $1 in .venv/bin"; exit 2; }
exec "$here/.venv/bin/$@"
