//! Gives microflow's macro the scene gate's model by an absolute path: it reads relative to where rustc was started,
//! which differs from one workspace to another. Cargo rebuilds when the model changes.

use std::path::Path;

fn main() {
    let manifest = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let out = std::env::var("OUT_DIR").expect("cargo sets it");
    let model = Path::new(&manifest).join("weights").join("gate.tflite");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed={}", model.display());
    let model = model.to_string_lossy().escape_default().to_string();
    let code = format!("#[microflow::model(\"{model}\")]\npub(super) struct Model;\n");
    std::fs::write(Path::new(&out).join("gate_model.rs"), code).expect("OUT_DIR can be written");
}
