//! Features are chosen when compiling: a package must build with none of them and with each alone.

use super::Gate;
use crate::process::{self, Failure};
use crate::workspace::Package;

/// Checks every package of ours that has features.
pub(super) fn build_alone(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let mut count = 0;
    for package in &gate.workspace.members {
        for arguments in checks(package) {
            process::run(process::cargo().args(arguments))?;
            count += 1;
        }
    }
    Ok(format!("{count} combinations"))
}

/// The command lines that check one package, none if it has no features.
fn checks(package: &Package) -> Vec<Vec<String>> {
    if package.features.is_empty() {
        return Vec::new();
    }
    let with = |features: &str| {
        let arguments =
            ["check", "--quiet", "--package", &package.name, "--no-default-features", "--features"];
        arguments.into_iter().chain([features]).map(str::to_owned).collect()
    };
    std::iter::once("")
        .chain(package.features.iter().map(String::as_str))
        .map(with)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_is_checked_without_features_and_with_each_alone() {
        let features = vec!["flow".to_owned(), "tls".to_owned()];
        let package = Package { name: "specialk-core".into(), features, ..Package::default() };
        let last: Vec<_> = checks(&package)
            .into_iter()
            .filter_map(|arguments| arguments.last().cloned())
            .collect();
        assert_eq!(last, ["", "flow", "tls"]);
        assert!(checks(&Package::default()).is_empty());
    }
}
