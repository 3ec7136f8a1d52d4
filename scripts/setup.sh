# Sourced by scripts/demo and scripts/test: makes .venv with pinned versions, and does nothing when that is done.
# usage: . scripts/setup.sh [EXTRAS]      "[service,sweeps]" unless given; scripts/test asks for "[test]", which holds both
extras="${1:-[service,sweeps]}"

python="${PYTHON:-}"
if [ -z "$python" ]; then
  for candidate in python3.13 python3.12 python3.11 python3 python; do
    if command -v "$candidate" >/dev/null 2>&1 &&
      "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      python="$candidate"
      break
    fi
  done
fi
if [ -z "$python" ]; then
  echo "twolink needs Python 3.11 or newer, and none was found; install it, or set PYTHON=/path/to/python" >&2
  exit 1
fi

# A stamp says what the environment was made from and where: a change of either makes it again.
wanted="$(pwd) $(cat pyproject.toml scripts/constraints.txt hatch_build.py twolink/native/*.[ch] twolink/native/*/*.[ch] | cksum)"
stamp=".venv/stamp-$extras"
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ]; then
  echo "setting up .venv (a minute or two) ..."
  .venv/bin/python -c '' 2>/dev/null || { rm -rf .venv; "$python" -m venv .venv; }
  .venv/bin/python -m pip install --quiet --disable-pip-version-check -c scripts/constraints.txt -e ".$extras" \
    2> .venv/pip.log || { cat .venv/pip.log >&2; exit 1; }
  if [ "$extras" = "[test]" ]; then # what generates clients needs an older typer than the command line
    grep -v '^typer=' scripts/constraints.txt > .venv/generator.txt
    { .venv/bin/python -m venv .venv/generator && .venv/generator/bin/python -m pip install --quiet \
      --disable-pip-version-check -c .venv/generator.txt openapi-python-client==0.29.1; } 2> .venv/pip.log ||
      { cat .venv/pip.log >&2; exit 1; }
  fi
  echo "$wanted" > "$stamp"
  if [ "$extras" = "[test]" ]; then echo "$wanted" > ".venv/stamp-[service,sweeps]"; fi
fi

# Installs a Debian package of the name of a command that is missing, where this user may.
# usage: install_debian COMMAND "WHAT IT IS FOR"
install_debian() {
  if ! command -v "$1" >/dev/null 2>&1 && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    echo "installing Debian's $1 for $2 ..."
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$1"; } \
      > ".venv/$1.log" 2>&1 || { tail -5 ".venv/$1.log" >&2; }
  fi
}
