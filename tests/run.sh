#!/bin/sh
# Installs what is missing (QEMU, the cross compiler), builds the firmware and passes every test.
#
# A test that lacks a tool fails; nothing is skipped. Installing needs Debian or Ubuntu and root, directly or by sudo;
# elsewhere install qemu-system-arm and a C compiler by hand, and add the target thumbv7em-none-eabihf to rustup.
set -eu
cd "$(dirname "$0")/.."

say() { printf '\n== %s\n' "$1"; }

install() {
    say "Installing $*"
    command -v apt-get >/dev/null 2>&1 || { echo "run.sh: please install $* by hand; there is no apt-get here" >&2; exit 1; }
    as_root=
    [ "$(id -u)" = 0 ] || as_root=sudo
    DEBIAN_FRONTEND=noninteractive
    export DEBIAN_FRONTEND
    $as_root apt-get -qq update
    $as_root apt-get -qq install -y --no-install-recommends "$@" >/dev/null
}

has() { command -v "$1" >/dev/null 2>&1; }

has cargo || { echo "run.sh: Rust is not installed; see https://rustup.rs" >&2; exit 1; }
has cc || install gcc libc6-dev
has qemu-system-arm || install qemu-system-arm
target=thumbv7em-none-eabihf
if ! { has rustup && { rustup target list --installed | grep -qx $target || rustup target add $target >/dev/null 2>&1; }; }; then
    { [ -x /usr/bin/cargo ] && has ld.lld && [ -d "$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core" ]; } ||
        install rustc-web cargo-web rust-web-src lld
fi

say "Format and lints"
cargo fmt --all --check
cargo clippy --quiet --locked --workspace --all-targets -- -D warnings

say "Firmware"
sh tests/build-firmware.sh logger
sh tests/build-firmware.sh board-check
sh tests/build-firmware.sh step-cost

say "Tests"
cargo test --locked --release --workspace
