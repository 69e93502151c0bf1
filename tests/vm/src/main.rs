//! The first process of the virtual machine of `cargo xtask vm`: it brings the machine up, runs the released `gripline`
//! against a virtual camera, does to it what happens in a lab, and says what came of it, a line a check, on the serial
//! console.
#![forbid(unsafe_code)]

#[cfg(target_os = "linux")]
mod checks;
#[cfg(target_os = "linux")]
mod machine;
#[cfg(target_os = "linux")]
mod program;

#[cfg(target_os = "linux")]
fn main() {
    if std::process::id() != 1 {
        eprintln!(
            "found a machine that runs, expected to be the first process of a virtual one: cargo xtask vm"
        );
        std::process::exit(2);
    }
    checks::run_all();
    machine::power_off();
}

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("this program is the first process of a Linux machine: cargo xtask vm");
    std::process::exit(2);
}
