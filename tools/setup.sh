# Sourced by tools/demo and tools/test: installs missing packages, or prints the command to install them.

# The packages of a group in tools/packages.txt.
packages_of() {
  awk -v group="[$1]" '/^\[/ { inside = ($1 == group); next } inside && NF && $1 !~ /^#/ { print $1 }' \
    tools/packages.txt
}

installed() { dpkg-query -W -f='${Status}' "$1" 2>/dev/null | grep -q 'install ok installed'; }

# ensure_packages GROUP...: exits with code 3 if a package is missing and cannot be installed.
ensure_packages() {
  local missing=() package group sudo=()
  for group in "$@"; do
    for package in $(packages_of "$group"); do installed "$package" || missing+=("$package"); done
  done
  [ ${#missing[@]} -eq 0 ] && return 0
  if [ "$(id -u)" -ne 0 ]; then
    if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
      sudo=(sudo)
    else
      echo "Missing Debian packages, and no right to install them. As root:" >&2
      echo "  apt-get update && apt-get install -y --no-install-recommends ${missing[*]}" >&2
      exit 3
    fi
  fi
  echo "Installing: ${missing[*]}"
  "${sudo[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${sudo[@]}" apt-get install -y -qq --no-install-recommends \
    "${missing[@]}" >/dev/null
}

# quietly COMMAND..: prints its output only after a failure, which ends the script.
quietly() {
  local log
  log=$(mktemp)
  if ! "$@" >"$log" 2>&1; then
    cat "$log" >&2
    rm -f "$log"
    echo "The build failed." >&2
    exit 1
  fi
  rm -f "$log"
}

# build PRESET [TARGET..]: configures and builds.
build() {
  local preset=$1
  shift
  echo "Building (preset $preset) .."
  quietly cmake --preset "$preset"
  quietly cmake --build --preset "$preset" ${1:+--target "$@"}
}

# build_in_place TARGET..: builds as build/ was configured, with what is installed now.
build_in_place() {
  echo "Building .."
  quietly cmake build
  quietly cmake --build build --target "$@"
}

# Whether build/ was configured with every program.
has_every_program() { grep -q '^TWINRATE_VERBS:.*=ALL$' build/CMakeCache.txt 2>/dev/null; }
