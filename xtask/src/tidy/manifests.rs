//! What the manifests of our own packages must say.

use super::{Violation, tree::Tree};

/// Every package has a description and takes the lints of the workspace.
pub(super) fn every_crate_says_what_it_is(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for package in &tree.workspace.members {
        let file = format!("{}/Cargo.toml", package.folder.display());
        if package.description.as_deref().unwrap_or_default().trim().is_empty() {
            found.push(Violation::new(&file, 0, "add a `description` of one line to `[package]`"));
        }
        let entries = tree.text(&file).map(entries).unwrap_or_default();
        let takes_lints = |entry: &Entry<'_>| entry.table == "lints" && entry.says_workspace();
        if !entries.iter().any(takes_lints) {
            found.push(Violation::new(&file, 0, "add `[lints]` with `workspace = true`"));
        }
    }
    found
}

/// Every version stands once, in the root manifest; the packages only say `workspace = true`.
pub(super) fn every_version_stands_once(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for package in &tree.workspace.members {
        let file = format!("{}/Cargo.toml", package.folder.display());
        for entry in tree.text(&file).map(entries).unwrap_or_default() {
            if let Some(crate_name) = entry.dependency()
                && !entry.says_workspace()
                && !entry.is_own_path()
            {
                let what = format!(
                    "take `{crate_name}` from the workspace: `{crate_name}.workspace = true` here, and the \
                     version with its features below `[workspace.dependencies]` in the root manifest"
                );
                found.push(Violation::new(&file, entry.line, what));
            }
        }
    }
    found
}

/// One `key = value` of a manifest, or the body of one `[dependencies.x]` table.
struct Entry<'a> {
    line: usize,
    table: &'a str,
    key: &'a str,
    value: String,
}

impl Entry<'_> {
    fn says_workspace(&self) -> bool {
        let compact: String = self.value.split_whitespace().collect();
        (self.key.ends_with("workspace") && compact == "true") || compact.contains("workspace=true")
    }

    /// A package of ours by its path alone has no version that could stand twice.
    fn is_own_path(&self) -> bool {
        let compact: String = self.value.split_whitespace().collect();
        compact.contains("path=\"") && !compact.contains("version=")
    }

    /// The dependency the entry declares, if its table holds dependencies.
    fn dependency(&self) -> Option<&str> {
        let last = self.table.rsplit('.').next()?;
        last.ends_with("dependencies").then(|| self.key.split('.').next())?
    }
}

/// The entries of a manifest. This reads the part of TOML that manifests are written in: a value may span
/// lines while a bracket is open.
fn entries(manifest: &str) -> Vec<Entry<'_>> {
    let mut entries: Vec<Entry<'_>> = Vec::new();
    let mut table = "";
    let mut open = 0isize;
    for (index, line) in manifest.lines().enumerate() {
        let line = line.split(" #").next().unwrap_or(line).trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let balance = |text: &str| {
            text.matches(['{', '[']).count() as isize - text.matches(['}', ']']).count() as isize
        };
        if open > 0 {
            if let Some(entry) = entries.last_mut() {
                entry.value.push_str(line);
            }
            open += balance(line);
        } else if let Some(name) = line.strip_prefix('[') {
            table = name.trim_matches(['[', ']']);
            // `[dependencies.x]` declares x; its lines become the value of one entry.
            if let Some((holder, key)) = table.rsplit_once('.')
                && holder.ends_with("dependencies")
            {
                entries.push(Entry { line: index + 1, table: holder, key, value: String::new() });
            }
        } else if let Some((key, value)) = line.split_once('=') {
            open = balance(value);
            let declared = entries
                .last_mut()
                .filter(|entry| table == format!("{}.{}", entry.table, entry.key));
            match declared {
                Some(entry) => entry.value.push_str(line),
                None => entries.push(Entry {
                    line: index + 1,
                    table,
                    key: key.trim(),
                    value: value.trim().into(),
                }),
            }
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::{Package, Workspace};

    fn workspace(description: Option<&str>) -> Workspace {
        let description = description.map(str::to_owned);
        let package = Package { folder: "a".into(), description, ..Package::default() };
        Workspace { members: vec![package], ..Workspace::default() }
    }

    #[test]
    fn a_package_without_description_or_lints_is_found() {
        let bare = broken(every_crate_says_what_it_is, &workspace(None), &[("a/Cargo.toml", "[package]\n")]);
        assert_eq!(bare.len(), 2, "{bare:?}");
        let full = [("a/Cargo.toml", "[lints]\nworkspace = true\n")];
        assert!(broken(every_crate_says_what_it_is, &workspace(Some("Plain values")), &full).is_empty());
    }

    #[test]
    fn a_version_outside_the_root_manifest_is_found() {
        let manifest = "[package]\nname = \"a\"\nversion = \"1.0.0\"\n[dependencies]\nbytes.workspace = true\n\
                        mio = { workspace = true, optional = true }\nnix = { workspace = true, features = [\n  \"fs\",\n] }\n\
                        serde = \"1\"\n[dependencies.slab]\nworkspace = true\n[dependencies.rand]\nversion = \"0.9\"\n\
                        [target.'cfg(unix)'.dev-dependencies]\nproptest = { version = \"1\" } # why\n";
        let found = broken(every_version_stands_once, &workspace(None), &[("a/Cargo.toml", manifest)]);
        let places: Vec<_> = found.iter().map(|text| text.split(" from").next().unwrap()).collect();
        assert_eq!(
            places,
            [
                "a/Cargo.toml:10: take `serde`",
                "a/Cargo.toml:13: take `rand`",
                "a/Cargo.toml:16: take `proptest`"
            ]
        );
    }
}
