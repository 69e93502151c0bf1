//! What lies in the package: its folder tree while it is made, and the texts that Debian wants with it.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::process;

/// The configuration, which belongs to whoever edits it.
pub(super) const CONFIGURATION: &str = "etc/gripline/gripline.toml";
/// What dpkg runs, with its text.
const SCRIPTS: [(&str, &str); 3] = [
    ("postinst", include_str!("../../package/postinst")),
    ("prerm", include_str!("../../package/prerm")),
    ("postrm", include_str!("../../package/postrm")),
];

/// Who may do what with a file.
#[derive(Clone, Copy)]
pub(super) enum Place {
    /// Everybody reads it.
    File,
    /// Everybody runs it.
    Program,
}

/// What stands in DEBIAN/control and changes.
pub(super) struct Control<'a> {
    pub version: &'a str,
    pub architecture: &'a str,
    pub maintainer: &'a str,
    /// Packages of its libraries.
    pub libraries: &'a str,
}

/// The package's folder tree.
pub(super) struct Stage {
    root: PathBuf,
}

impl Stage {
    /// An empty one.
    pub(super) fn new(root: &Path) -> Result<Self, Error> {
        if root.exists() {
            fs::remove_dir_all(root).map_err(|source| Error::file(root, source))?;
        }
        fs::create_dir_all(root).map_err(|source| Error::file(root, source))?;
        Ok(Self {
            root: root.to_owned(),
        })
    }

    /// A new empty folder beside it, for what is not yet as it goes into the package.
    pub(super) fn beside(&self, name: &str) -> Result<PathBuf, Error> {
        Self::new(&self.root.with_extension(name)).map(|stage| stage.root)
    }

    /// Writes a file, whatever this machine's default rights are.
    pub(super) fn write(&self, name: &str, place: Place, bytes: &[u8]) -> Result<(), Error> {
        let path = self.root.join(name);
        let rights = match place {
            Place::File => 0o644,
            Place::Program => 0o755,
        };
        fs::create_dir_all(path.parent().unwrap_or(&self.root))
            .and_then(|()| fs::write(&path, bytes))
            .and_then(|()| fs::set_permissions(&path, fs::Permissions::from_mode(rights)))
            .map_err(|source| Error::file(&path, source))
    }

    /// Writes a file as `NAME.gz`, without time and name in it.
    pub(super) fn compressed(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        self.write(name, Place::File, bytes)?;
        process::output(
            Command::new("gzip")
                .args(["-9n", "--force"])
                .arg(self.root.join(name)),
        )
        .map(drop)
    }

    /// Adds what dpkg wants to know, and packs everything.
    pub(super) fn pack(&self, control: &Control, package: &Path, epoch: &str) -> Result<(), Error> {
        let files = self.files()?;
        let mut kib = 0;
        for file in &files {
            let path = self.root.join(file);
            let about = fs::metadata(&path).map_err(|source| Error::file(&path, source))?;
            kib += about.len().div_ceil(1024);
        }
        let sums = process::output(Command::new("md5sum").current_dir(&self.root).args(&files))?;
        self.write("DEBIAN/md5sums", Place::File, sums.as_bytes())?;
        self.write("DEBIAN/control", Place::File, control.text(kib).as_bytes())?;
        self.write(
            "DEBIAN/conffiles",
            Place::File,
            format!("/{CONFIGURATION}\n").as_bytes(),
        )?;
        for (name, text) in SCRIPTS {
            self.write(&format!("DEBIAN/{name}"), Place::Program, text.as_bytes())?;
        }
        process::output(
            Command::new("find")
                .arg(&self.root)
                .args(["-type", "d", "-exec", "chmod", "755", "{}", "+"]),
        )?;
        process::output(
            Command::new("dpkg-deb")
                .env("SOURCE_DATE_EPOCH", epoch)
                .args(["--root-owner-group", "-Zxz", "--build"])
                .arg(&self.root)
                .arg(package),
        )
        .map(drop)
    }

    /// Every file, by its path in the package, in order.
    fn files(&self) -> Result<Vec<String>, Error> {
        let listed = process::output(
            Command::new("find")
                .current_dir(&self.root)
                .args([".", "-type", "f", "-printf", "%P\\n"]),
        )?;
        let mut files: Vec<String> = listed.lines().map(str::to_owned).collect();
        files.sort();
        Ok(files)
    }
}

impl Control<'_> {
    fn text(&self, kib: u64) -> String {
        let Self {
            version,
            architecture,
            maintainer,
            libraries,
        } = self;
        format!(
            "Package: gripline\n\
             Version: {version}\n\
             Architecture: {architecture}\n\
             Maintainer: {maintainer}\n\
             Installed-Size: {kib}\n\
             Depends: {libraries}, systemd | systemd-standalone-sysusers | systemd-sysusers\n\
             Suggests: ffmpeg\n\
             Section: science\n\
             Priority: optional\n\
             Description: tactile slip detection and grip-force control\n \
             Holds objects with a robot gripper with as little force as is safe. Pictures\n \
             of a camera-based fingertip become maps of contact forces; a microcontroller\n \
             finds slip in them and drives the gripper's force line.\n \
             .\n \
             The service gripline is neither enabled nor started by itself: `gripline\n \
             setup` writes its configuration.\n"
        )
    }
}

/// The package's history: there is only this version.
pub(super) fn changelog(version: &str, maintainer: &str, date: &str) -> String {
    format!(
        "gripline ({version}) unstable; urgency=medium\n\n  * Packaged from the project's repository.\n\n -- {maintainer}  {date}\n"
    )
}

/// Licences, in Debian's format (copyright-format 1.0). `mit`: the licence's own text.
pub(super) fn copyright(mit: &str, crates: &[String]) -> String {
    let paragraph = |text: &str| {
        let lines = text.trim().lines().map(|line| match line.trim_end() {
            "" => " .".to_owned(),
            line => format!(" {line}"),
        });
        lines.collect::<Vec<_>>().join("\n")
    };
    // Its heading stands in the field already, the copyright in one of its own.
    let (_, permission) = mit.split_once("\n\nPermission").unwrap_or(("", mit));
    format!(
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n\
         Upstream-Name: Gripline\n\
         Comment: The program also contains these crates, each under its own licence:\n{}\n\n\
         Files: *\n\
         Copyright: 2026 The Gripline developers\n\
         License: Expat or Apache-2.0\n\n\
         License: Expat\n{}\n\n\
         License: Apache-2.0\n On Debian systems the text of this licence is in\n \
         /usr/share/common-licenses/Apache-2.0.\n",
        paragraph(&crates.join("\n")),
        paragraph(&format!("Permission{permission}")),
    )
}

/// The crates of a `cargo tree` with lines `NAME vVERSION (PLACE) | LICENCE`, except for the repository's own, sorted, each once.
pub(super) fn foreign_crates(tree: &str) -> Vec<String> {
    let mut crates: Vec<String> = tree
        .lines()
        .filter_map(|line| {
            let (package, licence) = line.split_once(" | ")?;
            let mut words = package.split(' ');
            let (name, version) = (words.next()?, words.next()?.trim_start_matches('v'));
            let is_ours = words.any(|word| word.starts_with("(/"));
            // Repeated ones end in (*).
            let licence = licence.trim_end_matches("(*)").trim();
            (!is_ours).then(|| format!("{name} {version}: {licence}"))
        })
        .collect();
    crates.sort();
    crates.dedup();
    crates
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crates_of_others_are_listed_once_with_their_licences() {
        let tree = "gripline v0.1.0 (/somewhere/host/bridge) | MIT OR Apache-2.0\n\
                    serde v1.0.228 | MIT OR Apache-2.0\n\
                    serde_derive v1.0.228 (proc-macro) | MIT OR Apache-2.0\n\
                    serde v1.0.228 | MIT OR Apache-2.0 (*)\n";
        assert_eq!(
            foreign_crates(tree),
            [
                "serde 1.0.228: MIT OR Apache-2.0",
                "serde_derive 1.0.228: MIT OR Apache-2.0"
            ]
        );
    }

    #[test]
    fn the_control_file_has_a_field_a_line_and_a_description_that_goes_on_indented() {
        let control = Control {
            version: "0.1.0-1",
            architecture: "arm64",
            maintainer: "A <a@b>",
            libraries: "libc6 (>= 2.34), libgcc-s1",
        };
        let text = control.text(7);
        assert!(text.contains("Architecture: arm64\n"), "{text}");
        assert!(text.contains("\nDepends: libc6 (>= 2.34), libgcc-s1, systemd |"));
        let (fields, description) = text.split_once("Description: ").unwrap();
        assert!(fields.lines().all(|line| line.contains(": ")), "{text}");
        assert!(
            description
                .lines()
                .skip(1)
                .all(|line| line.starts_with(' ') && line.len() < 80)
        );
    }

    #[test]
    fn the_copyright_file_has_no_empty_line_within_a_licence() {
        let text = copyright(
            "MIT License\n\nCopyright (c)\n\nPermission is\n\nAS IS\n",
            &["a 1: MIT".to_owned()],
        );
        assert!(
            text.contains("License: Expat\n Permission is\n .\n AS IS\n\n"),
            "{text}"
        );
        assert!(text.contains("licence:\n a 1: MIT\n\nFiles: *"), "{text}");
    }
}
