//! Who may know whom: dependencies point down, and two modules meet through channels only.

use super::source::has_word;
use super::{Violation, tree::Tree};
use crate::workspace::Package;

const MACROS: &str = "specialk-flat-macros";
const FLAT: &str = "specialk-flat";
const CORE: &str = "specialk-core";
/// The folder of the hub's modules.
const MODULES: &str = "modules";
/// The folder of the hub, and the one file in it that names modules.
const HUB: &str = "sk-robot/src/";
const REGISTRY: &str = "sk-robot/src/registry.rs";

/// A lower layer never depends on a higher one, and no module on another.
pub(super) fn dependencies_point_down(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for package in &tree.workspace.members {
        let Some(allowed) = allowed(package) else { continue };
        for need in &package.needs {
            let ours = tree.workspace.member(&need.package).is_some();
            let itself = need.package == package.name;
            // The derive is tested on the trait it implements, which lies above it.
            let tests_the_derive = package.name == MACROS && need.tests_only && need.package == FLAT;
            if ours && !itself && !tests_the_derive && !allowed.contains(&need.package.as_str()) {
                let file = format!("{}/Cargo.toml", package.folder.display());
                let may = if allowed.is_empty() { "none".to_owned() } else { allowed.join(", ") };
                let what = format!(
                    "{} must not depend on {}; of our crates it may know: {may}",
                    package.name, need.package
                );
                found.push(Violation::new(&file, 0, what));
            }
        }
    }
    found
}

/// Those of our packages it may depend on; nothing for packages that stand above all layers.
fn allowed(package: &Package) -> Option<&'static [&'static str]> {
    match package.name.as_str() {
        MACROS => Some(&[]),
        FLAT => Some(&[MACROS]),
        CORE => Some(&[FLAT]),
        _ if package.folder.starts_with(MODULES) => Some(&[CORE, FLAT]),
        _ => None,
    }
}

/// In the hub only the registry names the crate of a module.
pub(super) fn only_the_registry_names_modules(tree: &Tree<'_>) -> Vec<Violation> {
    let modules = tree
        .workspace
        .members
        .iter()
        .filter(|package| package.folder.starts_with(MODULES));
    let crates: Vec<String> = modules.filter_map(|package| Some(package.library()?.crate_name())).collect();
    let mut found = Vec::new();
    for (name, source) in tree.rust().filter(|(name, _)| name.starts_with(HUB) && *name != REGISTRY) {
        for (line, code) in source.lines() {
            if let Some(module) = crates.iter().find(|module| has_word(code, module)) {
                let what = format!("names the module crate `{module}`; only {REGISTRY} may");
                found.push(Violation::new(name, line, what));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::{Need, Target, Workspace};

    fn package(name: &str, folder: &str, needs: &[&str]) -> Package {
        let need = |name: &&str| Need { package: (*name).into(), tests_only: false };
        let library =
            Target { name: folder.replace("modules/", "sk_"), kind: "lib".into(), ..Target::default() };
        Package {
            name: name.into(),
            folder: folder.into(),
            needs: needs.iter().map(need).collect(),
            targets: vec![library],
            ..Package::default()
        }
    }

    fn workspace() -> Workspace {
        let members = vec![
            package(FLAT, "sk-flat", &[]),
            package(CORE, "sk-core", &[FLAT, "mio"]),
            package("skrobot", "sk-robot", &[CORE, "module-host"]),
            package("module-host", "modules/host", &[CORE, "serde"]),
            package("module-web", "modules/web", &[CORE]),
        ];
        Workspace { members, ..Workspace::default() }
    }

    #[test]
    fn arrows_that_point_up_or_sideways_are_found() {
        let mut workspace = workspace();
        assert_eq!(broken(dependencies_point_down, &workspace, &[]), Vec::<String>::new());
        workspace.members[0] = package(FLAT, "sk-flat", &[CORE]);
        workspace.members[4] = package("module-web", "modules/web", &["module-host", "skrobot"]);
        let found = broken(dependencies_point_down, &workspace, &[]);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].contains("specialk-flat must not depend on specialk-core"));
        assert!(found[1].contains("module-web must not depend on module-host"));
    }

    #[test]
    fn a_module_named_beside_the_registry_is_found() {
        let files =
            [(REGISTRY, "use sk_host::Host;"), ("sk-robot/src/hub.rs", "\nuse sk_host::Host; // sk_web")];
        let found = broken(only_the_registry_names_modules, &workspace(), &files);
        assert_eq!(found.len(), 1);
        assert!(found[0].starts_with("sk-robot/src/hub.rs:2: names the module crate `sk_host`"));
    }
}
