//! From the text of a file to a configuration, with every problem at its line and column.

use super::place::{find, line_and_column};
use super::{
    Config, ConfigError, HubSection, LoopSection, ModuleConfig, ModuleSection, Problem, RestartSection,
    ThreadSection,
};
use crate::hint::hint;
use sk_core::module::{ModuleClass, ParameterError, Parameters};
use sk_core::prelude::*;
use sk_flat::{Name, VariantError};
use std::collections::BTreeMap;
use std::path::Path;
use tracing_subscriber::filter::Targets;

/// The longest configuration that is read, in bytes.
pub const FILE_BYTES_MAX: u64 = 1024 * 1024;

/// The sections of the top; `$schema` tells an editor where the schema is.
const SECTIONS: [&str; 4] = ["$schema", "listen", "loop", "modules"];
/// The sections of a module.
const MODULE_SECTIONS: [&str; 3] = ["parameters", "restart", "thread"];

impl Config {
    /// Reads a configuration for a hub with these modules. What it does not say has its default.
    ///
    /// # Errors
    /// It is no JSON, names something that does not exist, or says something that cannot be: all of that, each
    /// with its line and column.
    pub fn read(text: &str, classes: &[ModuleClass]) -> Result<Config, ConfigError> {
        let whole =
            SkVariant::from_json(text).map_err(|error| ConfigError::problems_of(vec![malformed(&error)]))?;
        let mut reader = Reader { text, problems: Vec::new() };
        let hub: HubSection = reader.section(&[], &whole, &SECTIONS);
        reader.check_hub(&hub);
        let listen = reader.below(&whole, "listen");
        let event_loop = reader.event_loop(&whole);
        let modules = reader.modules(&whole, classes);
        if reader.problems.is_empty() {
            Ok(Config { hub, listen, event_loop, modules })
        } else {
            Err(ConfigError::problems_of(reader.problems))
        }
    }

    /// As [`read`](Config::read), from a file. Blocks on the disk.
    ///
    /// # Errors
    /// The file cannot be read, or as for its text.
    pub fn read_file(
        storage: &dyn sk_core::world::Storage,
        file: &Path,
        classes: &[ModuleClass],
    ) -> Result<Config, ConfigError> {
        let bytes = storage
            .read(file, FILE_BYTES_MAX)
            .map_err(|error| ConfigError::unreadable(file, error))?;
        let text = String::from_utf8(bytes).map_err(|error| ConfigError::unreadable(file, error))?;
        Config::read(&text, classes).map_err(|error| error.in_file(file))
    }
}

/// Text that is no JSON at all, or nests too deep.
fn malformed(error: &VariantError) -> Problem {
    match error {
        VariantError::Text { line, column, message } => {
            Problem { line: *line, column: *column, what: message.to_string() }
        }
        other => Problem { line: 1, column: 1, what: other.to_string() },
    }
}

struct Reader<'a> {
    text: &'a str,
    problems: Vec<Problem>,
}

impl Reader<'_> {
    fn complain(&mut self, at: usize, what: String) {
        let (line, column) = line_and_column(self.text, at);
        self.problems.push(Problem { line, column, what });
    }

    fn complain_of_key(&mut self, path: &[&str], what: String) {
        let at = find(self.text, path).map_or(0, |place| place.key);
        self.complain(at, what);
    }

    fn complain_of_value(&mut self, path: &[&str], what: String) {
        let at = find(self.text, path).map_or(0, |place| place.value);
        self.complain(at, what);
    }

    /// The entries of an object; of something else none, and a problem.
    fn entries<'v>(
        &mut self,
        path: &[&str],
        value: &'v SkVariant,
    ) -> impl Iterator<Item = (&'v String, &'v SkVariant)> + use<'v> {
        let map = value.as_map();
        if map.is_none() {
            self.complain_of_value(path, format!("an object is wanted here, found {}", value.kind()));
        }
        map.into_iter().flatten()
    }

    /// A section that is declared, and the names of those that stand inside it.
    fn section<P: Parameters>(&mut self, path: &[&str], value: &SkVariant, inner: &[&str]) -> P {
        let mut section = P::default();
        for (key, value) in self.entries(path, value) {
            if inner.contains(&key.as_str()) {
                continue;
            }
            if let Err(error) = section.set(key, value) {
                let known = P::describe().iter().map(|info| info.name);
                self.refused(
                    path,
                    key,
                    &error,
                    known.chain(inner.iter().copied().filter(|key| *key != "$schema")),
                );
            }
        }
        section
    }

    fn refused<'n>(
        &mut self,
        path: &[&str],
        key: &str,
        error: &ParameterError,
        known: impl Iterator<Item = &'n str>,
    ) {
        let path: Vec<&str> = path.iter().copied().chain([key]).collect();
        match error {
            ParameterError::Unknown { .. } => {
                self.complain_of_key(&path, format!("no key `{}`; {}", shown(key), hint(key, known)));
            }
            _ => self.complain_of_value(&path, error.to_string()),
        }
    }

    /// A section of the top; the default if there is none.
    fn below<P: Parameters>(&mut self, whole: &SkVariant, name: &str) -> P {
        whole
            .get(name)
            .map_or_else(P::default, |value| self.section(&[name], value, &[]))
    }

    fn check_hub(&mut self, hub: &HubSection) {
        let account = hub
            .account
            .parse::<Name>()
            .and_then(|account| Name::compose(&account, &account));
        if let Err(error) = account {
            self.complain_of_value(&["account"], format!("the account cannot be: {error}"));
        }
        if let Err(error) = hub.log.parse::<Targets>() {
            self.complain_of_value(&["log"], format!("the filter cannot be read: {error}"));
        }
    }

    fn event_loop(&mut self, whole: &SkVariant) -> LoopSection {
        let mut section: LoopSection = self.below(whole, "loop");
        let said = whole.get("loop").and_then(|section| section.get("slow_interval_us")).is_some();
        if section.slow_interval_us < section.interval_us && said {
            let what =
                format!("the slow interval is below the fast one, which is {} us", section.interval_us);
            self.complain_of_value(&["loop", "slow_interval_us"], what);
        }
        section.slow_interval_us = section.slow_interval_us.max(section.interval_us);
        section
    }

    fn modules(&mut self, whole: &SkVariant, classes: &[ModuleClass]) -> BTreeMap<String, ModuleConfig> {
        let mut modules = Config::new(classes).modules;
        let Some(section) = whole.get("modules") else { return modules };
        for (name, value) in self.entries(&["modules"], section) {
            match classes.iter().find(|class| class.name() == name) {
                Some(class) => {
                    let module = self.module(name, value, class);
                    modules.insert(name.clone(), module);
                }
                None => {
                    let known = classes.iter().map(ModuleClass::name);
                    let what = format!("no module `{}`; {}", shown(name), hint(name, known));
                    self.complain_of_key(&["modules", name], what);
                }
            }
        }
        modules
    }

    fn module(&mut self, name: &str, value: &SkVariant, class: &ModuleClass) -> ModuleConfig {
        let path = ["modules", name];
        let ModuleSection { enabled } = self.section(&path, value, &MODULE_SECTIONS);
        let mut module = ModuleConfig { enabled, ..ModuleConfig::new(class) };
        if let Some(restart) = value.get("restart") {
            let path = ["modules", name, "restart"];
            module.restart = self.section::<RestartSection>(&path, restart, &[]);
        }
        if let Some(thread) = value.get("thread").filter(|thread| **thread != SkVariant::Null) {
            let path = ["modules", name, "thread"];
            module.thread = Some(self.section::<ThreadSection>(&path, thread, &[]));
        }
        if let Some(parameters) = value.get("parameters") {
            let path = ["modules", name, "parameters"];
            let before = self.problems.len();
            for (key, value) in self.entries(&path, parameters) {
                if let Err(error) = class.check_one(key, value) {
                    let known = class.describe().iter().map(|info| info.name);
                    self.refused(&path, key, &error, known);
                }
            }
            if self.problems.len() == before {
                match class.complete(parameters) {
                    Ok(complete) => module.parameters = complete,
                    Err(error) => self.complain_of_value(&path, error.to_string()),
                }
            }
        }
        module
    }
}

/// A key of the file, short enough for one line.
fn shown(key: &str) -> String {
    let short: String = key.chars().take(64).collect();
    short.escape_debug().to_string()
}
