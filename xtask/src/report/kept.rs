//! What a bench came to, kept below cargo's target folder, so that one bench can be measured anew without the
//! others: each takes a quiet machine for minutes.

use super::Outcome;
use super::goals::Figure;
use crate::process::Failure;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The folder of what was measured on this machine.
pub(super) struct Kept {
    folder: PathBuf,
}

impl Kept {
    pub(super) fn below(target: &Path) -> Result<Kept, Failure> {
        let folder = target.join("bench-report");
        std::fs::create_dir_all(&folder).map_err(|error| Failure::file(&folder, error))?;
        Ok(Kept { folder })
    }

    pub(super) fn write(&self, key: &str, outcome: &Outcome) -> Result<(), Failure> {
        let text = json!({
            "command": outcome.command,
            "measured": outcome.measured,
            "load_before": outcome.load_before,
            "cycles": outcome.cycles,
            "table": outcome.table,
            "lines": outcome.lines,
        });
        let path = self.path(key);
        std::fs::write(&path, text.to_string()).map_err(|error| Failure::file(&path, error))
    }

    /// What was kept under this key, if it can be read.
    pub(super) fn read(&self, key: &str) -> Option<Outcome> {
        let kept: Value = serde_json::from_str(&std::fs::read_to_string(self.path(key)).ok()?).ok()?;
        let text = |name: &str| Some(kept.get(name)?.as_str()?.to_owned());
        let lines = text("lines")?;
        Some(Outcome {
            command: text("command")?,
            measured: text("measured")?,
            load_before: text("load_before")?,
            cycles: kept.get("cycles")?.as_u64(),
            table: text("table")?,
            figures: lines.lines().filter_map(Figure::read).collect(),
            lines,
        })
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.json"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_is_read_as_it_was() -> Result<(), Failure> {
        let folder = std::env::temp_dir().join(format!("bench-report-{}", std::process::id()));
        let kept = Kept::below(&folder)?;
        let line = r#"{"bench":"b","case":"c","metric":"m","value":0.5,"unit":"ns","peer":null}"#;
        let outcome = Outcome {
            command: "cargo bench".into(),
            measured: "2026-01-01 12:00 UTC at abc".into(),
            load_before: "0.10 0.20 0.30".into(),
            cycles: Some(100_000),
            table: "b\n  case\n".into(),
            figures: Figure::read(line).into_iter().collect(),
            lines: format!("{line}\n"),
        };
        kept.write("b", &outcome)?;
        let again = kept.read("b");
        let missing = kept.read("c").is_none();
        std::fs::remove_dir_all(&folder).map_err(|error| Failure::file(&folder, error))?;
        let again = again.ok_or_else(|| Failure::Other("nothing was kept".into()))?;
        assert_eq!(
            (again.measured, again.cycles, again.lines),
            (outcome.measured, outcome.cycles, outcome.lines)
        );
        assert_eq!(again.figures.len(), 1);
        assert!(missing);
        Ok(())
    }
}
