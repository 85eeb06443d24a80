#!/bin/sh
# Builds an image for the logger's board (QEMU mps2-an386, Cortex-M4F). The last line printed is the image's path.
#
#   sh tests/build-firmware.sh [logger | board-check | step-cost]
#
# CARGO_TARGET_DIR is honoured. Two ways, the first that is there:
#   1. rustup with the target thumbv7em-none-eabihf, which is added if it can be;
#   2. Debian's compiler with its own sources: packages rustc-web cargo-web rust-web-src lld.
set -eu

binary=${1:-logger}
target=thumbv7em-none-eabihf
cd "$(dirname "$0")/.."
folder=${CARGO_TARGET_DIR:-$PWD/target}

# What the firmware logs: defmt would leave out everything but errors.
DEFMT_LOG=${DEFMT_LOG:-info}
export DEFMT_LOG

rustup_has_target() {
    command -v rustup >/dev/null 2>&1 || return 1
    rustup target list --installed 2>/dev/null | grep -qx "$target" && return 0
    rustup target add "$target" >/dev/null 2>&1
}

debian_has_sources() {
    [ -x /usr/bin/rustc ] && [ -x /usr/bin/cargo ] && command -v ld.lld >/dev/null 2>&1 || return 1
    [ -d "$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core" ]
}

set -- build --locked --profile firmware -p spanwatch --features firmware --bin "$binary" --target "$target"
if rustup_has_target; then
    cargo "$@"
elif debian_has_sources; then
    # -Zbuild-std builds the core library from the sources; it asks for a nightly compiler or for this permission.
    RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld \
        /usr/bin/cargo "$@" -Zbuild-std=core
else
    echo "build-firmware.sh: no compiler for $target. Install it with \`rustup target add $target\`," \
        "or on Debian with \`apt-get install rustc-web cargo-web rust-web-src lld\`." >&2
    exit 2
fi
echo "$folder/$target/firmware/$binary"
