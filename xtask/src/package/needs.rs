//! What a program needs of the system it is installed on: its shared libraries and their newest versions, as Debian's packages.
//! Pure: read from the program's ELF file, of any architecture.

use std::collections::BTreeMap;

use object::elf::DT_NEEDED;
use object::read::elf::ElfFile64;
use object::{Architecture, Endianness, Object as _};

/// Packages by the start of the libraries' names; every program of Rust has at most these.
const PACKAGES: [(&str, &str); 6] = [
    ("libc.so.", "libc6"),
    ("libm.so.", "libc6"),
    ("libdl.so.", "libc6"),
    ("libpthread.so.", "libc6"),
    ("ld-linux", "libc6"),
    ("libgcc_s.so.", "libgcc-s1"),
];
/// Prefix of the versions of glibc's symbols.
const GLIBC: &str = "GLIBC_";

/// The field Depends, as far as libraries go: `libc6 (>= 2.34), libgcc-s1`.
///
/// # Errors
/// What was found, when it is no ELF file of 64 bits, or a library is of no known package.
pub(super) fn depends(program: &[u8]) -> Result<String, String> {
    let (libraries, versions) = read(program).map_err(|error| format!("no ELF file of 64 bits ({error})"))?;
    let mut packages = BTreeMap::new();
    for library in &libraries {
        let known = PACKAGES.iter().find(|(start, _)| library.starts_with(start));
        let (_, package) =
            known.ok_or_else(|| format!("the library {library}, of no package that is known"))?;
        packages.insert(*package, None);
    }
    if let (Some(minimum), Some(libc)) = (newest_glibc(&versions), packages.get_mut("libc6")) {
        *libc = Some(minimum);
    }
    let shown = packages.into_iter().map(|(package, minimum)| match minimum {
        Some([major, minor]) => format!("{package} (>= {major}.{minor})"),
        None => package.to_owned(),
    });
    Ok(shown.collect::<Vec<_>>().join(", "))
}

/// Debian's name of the machine that a program is for.
///
/// # Errors
/// What was found, when it is no such program.
pub(super) fn architecture(program: &[u8]) -> Result<&'static str, String> {
    let file = ElfFile64::<Endianness>::parse(program)
        .map_err(|error| format!("no ELF file of 64 bits ({error})"))?;
    match file.architecture() {
        Architecture::X86_64 => Ok("amd64"),
        Architecture::Aarch64 => Ok("arm64"),
        other => Err(format!("a program for {other:?}")),
    }
}

/// The newest of glibc's versions; those without a number are of its inside.
fn newest_glibc(versions: &[String]) -> Option<[u32; 2]> {
    let numbers = |version: &String| {
        let mut parts = version.strip_prefix(GLIBC)?.split('.');
        let mut number = || parts.next()?.parse().ok();
        Some([number()?, number()?])
    };
    versions.iter().filter_map(numbers).max()
}

/// The names of the libraries, and of the versions of symbols, that a program asks for.
fn read(program: &[u8]) -> object::read::Result<(Vec<String>, Vec<String>)> {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let file = ElfFile64::<Endianness>::parse(program)?;
    let endian = file.endian();
    let dynamic = file.elf_dynamic_table()?;
    let mut libraries = Vec::new();
    for entry in &dynamic {
        if entry.tag == DT_NEEDED {
            libraries.push(text(dynamic.string(entry)?));
        }
    }
    let sections = file.elf_section_table();
    let mut versions = Vec::new();
    if let Some((needs, strings)) = sections.gnu_verneed(endian, program)? {
        let strings = sections.strings(endian, program, strings)?;
        for need in needs {
            for version in need?.1 {
                versions.push(text(version?.name(endian, strings)?));
            }
        }
    }
    Ok((libraries, versions))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_version_of_glibc_counts_by_number_and_not_by_letter() {
        let versions = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let asked = versions(&[
            "GLIBC_2.4",
            "GCC_4.2.0",
            "GLIBC_2.34",
            "GLIBC_2.2.5",
            "GLIBC_PRIVATE",
        ]);
        assert_eq!(newest_glibc(&asked), Some([2, 34]));
        assert_eq!(newest_glibc(&versions(&["GCC_4.2.0"])), None);
    }

    #[cfg(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"))]
    #[test]
    fn this_very_program_needs_the_c_library_and_nothing_unknown() {
        let program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        let depends = depends(&program).unwrap();
        assert!(depends.starts_with("libc6 (>= 2."), "{depends}");
        let here = [("x86_64", "amd64"), ("aarch64", "arm64")];
        let known = here.into_iter().find(|(name, _)| *name == std::env::consts::ARCH);
        assert_eq!(architecture(&program).ok(), known.map(|(_, debian)| debian));
    }

    #[test]
    fn what_is_no_program_is_refused() {
        assert!(depends(b"#!/bin/sh").unwrap_err().contains("no ELF file"));
    }
}
