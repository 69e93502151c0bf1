//! Kernel modules for the virtual machine: which are wanted, what they depend on, and in which order they are loaded.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::cpio::Archive;
use crate::error::Error;

/// Depends on the newest kernel of the release.
pub(super) const KERNEL: &str = "linux-image-amd64";
/// Kernel modules with their parameters, in the order in which they are wanted; what they depend on is found.
const MODULES: [(&str, &str); 6] = [
    // One camera that takes pictures, with the one input that has a webcam's sizes.
    ("vivid", "n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0"),
    ("null_blk", "nr_devices=0"),
    ("crc32c_generic", ""),
    ("ext4", ""),
    // Two sockets, each a host with a device controller of its own, and what lets a program be the device.
    ("dummy_hcd", "num=2"),
    ("usb_f_fs", ""),
];

/// Puts them into the image, in `modules`, with their order and parameters in `modules/order`.
pub(super) fn add(archive: &mut Archive, folder: &Path) -> Result<(), Error> {
    let mut order = String::new();
    for (file, parameters) in in_order(folder)? {
        let bytes = fs::read(&file).map_err(|source| Error::file(&file, source))?;
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        archive.file(&format!("modules/{name}"), &bytes);
        order += format!("{name} {parameters}\n").replace(" \n", "\n").as_str();
    }
    archive.file("modules/order", order.as_bytes());
    Ok(())
}

/// Files of [`MODULES`] and of what they depend on, each after its own, with parameters.
fn in_order(folder: &Path) -> Result<Vec<(PathBuf, &'static str)>, Error> {
    let mut files = BTreeMap::new();
    find_modules(folder, &mut files)?;
    let mut order = Vec::new();
    for (name, parameters) in MODULES {
        add_module(name, parameters, &files, &mut order)?;
    }
    Ok(order)
}

fn find_modules(folder: &Path, files: &mut BTreeMap<String, PathBuf>) -> Result<(), Error> {
    let entries = fs::read_dir(folder).map_err(|source| Error::file(folder, source))?;
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            find_modules(&path, files)?;
        } else if path.extension().is_some_and(|end| end == "ko") {
            let name = path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .replace('-', "_");
            files.insert(name, path);
        }
    }
    Ok(())
}

fn add_module(
    name: &str,
    parameters: &'static str,
    files: &BTreeMap<String, PathBuf>,
    order: &mut Vec<(PathBuf, &'static str)>,
) -> Result<(), Error> {
    let file = files.get(&name.replace('-', "_")).ok_or_else(|| Error::Product {
        what: "kernel modules".to_owned(),
        found: format!("no {name}"),
        expected: format!("a kernel that has it, as Debian's {KERNEL}"),
    })?;
    if order.iter().any(|(known, _)| known == file) {
        return Ok(());
    }
    let bytes = fs::read(file).map_err(|source| Error::file(file, source))?;
    for dependency in dependencies(&bytes) {
        add_module(&dependency, "", files, order)?;
    }
    order.push((file.clone(), parameters));
    Ok(())
}

/// What a module says it needs: `depends=a,b` among the strings of its section .modinfo.
fn dependencies(module: &[u8]) -> Vec<String> {
    const FIELD: &[u8] = b"\0depends=";
    let Some(start) = module.windows(FIELD.len()).position(|bytes| bytes == FIELD) else {
        return Vec::new();
    };
    let text = module[start + FIELD.len()..]
        .split(|byte| *byte == 0)
        .next()
        .unwrap_or_default();
    let names = String::from_utf8_lossy(text).into_owned();
    names
        .split(',')
        .filter(|name| !name.is_empty())
        .map(str::to_owned)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_module_needs_is_read_from_its_strings() {
        let module = b"\x7fELF\0license=GPL\0depends=mc,videodev\0name=vivid\0";
        assert_eq!(dependencies(module), ["mc", "videodev"]);
        assert!(dependencies(b"\0depends=\0name=mc\0").is_empty());
        assert!(dependencies(b"\0name=mc\0").is_empty());
    }
}
