#!/bin/sh
# Installs what the examples in C++, JavaScript and Rust need, and builds them (`make examples`).
#
# What cannot be installed here (no apt-get, not root, no network), or does not suffice, is skipped with
# the reason. What is there has to build: else the exit status is 1.
set -u
cd "$(dirname "$0")" || exit 1
failed=0

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

# install CHECK PACKAGE ...: whether CHECK holds, with the packages installed if it takes them. CHECK says
# in $lacks what is wrong.
install() {
  check=$1
  shift
  $check && return
  if ! command -v apt-get >/dev/null; then
    reason="$lacks; it takes what Debian and Ubuntu call $*, and there is no apt-get here"
  elif [ "$(id -u)" != 0 ] && ! sudo -n true 2>/dev/null; then
    reason="$lacks; as root: apt-get install $*"
  else
    echo "apt-get install $*"
    export DEBIAN_FRONTEND=noninteractive
    as_root apt-get install -qq -y --no-install-recommends "$@" >/dev/null ||
      { as_root apt-get update -qq && as_root apt-get install -qq -y --no-install-recommends "$@" >/dev/null; } ||
      { reason="$lacks, and apt-get could not install $*" && return 1; }
    $check && return
    reason="$lacks, although apt-get has installed $*"
  fi
  return 1
}

# holds WHAT COMMAND ...: whether the command succeeds; else $lacks says WHAT
holds() {
  lacks=$1
  shift
  "$@" >/dev/null 2>&1
}

compiles_cpp() {
  printf '#include <zmq.hpp>\n#include <msgpack.hpp>\n' | c++ -std=c++17 -DMSGPACK_NO_BOOST -fsyntax-only -x c++ -
}

has_cpp() {
  holds "make does not run" make --version &&
    holds "c++ finds no zmq.hpp and msgpack.hpp, or does not run" compiles_cpp
}

has_node() {
  holds "node is older than 18, or does not run" node -e 'process.exit(parseInt(process.versions.node) < 18 ? 1 : 0)' &&
    holds "npm does not run" npm --version
}

runs_rust() {
  env PATH="$1" cargo --version && env PATH="$1" rustc --version
}

# Finds the PATH with a cargo that runs: rustup's, first in PATH, does not without a toolchain of this user.
finds_cargo() {
  IFS=:
  for folder in $PATH; do
    unset IFS
    rust_path=$folder:$PATH
    if [ -x "$folder/cargo" ] && runs_rust "$rust_path"; then return; fi
  done
  unset IFS
  return 1
}

has_rust() {
  holds "no cargo in PATH runs (cargo --version, rustc --version; rustup: try rustup default stable)" finds_cargo &&
    holds "cc does not run" cc --version &&
    holds "pkg-config finds no libzmq" pkg-config --exists libzmq || return
  for crate in zmq-0 rmp-serde-1 serde_derive-1 libc-0; do
    holds "there is no crate $crate.* in /usr/share/cargo/registry" \
      ls -d "/usr/share/cargo/registry/$crate".* || return
  done
}

# build LANGUAGE COMMAND ...: in its folder
build() {
  language=$1
  shift
  if (cd "$language" && "$@"); then echo "examples/$language: built"; else
    echo "examples/$language: does not build" >&2
    failed=1
  fi
}

skip() {
  echo "examples/$1: skipped: $reason" >&2
}

if install has_cpp g++ make libzmq3-dev cppzmq-dev libmsgpack-cxx-dev; then build cpp make -s; else skip cpp; fi

if install has_node nodejs npm; then
  if (cd javascript && npm install --silent --no-audit --no-fund); then
    build javascript node --input-type=module --eval 'import "zeromq"; import "@msgpack/msgpack"'
  else
    reason="npm could not install zeromq and @msgpack/msgpack: try cd examples/javascript && npm install"
    skip javascript
  fi
else skip javascript; fi

# Debian's crates, which any cargo from 1.63 on can use; Debian's own cargo where none runs
rust_packages="gcc libc6-dev pkg-config libzmq3-dev librust-zmq-dev librust-rmp-serde-dev librust-serde-derive-dev librust-libc-dev"
finds_cargo >/dev/null 2>&1 || rust_packages="cargo $rust_packages"
# shellcheck disable=SC2086  # one word for each package
if install has_rust $rust_packages; then build rust env PATH="$rust_path" cargo build --quiet --release --target-dir target; else skip rust; fi

exit $failed
