//! What a check has found.

use crate::output::{json, safe};
use sk_core::SkVariant;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    Ok,
    Warn,
    Fail,
}

/// What a check has found, and what to do about it.
#[derive(Clone, Debug)]
pub struct Finding {
    pub mark: Mark,
    what: &'static str,
    says: String,
    todo: String,
}

impl Finding {
    pub fn new(mark: Mark, what: &'static str, says: String, todo: &str) -> Finding {
        Finding { mark, what, says, todo: todo.to_owned() }
    }

    pub fn ok(what: &'static str, says: String) -> Finding {
        Finding::new(Mark::Ok, what, says, "")
    }

    /// As a line for people, with what to do below it, or as a line of JSON.
    pub fn shown(&self, as_json: bool) -> Result<String, String> {
        let mark = match self.mark {
            Mark::Ok => "ok",
            Mark::Warn => "warn",
            Mark::Fail => "fail",
        };
        if as_json {
            return json(&SkVariant::map([
                ("mark", mark.into()),
                ("check", self.what.into()),
                ("says", self.says.as_str().into()),
                ("todo", self.todo.as_str().into()),
            ]));
        }
        let todo =
            if self.todo.is_empty() { String::new() } else { format!("\n      {:15} → {}", "", self.todo) };
        Ok(format!("{mark:4}  {:15}  {}{todo}\n", self.what, safe(&self.says)))
    }
}
