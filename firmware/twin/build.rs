//! Puts the repository's linker scripts on the linker's search path.

use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=../../memory.x");
    println!("cargo:rerun-if-changed=../../hot.x");
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets this for every build script");
    let repository = Path::new(&here).ancestors().nth(2);
    let repository = repository.expect("the firmware lies in the repository");
    println!("cargo:rustc-link-search={}", repository.display());
}
