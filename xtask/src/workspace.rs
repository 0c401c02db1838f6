//! What `cargo metadata` knows about this workspace, reduced to what the commands need.

use crate::process::{self, Failure};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The workspace.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    pub(crate) root: PathBuf,
    pub(crate) target: PathBuf,
    /// Our own packages.
    pub(crate) members: Vec<Package>,
}

/// One package.
#[derive(Debug, Default, Clone)]
pub(crate) struct Package {
    pub(crate) name: String,
    /// The folder of the manifest, relative to the root.
    pub(crate) folder: PathBuf,
    pub(crate) description: Option<String>,
    pub(crate) needs: Vec<Need>,
    pub(crate) targets: Vec<Target>,
    /// The names of its features, `default` left out.
    pub(crate) features: Vec<String>,
}

/// A dependency as the manifest names it.
#[derive(Debug, Default, Clone)]
pub(crate) struct Need {
    pub(crate) package: String,
    /// Whether only tests, examples and benches see it.
    pub(crate) tests_only: bool,
}

/// A thing cargo builds from a package.
#[derive(Debug, Default, Clone)]
pub(crate) struct Target {
    pub(crate) name: String,
    /// `lib`, `bin`, `proc-macro`, `example`, `test`, `bench` or `custom-build`.
    pub(crate) kind: String,
    /// The root file, relative to the root of the workspace.
    pub(crate) file: PathBuf,
}

impl Target {
    /// The name under which code refers to the crate.
    pub(crate) fn crate_name(&self) -> String {
        self.name.replace('-', "_")
    }
}

impl Package {
    /// The library of the package, if it has one.
    pub(crate) fn library(&self) -> Option<&Target> {
        self.targets
            .iter()
            .find(|target| target.kind == "lib" || target.kind == "proc-macro")
    }
}

impl Workspace {
    /// Asks cargo.
    pub(crate) fn load() -> Result<Self, Failure> {
        let mut ask = process::cargo();
        ask.args(["metadata", "--format-version", "1", "--no-deps"]);
        let answer: Value = serde_json::from_str(&process::read(&mut ask)?)
            .map_err(|error| Failure::Other(format!("cargo metadata answers no JSON: {error}")))?;
        Ok(Self::from_metadata(&answer))
    }

    fn from_metadata(answer: &Value) -> Self {
        let root = PathBuf::from(text(&answer["workspace_root"]));
        let members = list(&answer["packages"]).map(|value| package(value, &root)).collect();
        Self { target: PathBuf::from(text(&answer["target_directory"])), members, root }
    }

    /// Our package of that name.
    pub(crate) fn member(&self, name: &str) -> Option<&Package> {
        self.members.iter().find(|package| package.name == name)
    }
}

fn package(value: &Value, root: &Path) -> Package {
    let inside = |path: &str| {
        let path = Path::new(path);
        path.strip_prefix(root).unwrap_or(path).to_owned()
    };
    let manifest = inside(text(&value["manifest_path"]));
    Package {
        name: text(&value["name"]).to_owned(),
        folder: manifest.parent().unwrap_or(Path::new("")).to_owned(),
        description: value["description"].as_str().map(str::to_owned),
        needs: list(&value["dependencies"])
            .map(|need| Need {
                package: text(&need["name"]).to_owned(),
                tests_only: need["kind"].as_str() == Some("dev"),
            })
            .collect(),
        targets: list(&value["targets"])
            .map(|target| Target {
                name: text(&target["name"]).to_owned(),
                kind: text(&target["kind"][0]).to_owned(),
                file: inside(text(&target["src_path"])),
            })
            .collect(),
        features: value["features"]
            .as_object()
            .map(|features| features.keys().filter(|name| *name != "default").cloned().collect())
            .unwrap_or_default(),
    }
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().map(Vec::as_slice).unwrap_or_default().iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_is_reduced_to_what_the_commands_need() {
        let answer = serde_json::json!({
            "workspace_root": "/w", "target_directory": "/w/target",
            "packages": [
                { "id": "ours", "name": "specialk-core", "version": "1.0.0", "description": "d",
                  "manifest_path": "/w/sk-core/Cargo.toml", "features": { "default": ["flow"], "flow": [] },
                  "dependencies": [{ "name": "mio", "kind": null }, { "name": "proptest", "kind": "dev" }],
                  "targets": [{ "name": "sk-core", "kind": ["lib"], "src_path": "/w/sk-core/src/lib.rs" }] },
            ],
        });
        let workspace = Workspace::from_metadata(&answer);
        let core = workspace.member("specialk-core").unwrap();
        assert_eq!(core.folder, Path::new("sk-core"));
        assert_eq!(core.library().unwrap().file, Path::new("sk-core/src/lib.rs"));
        assert_eq!(core.library().unwrap().crate_name(), "sk_core");
        assert_eq!(core.needs.iter().map(|need| need.tests_only).collect::<Vec<_>>(), [false, true]);
        assert_eq!(core.features, ["flow"]);
        assert!(workspace.member("mio").is_none());
    }
}
