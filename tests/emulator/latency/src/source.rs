//! Which line of the sources an instruction was made from, functions that were put into others included.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

use addr2line::Loader;

use crate::Error;
use crate::image::read;
use crate::rounds::Marks;

/// A function that an instruction belongs to, and where in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Demangled.
    pub function: String,
    /// The end of the file's path.
    pub file: String,
    /// The line as it stands in the file, or nothing where the file is not there.
    pub text: String,
}

/// The image's line table.
pub struct Sources {
    loader: Loader,
    marks: Marks,
    files: RefCell<BTreeMap<String, Vec<String>>>,
}

impl std::fmt::Debug for Sources {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sources").finish_non_exhaustive()
    }
}

impl Sources {
    /// Of an ELF file.
    ///
    /// # Errors
    /// A file without a line table.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Ok(Self {
            loader: Loader::new(path).map_err(|error| Error::Image(error.to_string()))?,
            marks: Marks::read(&read(path)?)?,
            files: RefCell::default(),
        })
    }

    /// How often the loop that an instruction belongs to says that it runs at most.
    #[must_use]
    pub fn rounds(&self, address: u32) -> Option<u32> {
        self.marks.at(address)
    }

    /// The innermost function first.
    #[must_use]
    pub fn places(&self, address: u32) -> Vec<Place> {
        let mut places = Vec::new();
        let Ok(mut frames) = self.loader.find_frames(address.into()) else {
            return places;
        };
        while let Ok(Some(frame)) = frames.next() {
            let function = frame.function.as_ref().and_then(|name| name.demangle().ok());
            let Some(location) = frame.location else { continue };
            let file = location.file.unwrap_or_default().to_owned();
            places.push(Place {
                function: function.unwrap_or_default().into_owned(),
                text: self.line(&file, location.line.unwrap_or_default()),
                file,
            });
        }
        places
    }

    fn line(&self, file: &str, line: u32) -> String {
        let mut files = self.files.borrow_mut();
        let lines = files.entry(file.to_owned()).or_insert_with(|| {
            let text = std::fs::read_to_string(file).unwrap_or_default();
            text.lines().map(|line| line.trim().to_owned()).collect()
        });
        let place = (line as usize).checked_sub(1);
        place
            .and_then(|place| lines.get(place))
            .cloned()
            .unwrap_or_default()
    }
}
