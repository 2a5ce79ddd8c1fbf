#!/bin/sh
# The commands of the README. Installs what is missing with the system's package manager, and says so.
set -eu

usage() {
  cat <<TXT
usage: sh cmake/run.sh <verb> [-- arguments of ctest or of the program]

  test       builds and runs every test
  tables     builds Release, reproduces the paper's tables and figures, leaves them in build/report/
  peers      compares with other libraries that are installed, leaves build/report/peers.md
  accuracy   error against run time of all variants, leaves build/report/accuracy.md
  install    only installs what the verbs above need

environment: CXX (compiler), IIM_BUILD_DIR (default build/), IIM_CMAKE_ARGS (more arguments for cmake)
TXT
}

say() { printf '== %s\n' "$*"; }
fail() { printf 'error: %s\n' "$*" >&2; exit 1; }

cd "$(dirname "$0")/.."
verb=${1:-help}
[ $# -gt 0 ] && shift
[ "${1:-}" = "--" ] && shift
build=${IIM_BUILD_DIR:-build}

# Debian's and Ubuntu's package of each thing.
package_of() {
  case $1 in
    cmake) echo cmake ;;
    compiler) echo g++ ;;
    make) echo make ;;
    eigen) echo libeigen3-dev ;;
    catch2) echo catch2 ;;
    benchmark) echo libbenchmark-dev ;;
    boost) echo libboost-dev ;;
    json) echo nlohmann-json3-dev ;;
    urdf) echo liburdfdom-dev libtinyxml2-dev libconsole-bridge-dev ;;
    gnuplot) echo gnuplot-nox ;;
    clang) echo clang ;;
    mujoco) echo libmujoco-dev ;;
    dart) echo libdart-dev ;;
    simbody) echo libsimbody-dev ;;
    kdl) echo liborocos-kdl-dev ;;
    *) echo "$1" ;;
  esac
}

# install_packages PACKAGE...: 0 if they are there afterwards.
install_packages() {
  if ! command -v apt-get >/dev/null 2>&1; then
    say "no apt-get here; please install by hand: $*"
    return 1
  fi
  as_root=""
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null 2>&1 || { say "root is needed to install: $*"; return 1; }
    as_root="sudo"
  fi
  say "installing with apt-get: $*"
  if $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@" >"$log" 2>&1; then
    return 0
  fi
  say "the package lists are old or absent: apt-get update"
  $as_root apt-get update -q >"$log" 2>&1 || { tail -n 5 "$log"; return 1; }
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@" >"$log" 2>&1 ||
    { tail -n 5 "$log"; return 1; }
}

# need REQUIRED OPTIONAL: installs what is missing of two lists of names; only what is required may stop us.
need() {
  mkdir -p "$build"
  log=$build/install.log
  : >"$log"
  missing=""
  command -v cmake >/dev/null 2>&1 || missing="$missing $(package_of cmake)"
  command -v "${CXX:-c++}" >/dev/null 2>&1 ||
    case ${CXX:-c++} in *clang*) missing="$missing $(package_of clang)" ;; *) missing="$missing $(package_of compiler)" ;; esac
  command -v ninja >/dev/null 2>&1 || command -v make >/dev/null 2>&1 || missing="$missing $(package_of make)"
  # shellcheck disable=SC2086
  [ -z "$missing" ] || install_packages $missing || fail "needed:$missing"

  wanted=$(echo $1 $2 | tr ' ' ';')
  rm -rf "$build/probe"
  absent=$(cmake -S cmake/probe -B "$build/probe" -DIIM_WANTED="$wanted" ${CXX:+-DCMAKE_CXX_COMPILER="$CXX"} \
             ${IIM_CMAKE_ARGS:-} 2>"$log" | sed -n 's/^-- missing: //p') || { cat "$log"; fail "cmake does not work here"; }
  case " $1 $2 " in *" gnuplot "*) command -v gnuplot >/dev/null 2>&1 || absent="$absent gnuplot" ;; esac
  for name in $absent; do
    packages=$(package_of "$name")
    case " $1 " in
      # shellcheck disable=SC2086
      *" $name "*) install_packages $packages || fail "$name is needed (Debian, Ubuntu: $packages)" ;;
      # shellcheck disable=SC2086
      *) install_packages $packages || say "without $name ($packages): what wants it is left out" ;;
    esac
  done
  [ -n "$absent" ] || say "nothing to install"
}

configure_and_build() { # folder, then arguments of cmake
  folder=$1
  shift
  generator=""
  [ -f "$folder/CMakeCache.txt" ] || { command -v ninja >/dev/null 2>&1 && generator="-G Ninja"; }
  say "configuring $folder"
  # shellcheck disable=SC2086
  cmake -S . -B "$folder" $generator ${CXX:+-DCMAKE_CXX_COMPILER="$CXX"} "$@" ${IIM_CMAKE_ARGS:-}
  say "building $folder"
  cmake --build "$folder" --parallel "$(nproc 2>/dev/null || echo 2)"
}

bench_program() { # program, then its arguments
  program=$1
  shift
  configure_and_build "$build/bench" -DCMAKE_BUILD_TYPE=Release -DIIM_BUILD_TESTING=OFF -DIIM_BUILD_EXAMPLES=OFF
  [ -x "$build/bench/bench/$program" ] || fail "$program was left out of the build; the lines above say what it lacks"
  mkdir -p "$build/report"
  say "running $program"
  "$build/bench/bench/$program" --out "$build/report" "$@"
  say "report: $build/report/"
}

case $verb in
  test)
    need "eigen catch2" "boost json urdf"
    name=$(basename "${CXX:-c++}")
    configure_and_build "$build/test-$name" -DCMAKE_BUILD_TYPE=Release -DIIM_BUILD_BENCH=OFF
    say "testing"
    ctest --test-dir "$build/test-$name" --output-on-failure --parallel "$(nproc 2>/dev/null || echo 2)" "$@"
    ;;
  tables)
    need "eigen benchmark boost" "gnuplot"
    bench_program iim_tables "$@"
    ;;
  peers)
    need "eigen benchmark boost" "gnuplot urdf mujoco dart simbody kdl"
    bench_program iim_peers "$@"
    ;;
  accuracy)
    need "eigen boost" "gnuplot"
    bench_program iim_accuracy "$@"
    ;;
  install)
    need "eigen catch2 benchmark boost" "json urdf gnuplot"
    ;;
  help | -h | --help) usage ;;
  *)
    usage >&2
    fail "no verb '$verb'"
    ;;
esac
