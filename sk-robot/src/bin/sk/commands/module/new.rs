//! `sk module new`: the skeleton of a module, a crate that builds, is tested and runs.

use clap::Args;
use sk_flat::Name;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

#[derive(Args, Debug)]
pub struct ModuleNew {
    /// What it is called: lower-case letters, digits, `_` and `-`
    pub name: String,
    /// The folder to write to; it must be empty or not be there [default: the name]
    #[arg(long, value_name = "DIR")]
    pub path: Option<PathBuf>,
    /// The SpecialK sources to build with [default: those this tool was built from, else the published ones]
    #[arg(long, value_name = "DIR")]
    pub tree: Option<PathBuf>,
}

/// What a skeleton is made of: the file and its text.
const FILES: [(&str, &str); 6] = [
    ("Cargo.toml", include_str!("skeleton/Cargo.toml.in")),
    ("README.md", include_str!("skeleton/README.md.in")),
    (".gitignore", "/target\n/state\n"),
    ("src/lib.rs", include_str!("skeleton/lib.rs.in")),
    ("src/main.rs", include_str!("skeleton/main.rs.in")),
    ("tests/module.rs", include_str!("skeleton/module.rs.in")),
];

/// Names that a crate cannot have, or that stand for another one in the skeleton.
const TAKEN: &[&str] = &[
    "abstract",
    "alloc",
    "as",
    "async",
    "await",
    "become",
    "box",
    "break",
    "const",
    "continue",
    "core",
    "crate",
    "do",
    "dyn",
    "else",
    "enum",
    "extern",
    "false",
    "final",
    "fn",
    "for",
    "gen",
    "if",
    "impl",
    "in",
    "let",
    "loop",
    "macro",
    "match",
    "mod",
    "move",
    "mut",
    "override",
    "priv",
    "proc_macro",
    "pub",
    "ref",
    "return",
    "self",
    "sk_core",
    "sk_flat",
    "sk_robot",
    "static",
    "std",
    "struct",
    "super",
    "test",
    "trait",
    "true",
    "try",
    "type",
    "typeof",
    "unsafe",
    "unsized",
    "use",
    "virtual",
    "where",
    "while",
    "yield",
];

/// The tree this tool was built from.
const OWN_TREE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

pub fn run(task: &ModuleNew) -> Result<(), String> {
    let name = checked(&task.name)?;
    let folder = task.path.clone().unwrap_or_else(|| PathBuf::from(name));
    refuse_occupied(&folder)?;
    let tree = tree(task.tree.as_deref())?;
    for (file, text) in FILES {
        let path = folder.join(file);
        let told = |error: std::io::Error| format!("cannot write {}: {error}", path.display());
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(told)?;
        }
        fs::write(&path, filled(text, name, tree.as_deref())).map_err(told)?;
    }
    println!("made {}: a module with a test and a program that runs it", folder.display());
    println!("  try   cd {} && cargo test", folder.display());
    println!("        SKROBOT_STATE_DIR=$PWD/state cargo run");
    Ok(())
}

/// A name that can be that of a crate, of a module and of the beginning of channels' names.
fn checked(name: &str) -> Result<&str, String> {
    let refused = |why: &str| format!("a module cannot be called {name:?}: {why}");
    Name::new(name).map_err(|error| refused(&error.to_string()))?;
    if name.contains('.') {
        return Err(refused("a dot stands between the module and its channels"));
    }
    if !name.starts_with(|first: char| first.is_ascii_lowercase()) {
        return Err(refused("begin it with a letter"));
    }
    if TAKEN.contains(&name.replace('-', "_").as_str()) {
        return Err(refused("the word has a meaning in Rust; take another"));
    }
    Ok(name)
}

fn refuse_occupied(folder: &Path) -> Result<(), String> {
    match fs::read_dir(folder).map(|mut entries| entries.next().is_none()) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(format!("{}: {error}", folder.display())),
        Ok(true) => Ok(()),
        Ok(false) => Err(format!("{} is not empty: choose another folder with --path", folder.display())),
    }
}

/// The sources the skeleton is built with; none if it takes the published ones.
fn tree(given: Option<&Path>) -> Result<Option<PathBuf>, String> {
    let is_one =
        |tree: &Path| tree.join("sk-core/Cargo.toml").exists() && tree.join("sk-robot/Cargo.toml").exists();
    let absolute = |tree: &Path| tree.canonicalize().map_err(|error| format!("{}: {error}", tree.display()));
    match given {
        Some(tree) if is_one(tree) => absolute(tree).map(Some),
        Some(tree) => Err(format!("{} has no folders sk-core and sk-robot", tree.display())),
        None if is_one(Path::new(OWN_TREE)) => absolute(Path::new(OWN_TREE)).map(Some),
        None => Ok(None),
    }
}

fn filled(text: &str, name: &str, tree: Option<&Path>) -> String {
    let from = |part: &str| match tree {
        // A path with a quote in it would end the text: TOML escapes it as Rust does.
        Some(tree) => format!("path = {:?}", tree.join(part).to_string_lossy()),
        None => format!("version = \"{}\"", env!("CARGO_PKG_VERSION")),
    };
    text.replace("{{from:sk-core}}", &from("sk-core"))
        .replace("{{from:sk-robot}}", &from("sk-robot"))
        .replace("{{name}}", name)
        .replace("{{crate}}", &name.replace('-', "_"))
        .replace("{{Type}}", &type_name(name))
}

/// `wheel-odometry` is `WheelOdometry`.
fn type_name(name: &str) -> String {
    let parts = name.split(['-', '_']).filter(|part| !part.is_empty());
    let capital = |part: &str| part[..1].to_ascii_uppercase() + &part[1..];
    parts.map(capital).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_must_do_for_a_crate_a_module_and_a_channel() {
        for name in ["wheel-odometry", "lidar2", "a_b"] {
            assert_eq!(checked(name), Ok(name));
        }
        for name in ["", "Wheel", "wheel.left", "2wheels", "-x", "fn", "sk-core", "rad ar", "../x"] {
            assert!(checked(name).is_err(), "{name}");
        }
        assert_eq!(type_name("wheel-odometry_2"), "WheelOdometry2");
    }

    #[test]
    fn nothing_is_left_to_fill_in() {
        for tree in [None, Some(Path::new("/some/tree"))] {
            for (file, text) in FILES {
                let filled = filled(text, "wheel-odometry", tree);
                assert!(!filled.contains("{{"), "{file}: {filled}");
            }
        }
        let manifest = filled(FILES[0].1, "x", None);
        assert!(
            manifest.contains(&format!("version = \"{}\" }}", env!("CARGO_PKG_VERSION"))),
            "{manifest}"
        );
    }
}
