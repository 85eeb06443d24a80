//! The logger's image cannot panic: nothing that panics is linked.
//!
//! `sh tests/build-firmware.sh logger` and `.. board-check` build the images; without them these tests fail.

use host_sim::channel::built_image;
use host_sim::image;

/// Where the panics are that were found. GNU's `objdump` does not know the processor; LLVM's does.
const HOW_TO_FIND_THEM: &str =
    "the calls are found by: llvm-objdump -dlC --triple=thumbv7em-none-eabihf IMAGE | grep -B9 'bl.*panicking'";

#[test]
fn the_logger_s_image_cannot_panic() {
    let found = image::panicking(&built_image("logger")).expect("the image is there");
    assert!(found.is_empty(), "{found:#?}\n{HOW_TO_FIND_THEM}");
}

#[test]
fn an_image_that_panics_on_purpose_is_found_to() {
    let found = image::panicking(&built_image("board-check")).expect("the image is there");
    let has = |part: &str| found.iter().any(|name| name.contains(part));
    assert!(has("rust_begin_unwind") && has("panic_fmt"), "{found:#?}");
}
