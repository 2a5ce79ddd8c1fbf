#!/bin/sh
# The library from nothing but a shell. `sh cmake/run.sh help` says what it can do.
set -eu

top=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
build=$top/build

help() {
  cat <<'TEXT'
sh cmake/run.sh VERB [-- further arguments]

  tables     builds the benchmark program in Release, reproduces the paper's tables and figures; leaves build/report/
             (further arguments go to iim_tables, for example --quick)
  test       builds and runs every test (further arguments go to ctest, for example -R urdf)
  peers      compares with other libraries, those that this machine has; leaves build/report/
  accuracy   error by scalar, update and model; leaves build/report/
  types      what each type of subsystem costs, and a legged machine by all methods; leaves build/report/
  several    several states at once on one core, against one at a time; leaves build/report/
  setup VERB [clang]   only installs what VERB needs (and clang++ with its sanitizers)
  has THING            whether this machine has it: compiler, clang, clang_sanitizers, eigen, catch2 …
  help       this text

What a verb needs and the machine lacks is installed by the system's package manager (apt-get; on other systems the
packages are named for you to install). With nothing missing, neither root nor network is needed.

Environment
  CXX                         the compiler; else the first of c++, g++, clang++ … that is new enough (g++ 12, clang++ 14)
  CXXFLAGS                    further compiler flags
  IIM_PRESET                  test: one of CMakePresets.json (test, gcc, clang, clang-others, asan-ubsan, debug, release)
  IIM_NO_INSTALL=1            install nothing, look for nothing: CMake will say what it does not find
  CMAKE_BUILD_PARALLEL_LEVEL  how many compilers at a time
TEXT
}

say() { printf '== %s\n' "$*"; }
die() { printf 'run.sh: %s\n' "$*" >&2; exit 1; }

# --- what is there -------------------------------------------------------------------------------------------------

have_header() {  # have_header FILE…: one of the files in an include folder of the usual prefixes
  for name in "$@"; do
    for prefix in $(printf '%s' "${CMAKE_PREFIX_PATH:-}" | tr ':;' '  ') /usr/local /usr /opt/homebrew; do
      [ -e "$prefix/include/$name" ] && return 0
    done
  done
  return 1
}

new_enough() {  # new_enough COMPILER: a C++20 compiler with its standard library, g++ 12 or clang++ 14
  command -v "$1" > /dev/null 2>&1 || return 1
  printf '%s\n' '#include <concepts>' '#include <numbers>' '#if defined(__clang__)' '#if __clang_major__ < 14' \
    '#error' '#endif' '#elif __GNUC__ < 12' '#error' '#endif' \
    'int main() { return []<std::floating_point T>(T x) { return x > std::numbers::pi_v<T>; }(0.0f); }' |
    "$1" -std=c++20 -x c++ -fsyntax-only - > /dev/null 2>&1
}

find_compiler() {  # sets compiler; empty if there is none
  compiler=
  if [ -n "${CXX:-}" ]; then
    new_enough "$CXX" && compiler=$CXX
    return 0
  fi
  for name in c++ g++ clang++ g++-16 g++-15 g++-14 g++-13 g++-12 clang++-21 clang++-20 clang++-19 \
              clang++-18 clang++-17 clang++-16 clang++-15 clang++-14; do
    if new_enough "$name"; then compiler=$name; return 0; fi
  done
}

have_cmake() {
  command -v cmake > /dev/null 2>&1 || return 1
  cmake --version | awk 'NR == 1 { split($3, v, "."); exit !(v[1] > 3 || (v[1] == 3 && v[2] >= 22)) }'
}

have() {  # have THING
  case $1 in
    cmake) have_cmake ;;
    compiler) find_compiler; [ -n "$compiler" ] ;;
    clang) new_enough clang++ ;;
    clang_sanitizers) echo 'int main() {}' | clang++ -fsanitize=address,undefined -x c++ -o /dev/null - 2> /dev/null ;;
    maker) command -v ninja > /dev/null 2>&1 || command -v make > /dev/null 2>&1 ;;
    eigen) have_header eigen3/Eigen/Core Eigen/Core || [ -n "${Eigen3_DIR:-}" ] ;;
    catch2) have_header catch2/catch.hpp catch2/catch_all.hpp || [ -n "${Catch2_DIR:-}" ] ;;
    benchmark) have_header benchmark/benchmark.h || [ -n "${benchmark_DIR:-}" ] ;;
    boost) have_header boost/multiprecision/cpp_bin_float.hpp || [ -n "${Boost_DIR:-}" ] ;;
    json) have_header nlohmann/json.hpp || [ -n "${nlohmann_json_DIR:-}" ] ;;
    urdf) have_header urdf_parser/urdf_parser.h urdfdom/urdf_parser/urdf_parser.h || [ -n "${urdfdom_DIR:-}" ] ;;
    gnuplot) command -v gnuplot > /dev/null 2>&1 ;;
    mujoco) have_header mujoco/mujoco.h ;;
    dart) have_header dart/dart.hpp ;;
    simbody) have_header simbody/Simbody.h ;;
    kdl) have_header kdl/tree.hpp ;;
    *) die "unknown thing $1" ;;
  esac
}

package_of() {  # package_of SYSTEM THING: the name of the package
  case $1:$2 in
    apt:cmake | dnf:cmake | pacman:cmake) echo cmake ;;
    apt:compiler) apt_compiler ;;
    dnf:compiler) echo gcc-c++ ;;
    pacman:compiler) echo gcc ;;
    *:clang) echo clang ;;
    apt:clang_sanitizers) echo libclang-rt-dev ;;
    *:maker) echo make ;;
    apt:eigen) echo libeigen3-dev ;;
    dnf:eigen) echo eigen3-devel ;;
    pacman:eigen) echo eigen ;;
    apt:catch2 | pacman:catch2) echo catch2 ;;
    dnf:catch2) echo catch-devel ;;
    apt:benchmark) echo libbenchmark-dev ;;
    dnf:benchmark) echo google-benchmark-devel ;;
    pacman:benchmark) echo benchmark ;;
    apt:boost) echo libboost-dev ;;
    dnf:boost) echo boost-devel ;;
    pacman:boost) echo boost ;;
    apt:json) echo nlohmann-json3-dev ;;
    dnf:json) echo json-devel ;;
    pacman:json) echo nlohmann-json ;;
    apt:urdf) echo liburdfdom-dev ;;
    dnf:urdf) echo urdfdom-devel ;;
    pacman:urdf) echo urdfdom ;;
    apt:gnuplot) echo gnuplot-nox ;;
    *:gnuplot) echo gnuplot ;;
    apt:mujoco) echo libmujoco-dev ;;
    apt:dart) echo libdart-dev ;;
    apt:simbody) echo libsimbody-dev ;;
    apt:kdl) echo liborocos-kdl-dev ;;
    *) echo "$2" ;;
  esac
}

apt_compiler() {  # the system's g++ if it is new enough, else the newest that has a package
  default=$(apt-cache policy g++ 2> /dev/null | sed -n 's/^ *Candidate: *\([0-9]*:\)\{0,1\}\([0-9]*\).*/\2/p')
  if [ "${default:-0}" -lt 12 ]; then
    for version in 14 13 12; do
      if apt-cache show "g++-$version" > /dev/null 2>&1; then echo "g++-$version"; return; fi
    done
  fi
  echo g++
}

# --- what is missing ------------------------------------------------------------------------------------------------

needs_of() {  # what VERB cannot do without
  case $1 in
    test) echo cmake compiler maker eigen catch2 ;;
    tables) echo cmake compiler maker eigen benchmark boost ;;
    accuracy) echo cmake compiler maker eigen benchmark boost ;;
    peers | types | several) echo cmake compiler maker eigen ;;
    *) die "there is no verb '$1' (sh cmake/run.sh help)" ;;
  esac
}

wants_of() {  # what VERB does less without
  case $1 in
    test) echo boost urdf json mujoco ;;
    tables | accuracy) echo gnuplot ;;
    peers) echo gnuplot urdf mujoco dart simbody kdl ;;
  esac
}

missing_of() {
  for thing in "$@"; do
    have "$thing" || printf '%s ' "$thing"
  done
}

as_root() {
  if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}

apt_install() {  # apt_install NEEDED WANTED: two lists of things
  if [ "$(id -u)" -ne 0 ] && ! command -v sudo > /dev/null 2>&1; then return 1; fi
  say "apt-get update"
  as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq update || say "apt-get update failed; going on with the lists that are there"
  packages=
  for thing in $1; do packages="$packages $(package_of apt "$thing")"; done
  for thing in $2; do
    package=$(package_of apt "$thing")
    if apt-cache policy "$package" 2> /dev/null | grep -q 'Candidate: [^(]'; then
      packages="$packages $package"
    else
      say "this system has no package $package"
    fi
  done
  [ -n "$packages" ] || return 0
  say "apt-get install$packages"
  # shellcheck disable=SC2086
  as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq -y --no-install-recommends install $packages
}

provide() {  # provide NEEDED WANTED: installs what is missing; fails if something needed stays missing
  # shellcheck disable=SC2086
  needed=$(missing_of $1)
  # shellcheck disable=SC2086
  wanted=$(missing_of $2)
  [ -n "$needed$wanted" ] || return 0
  say "missing: $needed$wanted"
  if command -v apt-get > /dev/null 2>&1; then
    apt_install "$needed" "$wanted" || say "apt-get could not install everything (root, or sudo, is needed for it)"
    manager='apt-get install'
    system=apt
  elif command -v dnf > /dev/null 2>&1; then
    manager='dnf install'
    system=dnf
  elif command -v pacman > /dev/null 2>&1; then
    manager='pacman -S'
    system=pacman
  else
    manager='your package manager:'
    system=other
  fi
  # shellcheck disable=SC2086
  needed=$(missing_of $1)
  # shellcheck disable=SC2086
  wanted=$(missing_of $2)
  if [ -n "$wanted" ]; then
    say "going on without: $wanted"
    if [ $system != apt ]; then say "to have it: $manager$(for t in $wanted; do printf ' %s' "$(package_of $system "$t")"; done)"; fi
  fi
  if [ -n "$needed" ]; then
    die "cannot go on without: $needed
  $manager$(for t in $needed; do printf ' %s' "$(package_of $system "$t")"; done)
  (a compiler must be g++ 12, clang++ 14, or newer; CXX names one)"
  fi
}

prepare() {  # prepare VERB
  [ -z "${IIM_NO_INSTALL:-}" ] || return 0
  provide "$(needs_of "$1")" "$(wants_of "$1")"
}

# --- the verbs ------------------------------------------------------------------------------------------------------

jobs() {  # one compiler per core, and 3 GB for each
  cores=$(getconf _NPROCESSORS_ONLN 2> /dev/null || echo 1)
  memory=$(awk '/^MemAvailable/ { print int($2 / 3000000) }' /proc/meminfo 2> /dev/null || true)
  if [ -n "$memory" ] && [ "$memory" -lt "$cores" ]; then cores=$memory; fi
  [ "$cores" -ge 1 ] || cores=1
  echo "$cores"
}

configure_and_build() {  # configure_and_build FOLDER PRESET [target]
  folder=$1
  preset=$2
  target=${3:-}
  find_compiler
  generator=
  if [ ! -e "$folder/CMakeCache.txt" ] && command -v ninja > /dev/null 2>&1; then generator='-G Ninja'; fi
  say "configuring $folder"
  # shellcheck disable=SC2086
  (cd "$top" && cmake --preset "$preset" -B "$folder" $generator ${compiler:+"-DCMAKE_CXX_COMPILER=$compiler"})
  say "building with ${compiler:-the default compiler}"
  if [ -n "$target" ] && ! cmake --build "$folder" --target help | grep -q "^\(\.\.\. \)\{0,1\}$target\( *$\|:\)"; then
    die "$target was left out of the build; the lines 'Left out' above say why"
  fi
  cmake --build "$folder" --parallel "${CMAKE_BUILD_PARALLEL_LEVEL:-$(jobs)}" ${target:+--target "$target"}
}

run_test() {
  preset=${IIM_PRESET:-test}
  case $preset in  # which compiler a preset is about, unless CXX says otherwise
    gcc) CXX=${CXX:-g++} ;;
    clang | clang-others) CXX=${CXX:-clang++} ;;
  esac
  prepare test
  find_compiler
  folder=$build/$preset-$(basename "${compiler:-default}")
  configure_and_build "$folder" "$preset"
  say "running the tests"
  cd "$folder"
  ctest --output-on-failure --no-tests=error --parallel "${CMAKE_BUILD_PARALLEL_LEVEL:-$(jobs)}" "$@"
}

run_program() {  # run_program VERB PROGRAM [arguments]
  verb=$1
  program=$2
  shift 2
  grep -qs "^// PROGRAM: $program *\$" "$top"/bench/*.cpp || die "this version has no $program, so there is no '$verb' yet"
  prepare "$verb"
  find_compiler
  folder=$build/bench-$(basename "${compiler:-default}")
  configure_and_build "$folder" bench "$program"
  say "running $program, report in $build/report"
  mkdir -p "$build/report"
  "$folder/bench/$program" --out "$build/report" "$@"
  say "report: $build/report"
}

verb=${1:-help}
[ $# -eq 0 ] || shift
case $verb in
  setup)
    things=$(needs_of "${1:-test}")
    wishes=$(wants_of "${1:-test}")
    if [ "${2:-}" = clang ]; then things="$things clang"; wishes="$wishes clang_sanitizers"; fi
    provide "$things" "$wishes"
    exit 0
    ;;
  has)
    have "${1:-}"
    exit
    ;;
esac
[ "${1:-}" != -- ] || shift
case $verb in
  test) run_test "$@" ;;
  tables) run_program tables iim_tables "$@" ;;
  peers) run_program peers iim_peers "$@" ;;
  accuracy) run_program accuracy iim_accuracy "$@" ;;
  types) run_program types iim_types "$@" ;;
  several) run_program several iim_several "$@" ;;
  help | -h | --help) help ;;
  *) help >&2; die "there is no verb '$verb'" ;;
esac
