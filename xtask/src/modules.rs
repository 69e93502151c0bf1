//! `cargo xtask modules`: the graph of imports between the files of every crate, and the circles in it.
//!
//! An edge is any path in code that starts at `crate`, `self`, `super`, or a child module and ends in another file. A
//! re-export is followed to the file that defines the name, and a parent's declarations and re-exports of its children are no
//! edges. Code under `#[cfg(test)]` does not count. Limits: paths inside macro calls are found by their words; names that a
//! macro makes are not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};

use crate::error::Error;
use crate::process;

/// Where a module of the crate stands: its names from the crate's root.
type ModulePath = Vec<String>;

/// One module: the file it stands in, and what it makes known under its own name.
#[derive(Default)]
struct Module {
    file: PathBuf,
    children: BTreeSet<String>,
    /// Names brought in by `use`, with the path each stands for.
    imported: BTreeMap<String, Vec<String>>,
    /// Paths of glob imports.
    globs: Vec<Vec<String>>,
    /// Names that the module itself defines.
    defined: BTreeSet<String>,
    /// Paths that its code uses; re-exports of children left out.
    used: Vec<Vec<String>>,
}

/// A crate's modules by their place.
#[derive(Default)]
struct Crate {
    modules: BTreeMap<ModulePath, Module>,
}

/// Fails when files of a crate import each other in a circle; prints each circle with the names that tie it.
pub(crate) fn run() -> Result<(), Error> {
    let mut circles = 0;
    let mut files = 0;
    for root in crate_roots()? {
        let graph = Crate::read(&root)?.edges();
        files += graph.len();
        for circle in circles_of(&graph) {
            circles += 1;
            println!("circle of {} files:", circle.len());
            for (from, to, name) in ties(&graph, &circle) {
                println!("  {} -> {}: {name}", shown(&from), shown(&to));
            }
        }
    }
    if circles > 0 {
        return Err(Error::Product {
            what: "imports between files".to_owned(),
            found: format!("{circles} circles, named above"),
            expected: "none: move what both sides need to a file of its own".to_owned(),
        });
    }
    println!("{files} files import others, in no circle");
    Ok(())
}

fn shown(file: &Path) -> String {
    let root = process::root();
    file.strip_prefix(&root).unwrap_or(file).display().to_string()
}

/// Every `src/lib.rs` and `src/main.rs` that git would keep.
fn crate_roots() -> Result<Vec<PathBuf>, Error> {
    let listed = process::output(
        std::process::Command::new("git")
            .current_dir(process::root())
            .args([
                "ls-files",
                "--cached",
                "--others",
                "--exclude-standard",
                "*src/lib.rs",
                "*src/main.rs",
                "*src/bin/*.rs",
            ]),
    )?;
    let roots: Vec<PathBuf> = listed
        .lines()
        .filter(|line| {
            let below = line.rsplit_once("src/bin/").map(|(_, rest)| rest);
            // `src/bin/NAME.rs` and `src/bin/NAME/main.rs` are roots; other files there are modules.
            below.is_none_or(|rest| !rest.contains('/') || rest.ends_with("/main.rs"))
        })
        .map(|line| process::root().join(line))
        .filter(|path| path.is_file())
        .collect();
    if roots.is_empty() {
        return Err(Error::Product {
            what: "crates in the repository".to_owned(),
            found: "none".to_owned(),
            expected: "files src/lib.rs and src/main.rs that git knows".to_owned(),
        });
    }
    Ok(roots)
}

impl Crate {
    fn read(root: &Path) -> Result<Self, Error> {
        let mut read = Self::default();
        let folder = root.parent().unwrap_or(root).to_owned();
        read.read_file(root, &folder, Vec::new())?;
        Ok(read)
    }

    /// Reads one file as the module at `path`; its child modules lie in `folder`.
    fn read_file(&mut self, file: &Path, folder: &Path, path: ModulePath) -> Result<(), Error> {
        let text = fs::read_to_string(file).map_err(|source| Error::file(file, source))?;
        let parsed = syn::parse_file(&text).map_err(|error| Error::Product {
            what: file.display().to_string(),
            found: error.to_string(),
            expected: "Rust that parses".to_owned(),
        })?;
        self.read_items(&parsed.items, file, folder, path)
    }

    fn read_items(
        &mut self,
        items: &[syn::Item],
        file: &Path,
        folder: &Path,
        path: ModulePath,
    ) -> Result<(), Error> {
        let mut module = Module {
            file: file.to_owned(),
            ..Module::default()
        };
        for item in items.iter().filter(|item| !is_for_tests(item)) {
            match item {
                syn::Item::Mod(child) => {
                    let name = child.ident.to_string();
                    module.children.insert(name.clone());
                    let at: ModulePath = path.iter().cloned().chain([name.clone()]).collect();
                    let below = folder.join(&name);
                    if let Some((_, items)) = &child.content {
                        self.read_items(items, file, &below, at)?;
                    } else {
                        let place = path_attribute(child).map(|place| file.with_file_name(place));
                        let child_file = place
                            .into_iter()
                            .chain([folder.join(format!("{name}.rs")), below.join("mod.rs")])
                            .find(|candidate| candidate.is_file());
                        if let Some(child_file) = child_file {
                            self.read_file(&child_file, &below, at)?;
                        }
                    }
                }
                syn::Item::Use(import) => {
                    let is_public = !matches!(import.vis, syn::Visibility::Inherited);
                    module.import(&import.tree, Vec::new(), is_public);
                }
                other => {
                    module.defined.extend(name_of(other));
                    Paths(&mut module.used).visit_item(other);
                }
            }
        }
        self.modules.insert(path, module);
        Ok(())
    }

    /// File to file, with one name that the first takes from the second.
    fn edges(&self) -> BTreeMap<PathBuf, BTreeMap<PathBuf, String>> {
        let mut edges: BTreeMap<PathBuf, BTreeMap<PathBuf, String>> = BTreeMap::new();
        for (at, module) in &self.modules {
            let from = edges.entry(module.file.clone()).or_default();
            for used in &module.used {
                if let Some(to) = self.defining_file(at, used, 0)
                    && to != module.file
                {
                    from.entry(to).or_insert_with(|| used.join("::"));
                }
            }
        }
        edges
    }

    /// The file that defines what `used` names when written in the module `at`; `None` for other crates' things.
    fn defining_file(&self, at: &[String], used: &[String], depth: usize) -> Option<PathBuf> {
        // Re-exports in a ring would never end; the compiler refuses them.
        if depth > 16 {
            return None;
        }
        let mut place: ModulePath = at.to_vec();
        let mut rest = used;
        match rest.first()?.as_str() {
            "crate" => {
                place.clear();
                rest = &rest[1..];
            }
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|word| word == "super") {
                    place.pop()?;
                    rest = &rest[1..];
                }
            }
            _ => {}
        }
        // A path without such a start that meets no child module may be another crate's.
        let has_start = rest.len() < used.len();
        let is_of_this_crate = |place: &ModulePath| has_start || place.len() > at.len();
        let mut module = self.modules.get(&place)?;
        while let Some(name) = rest.first() {
            if module.children.contains(name) {
                place.push(name.clone());
                match self.modules.get(&place) {
                    // A file of another configuration.
                    None => return None,
                    Some(child) => module = child,
                }
                rest = &rest[1..];
                continue;
            }
            if module.defined.contains(name) {
                return Some(module.file.clone());
            }
            if let Some(imported) = module.imported.get(name) {
                let whole: Vec<String> = imported
                    .iter()
                    .cloned()
                    .chain(rest[1..].iter().cloned())
                    .collect();
                // A name that is imported from another crate under its own name would lead here again.
                return (whole != used)
                    .then(|| self.defining_file(&place, &whole, depth + 1))
                    .flatten();
            }
            let through_glob = module.globs.iter().find_map(|glob| {
                let whole: Vec<String> = glob.iter().chain(rest).cloned().collect();
                self.defining_file(&place, &whole, depth + 1)
            });
            // A name that a macro made lies where the path led.
            return through_glob.or_else(|| is_of_this_crate(&place).then(|| module.file.clone()));
        }
        is_of_this_crate(&place).then(|| module.file.clone())
    }
}

impl Module {
    /// Notes an import. A public one of a child's names is a re-export: known under this module's name, but no use of it.
    fn import(&mut self, tree: &syn::UseTree, mut before: Vec<String>, is_public: bool) {
        match tree {
            syn::UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.import(&path.tree, before, is_public);
            }
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.import(tree, before.clone(), is_public);
                }
            }
            syn::UseTree::Glob(_) => {
                self.use_unless_reexport(&before, is_public);
                self.globs.push(before);
            }
            syn::UseTree::Name(name) => self.import_as(before, &name.ident, &name.ident, is_public),
            syn::UseTree::Rename(name) => self.import_as(before, &name.ident, &name.rename, is_public),
        }
    }

    fn import_as(
        &mut self,
        mut path: Vec<String>,
        name: &syn::Ident,
        known_as: &syn::Ident,
        is_public: bool,
    ) {
        let mut known_as = known_as.to_string();
        if name == "self" {
            known_as = if known_as == "self" {
                path.last().cloned().unwrap_or_default()
            } else {
                known_as
            };
        } else {
            path.push(name.to_string());
        }
        self.use_unless_reexport(&path, is_public);
        self.imported.insert(known_as, path);
    }

    fn use_unless_reexport(&mut self, path: &[String], is_public: bool) {
        let first = path.iter().find(|word| *word != "self");
        let is_childs = first.is_some_and(|word| self.children.contains(word))
            || path.first().is_some_and(|word| word == "self");
        if !(is_public && is_childs) {
            self.used.push(path.to_vec());
        }
    }
}

/// Collects the paths in an item's code that may lead to another module.
struct Paths<'a>(&'a mut Vec<Vec<String>>);

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        let words: Vec<String> = path
            .segments
            .iter()
            .map(|segment| segment.ident.to_string())
            .collect();
        if words.len() > 1 || words.first().is_some_and(|word| word == "crate") {
            self.0.push(words);
        }
        visit::visit_path(self, path);
    }

    fn visit_vis_restricted(&mut self, _: &'ast syn::VisRestricted) {
        // `pub(crate)` names no module.
    }

    fn visit_item_macro(&mut self, item: &'ast syn::ItemMacro) {
        // `self` and `super` in a definition mean the place of each call.
        if item.ident.is_none() {
            visit::visit_item_macro(self, item);
        }
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.words(call.tokens.clone());
        visit::visit_macro(self, call);
    }

    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !is_for_tests(item) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_use(&mut self, import: &'ast syn::ItemUse) {
        // An import inside a function.
        let mut inner = Module::default();
        inner.import(&import.tree, Vec::new(), false);
        self.0.append(&mut inner.used);
    }
}

impl Paths<'_> {
    /// Paths in a macro's words: `crate::a::b` and `super::a`.
    fn words(&mut self, tokens: TokenStream) {
        let mut path: Vec<String> = Vec::new();
        let mut colons = 0;
        for token in tokens {
            match token {
                TokenTree::Ident(word) => {
                    if colons < 2 {
                        self.end(&mut path);
                    }
                    path.push(word.to_string());
                    colons = 0;
                }
                TokenTree::Punct(mark) if mark.as_char() == ':' => colons += 1,
                TokenTree::Group(group) => {
                    self.end(&mut path);
                    self.words(group.stream());
                }
                _ => self.end(&mut path),
            }
        }
        self.end(&mut path);
    }

    fn end(&mut self, path: &mut Vec<String>) {
        if path.len() > 1 {
            self.0.push(std::mem::take(path));
        }
        path.clear();
    }
}

fn is_for_tests(item: &syn::Item) -> bool {
    let attributes = match item {
        syn::Item::Mod(item) => &item.attrs,
        syn::Item::Use(item) => &item.attrs,
        syn::Item::Fn(item) => &item.attrs,
        syn::Item::Impl(item) => &item.attrs,
        syn::Item::Const(item) => &item.attrs,
        syn::Item::Struct(item) => &item.attrs,
        _ => return false,
    };
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute
                .meta
                .require_list()
                .is_ok_and(|list| list.tokens.to_string() == "test")
    })
}

/// The value of `#[path = "..."]`.
fn path_attribute(child: &syn::ItemMod) -> Option<String> {
    child.attrs.iter().find_map(|attribute| {
        let pair = attribute.meta.require_name_value().ok()?;
        match &pair.value {
            syn::Expr::Lit(syn::ExprLit {
                lit: syn::Lit::Str(place),
                ..
            }) if pair.path.is_ident("path") => Some(place.value()),
            _ => None,
        }
    })
}

/// The name that an item defines, if others can import it.
fn name_of(item: &syn::Item) -> Option<String> {
    let name = match item {
        syn::Item::Const(item) => &item.ident,
        syn::Item::Enum(item) => &item.ident,
        syn::Item::Fn(item) => &item.sig.ident,
        syn::Item::Static(item) => &item.ident,
        syn::Item::Struct(item) => &item.ident,
        syn::Item::Trait(item) => &item.ident,
        syn::Item::Type(item) => &item.ident,
        syn::Item::Union(item) => &item.ident,
        syn::Item::Macro(item) => item.ident.as_ref()?,
        _ => return None,
    };
    Some(name.to_string())
}

type Graph = BTreeMap<PathBuf, BTreeMap<PathBuf, String>>;

/// Groups of files in which each reaches each other, found by the files that both reach and are reached.
fn circles_of(graph: &Graph) -> Vec<BTreeSet<PathBuf>> {
    let reached: BTreeMap<&PathBuf, BTreeSet<&PathBuf>> =
        graph.keys().map(|file| (file, reachable(graph, file))).collect();
    let mut circles: Vec<BTreeSet<PathBuf>> = Vec::new();
    for (file, below) in &reached {
        if !below.contains(*file) || circles.iter().any(|circle| circle.contains(*file)) {
            continue;
        }
        circles.push(
            below
                .iter()
                .filter(|other| reached.get(**other).is_some_and(|back| back.contains(file)))
                .map(|other| (*other).clone())
                .collect(),
        );
    }
    circles
}

fn reachable<'a>(graph: &'a Graph, from: &PathBuf) -> BTreeSet<&'a PathBuf> {
    let mut found = BTreeSet::new();
    let mut waiting: Vec<&PathBuf> = graph.get(from).into_iter().flat_map(BTreeMap::keys).collect();
    while let Some(file) = waiting.pop() {
        if found.insert(file) {
            waiting.extend(graph.get(file).into_iter().flat_map(BTreeMap::keys));
        }
    }
    found
}

/// The edges inside a circle.
fn ties(graph: &Graph, circle: &BTreeSet<PathBuf>) -> Vec<(PathBuf, PathBuf, String)> {
    circle
        .iter()
        .flat_map(|from| graph[from].iter().map(move |(to, name)| (from, to, name)))
        .filter(|(_, to, _)| circle.contains(*to))
        .map(|(from, to, name)| (from.clone(), to.clone(), name.clone()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The circles of a crate that is written to disk: (file, text).
    fn circles(files: &[(&str, &str)]) -> Vec<Vec<String>> {
        let folder = std::env::temp_dir().join(format!(
            "gripline-modules-{}-{:?}",
            std::process::id(),
            std::thread::current().id()
        ));
        for (name, text) in files {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().expect("a file has a folder")).expect("a folder");
            fs::write(path, text).expect("a file");
        }
        let graph = Crate::read(&folder.join("lib.rs")).expect("Rust").edges();
        let found = circles_of(&graph)
            .into_iter()
            .map(|circle| {
                circle
                    .iter()
                    .map(|file| file.strip_prefix(&folder).expect("below").display().to_string())
                    .collect()
            })
            .collect();
        fs::remove_dir_all(&folder).expect("the folder was made here");
        found
    }

    #[test]
    fn two_files_that_import_each_other_are_a_circle() {
        let found = circles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "use crate::b::B; pub struct A(B);"),
            ("b.rs", "pub struct B; fn f() { crate::a::g() }"),
        ]);
        assert_eq!(found, [["a.rs", "b.rs"]]);
    }

    #[test]
    fn a_parent_that_declares_and_reexports_is_no_part_of_a_circle() {
        let found = circles(&[
            ("lib.rs", "mod a; mod b; pub use a::A; pub use self::b::B;"),
            ("a.rs", "use crate::B; pub struct A(B);"),
            ("b.rs", "pub struct B;"),
        ]);
        assert!(found.is_empty(), "{found:?}");
    }

    #[test]
    fn a_circle_through_a_reexport_is_found_where_the_names_are_defined() {
        let found = circles(&[
            ("lib.rs", "mod a; mod b; pub use a::A; pub use b::B;"),
            ("a.rs", "use crate::B; pub struct A(B);"),
            ("b.rs", "use super::A; pub struct B(Vec<A>);"),
        ]);
        assert_eq!(found, [["a.rs", "b.rs"]]);
    }

    #[test]
    fn a_parent_that_uses_its_child_and_is_used_by_it_is_a_circle() {
        let found = circles(&[
            ("lib.rs", "mod p;"),
            ("p/mod.rs", "mod c; pub struct P; fn f() { c::g() }"),
            ("p/c.rs", "use super::P; pub fn g() {}"),
        ]);
        assert_eq!(found, [["p/c.rs", "p/mod.rs"]]);
    }

    #[test]
    fn imports_of_tests_and_of_other_crates_do_not_count() {
        let found = circles(&[
            ("lib.rs", "mod a; mod b;"),
            (
                "a.rs",
                "use b::Other; #[cfg(test)] mod tests { use crate::b::B; }",
            ),
            ("b.rs", "use crate::a::A; pub struct B(A);"),
        ]);
        assert!(found.is_empty(), "{found:?}");
    }

    #[test]
    fn a_path_inside_a_macro_counts() {
        let found = circles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "pub fn f() { println!(\"{}\", crate::b::N) }"),
            ("b.rs", "pub const N: u8 = 1; pub fn g() { super::a::f() }"),
        ]);
        assert_eq!(found, [["a.rs", "b.rs"]]);
    }
}
