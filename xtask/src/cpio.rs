//! An archive as the Linux kernel unpacks it at its start: cpio in the "newc" format, uncompressed
//! (Documentation/driver-api/early-userspace/buffer-format.rst). Everything belongs to root.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use crate::error::Error;

/// An archive under construction.
#[derive(Debug, Default)]
pub(crate) struct Archive {
    bytes: Vec<u8>,
    entries: u32,
    folders: Vec<String>,
}

const FOLDER: u32 = 0o040_755;
const FILE: u32 = 0o100_644;
const PROGRAM: u32 = 0o100_755;
const DEVICE: u32 = 0o020_600;
const LINK: u32 = 0o120_777;

impl Archive {
    /// A folder, with those that it lies in.
    pub(crate) fn folder(&mut self, name: &str) {
        if name.is_empty() || self.folders.iter().any(|known| known == name) {
            return;
        }
        self.parents(name);
        self.folders.push(name.to_owned());
        self.entry(name, FOLDER, [0, 0], &[]);
    }

    /// A file that is read.
    pub(crate) fn file(&mut self, name: &str, bytes: &[u8]) {
        self.parents(name);
        self.entry(name, FILE, [0, 0], bytes);
    }

    /// A file that is run.
    pub(crate) fn program(&mut self, name: &str, bytes: &[u8]) {
        self.parents(name);
        self.entry(name, PROGRAM, [0, 0], bytes);
    }

    /// A character device.
    pub(crate) fn device(&mut self, name: &str, numbers: [u32; 2]) {
        self.parents(name);
        self.entry(name, DEVICE, numbers, &[]);
    }

    /// A symbolic link to `target`.
    pub(crate) fn link(&mut self, name: &str, target: &str) {
        self.parents(name);
        self.entry(name, LINK, [0, 0], target.as_bytes());
    }

    /// Everything that lies in a folder of this machine, as the image's own. What is not readable here is reported.
    pub(crate) fn tree(&mut self, root: &Path) -> Result<(), Error> {
        self.tree_at(root, "")
    }

    fn tree_at(&mut self, folder: &Path, name: &str) -> Result<(), Error> {
        let listed = fs::read_dir(folder).map_err(|source| Error::file(folder, source))?;
        let mut paths: Vec<_> = listed.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        for path in paths {
            let own = path.file_name().unwrap_or_default().to_string_lossy();
            let name = if name.is_empty() {
                own.into_owned()
            } else {
                format!("{name}/{own}")
            };
            let failed = |source| Error::file(&path, source);
            let about = fs::symlink_metadata(&path).map_err(failed)?;
            if about.is_symlink() {
                let target = fs::read_link(&path).map_err(failed)?;
                self.link(&name, &target.to_string_lossy());
            } else if about.is_dir() {
                self.folder(&name);
                self.tree_at(&path, &name)?;
            } else if about.permissions().mode() & 0o111 != 0 {
                self.program(&name, &fs::read(&path).map_err(failed)?);
            } else {
                self.file(&name, &fs::read(&path).map_err(failed)?);
            }
        }
        Ok(())
    }

    /// The archive's bytes.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        self.entry("TRAILER!!!", 0, [0, 0], &[]);
        self.bytes
    }

    fn parents(&mut self, name: &str) {
        if let Some((folder, _)) = name.rsplit_once('/') {
            self.folder(folder);
        }
    }

    fn entry(&mut self, name: &str, mode: u32, [major, minor]: [u32; 2], data: &[u8]) {
        self.entries += 1;
        let (length, name_length) = (data.len() as u32, name.len() as u32 + 1);
        // inode, mode, owner, group, links, time, size, disk (2), device (2), length of the name, sum.
        let fields = [
            self.entries,
            mode,
            0,
            0,
            1,
            0,
            length,
            0,
            0,
            major,
            minor,
            name_length,
            0,
        ];
        self.bytes.extend_from_slice(b"070701");
        for field in fields {
            self.bytes.extend_from_slice(format!("{field:08x}").as_bytes());
        }
        self.bytes.extend_from_slice(name.as_bytes());
        self.bytes.push(0);
        self.pad();
        self.bytes.extend_from_slice(data);
        self.pad();
    }

    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_begin_at_multiples_of_four_and_folders_come_once_and_first() {
        let mut archive = Archive::default();
        archive.program("lib/x/a.so", b"12345");
        archive.file("lib/x/b", b"");
        let bytes = archive.finish();
        let starts: Vec<usize> = (0..bytes.len() - 6)
            .filter(|at| &bytes[*at..*at + 6] == b"070701")
            .collect();
        let name = |at: usize| {
            let text = &bytes[at + 110..];
            String::from_utf8_lossy(&text[..text.iter().position(|byte| *byte == 0).unwrap()]).into_owned()
        };
        let names: Vec<String> = starts.iter().map(|at| name(*at)).collect();
        assert_eq!(names, ["lib", "lib/x", "lib/x/a.so", "lib/x/b", "TRAILER!!!"]);
        assert!(starts.iter().all(|at| at % 4 == 0));
        // The first entry in full, after the kernel's description.
        let expected = "070701000000010000\
                        41ed00000000000000000000000100000000000000000000000000000000000000000000000000000004\
                        00000000lib";
        assert_eq!(String::from_utf8_lossy(&bytes[..expected.len()]), expected);
        let data = starts[2] + 110 + "lib/x/a.so".len() + 1;
        assert_eq!(&bytes[data.next_multiple_of(4)..][..5], b"12345");
    }
}
