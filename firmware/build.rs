//! Puts the repository's memory.x on the linker's search path; only the firmware binary links with it.

use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=../memory.x");
    if std::env::var_os("CARGO_FEATURE_SILICON").is_some() {
        let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets this for every build script");
        let repository = Path::new(&here)
            .parent()
            .expect("the firmware lies in the repository");
        println!("cargo:rustc-link-search={}", repository.display());
    }
}
