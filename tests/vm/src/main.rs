//! The first process of the virtual machine of `cargo xtask vm`: it brings the machine up, runs the released `gripline`
//! against a virtual camera and a virtual microcontroller on USB, does to it what happens in a lab, and says what came of
//! it, a line a check, on the serial console. Called with `device` it is that microcontroller; with
//! `package`, as a service of a machine that systemd has brought up, it does the same to the Debian package.
#![forbid(unsafe_code)]

#[cfg(target_os = "linux")]
mod checks;
#[cfg(target_os = "linux")]
mod descriptors;
#[cfg(target_os = "linux")]
mod device;
#[cfg(target_os = "linux")]
mod machine;
#[cfg(target_os = "linux")]
mod program;
#[cfg(target_os = "linux")]
mod usb;

#[cfg(target_os = "linux")]
fn main() -> std::process::ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some((word, rest)) = arguments.split_first()
        && word == "device"
    {
        return device::main(rest);
    }
    if arguments == ["package"] {
        checks::run_package();
        machine::power_off();
    }
    if std::process::id() != 1 {
        eprintln!(
            "found a machine that runs, expected to be the first process of a virtual one: cargo xtask vm"
        );
        return std::process::ExitCode::from(2);
    }
    checks::run_all();
    machine::power_off();
}

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("this program is the first process of a Linux machine: cargo xtask vm");
    std::process::exit(2);
}
