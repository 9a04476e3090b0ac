#!/bin/sh
# Sees to the system's GL and to the pinned environment in .venv, then runs what follows:
#   ./go pipetwin demo     ./go pytest     ./go check (lint, types, import contracts)
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd -P)
say() { echo "go: $*" >&2; }
[ $# -gt 0 ] || { say "give a command: pipetwin, pytest, check, python"; exit 2; }

need() { # installs system packages that are missing, or says the one line that does
    missing=$(for package; do dpkg -s "$package" 2>/dev/null | grep -q '^Status:.* installed$' || printf ' %s' "$package"; done)
    [ -n "$missing" ] || return 0
    if [ "$(id -u)" = 0 ]; then as=env; elif sudo -n true 2>/dev/null; then as=sudo; else as=; fi
    say "this machine lacks$missing"
    # shellcheck disable=SC2086  a list of names
    if [ -n "$as" ] && { $as apt-get update && $as env DEBIAN_FRONTEND=noninteractive apt-get install -y $missing; } >&2; then return 0; fi
    say "type this once: sudo apt-get update && sudo apt-get install -y$missing"
    return 1
}

stamp="$here $(cat "$here/requirements.lock" "$here/pyproject.toml" | cksum)"
fresh() { [ "$(cat "$here/.venv/go-stamp" 2>/dev/null)" = "$stamp" ]; }
if ! fresh; then
    exec 9<"$here/go" # the lock of two first calls at once: the second waits, then finds all done
    if command -v flock >/dev/null; then flock 9; fi
    if ! fresh; then
        say "setting up $here/.venv (some minutes the first time)"
        rm -f "$here/.venv/go-stamp"
        if command -v dpkg >/dev/null; then need libegl1 libgl1 libgl1-mesa-dri || say "going on; drawing pictures will fail"; fi
        python3 -c 'import ensurepip, venv' 2>/dev/null || need python3-venv || exit 1
        # scripts in a moved environment name the old place
        grep -qs "$here/.venv/bin/python" "$here/.venv/bin/pip" || python3 -m venv --clear "$here/.venv" >&2
        pip() { "$here/.venv/bin/python" -m pip --disable-pip-version-check --quiet "$@" >&2; }
        pip install --no-deps --require-hashes -r "$here/requirements.lock"
        pip install --no-deps --no-build-isolation -e "$here"
        echo "$stamp" >"$here/.venv/go-stamp"
    fi
    exec 9<&-
fi

export PYOPENGL_PLATFORM=egl PYGLET_HEADLESS=1 MUJOCO_GL=egl
PATH="$here/.venv/bin:$PATH"
command=$1
shift
if [ "$command" = check ]; then
    cd "$here"
    ruff check . && ruff format --check . && mypy && exec lint-imports
    exit 1
fi
[ -x "$here/.venv/bin/$command" ] || { say "no command $command in .venv"; exit 2; }
exec "$here/.venv/bin/$command" "$@"
