#!/bin/sh
# Installs what the examples in C++, JavaScript and Rust need, and builds them (`make examples`).
#
# What cannot be installed here (no apt-get, not root, no network) is skipped, with the reason. What
# is installed has to build: else the exit status is 1.
set -u
cd "$(dirname "$0")" || exit 1
failed=0

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

# install CHECK PACKAGE ...: whether CHECK holds, with the packages installed if it takes them
install() {
  check=$1
  shift
  $check && return
  if ! command -v apt-get >/dev/null; then
    reason="needs what Debian and Ubuntu call $*, and there is no apt-get here"
  elif [ "$(id -u)" != 0 ] && ! sudo -n true 2>/dev/null; then
    reason="needs packages; as root: apt-get install $*"
  else
    echo "apt-get install $*"
    export DEBIAN_FRONTEND=noninteractive
    as_root apt-get install -qq -y --no-install-recommends "$@" >/dev/null ||
      { as_root apt-get update -qq && as_root apt-get install -qq -y --no-install-recommends "$@" >/dev/null; } ||
      { reason="apt-get could not install $*" && return 1; }
    $check && return
    reason="apt-get has installed $*, and they do not suffice" && failed=1
  fi
  return 1
}

has_cpp() {
  printf '#include <zmq.hpp>\n#include <msgpack.hpp>\n' |
    c++ -std=c++17 -DMSGPACK_NO_BOOST -fsyntax-only -x c++ - 2>/dev/null
}

has_node() {
  node -e 'process.exit(parseInt(process.versions.node) < 18 ? 1 : 0)' 2>/dev/null && npm --version >/dev/null 2>&1
}

has_rust() {
  cargo --version >/dev/null 2>&1 && cc --version >/dev/null 2>&1 && pkg-config --exists libzmq 2>/dev/null &&
    ls -d /usr/share/cargo/registry/zmq-0.* /usr/share/cargo/registry/rmp-serde-1.* \
      /usr/share/cargo/registry/serde_derive-1.* /usr/share/cargo/registry/libc-0.* >/dev/null 2>&1
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

# Debian's crates, which any cargo from 1.63 on can use; Debian's own cargo where there is none
rust_packages="gcc libc6-dev pkg-config libzmq3-dev librust-zmq-dev librust-rmp-serde-dev librust-serde-derive-dev librust-libc-dev"
command -v cargo >/dev/null || rust_packages="cargo $rust_packages"
# shellcheck disable=SC2086  # one word for each package
if install has_rust $rust_packages; then build rust cargo build --quiet --release --target-dir target; else skip rust; fi

exit $failed
