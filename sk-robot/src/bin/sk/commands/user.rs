//! `sk user`: accounts and their rights.

use crate::arguments::Arguments;
use crate::output::{print, safe};
use crate::password;
use crate::session::{self, Link, Visit};
use clap::{Args, Subcommand};
use sk_core::flow::rights::{Pattern, RIGHT_PREFIX, read_right};
use sk_core::flow::satellite::AccountInfo;
use sk_core::flow::scram::Password;
use sk_core::flow::{FlowDatabase, Right};
use sk_core::prelude::*;
use std::collections::BTreeSet;

#[derive(Subcommand, Clone, Debug)]
pub enum User {
    /// Add an account; its password is asked for, or is a line of standard input
    Add {
        /// Its name: lower-case letters, digits, `_` and `-`
        name: String,
    },
    /// Change the password of an account: asked for, or a line of standard input
    Passwd {
        /// Its name
        name: String,
    },
    /// Give an account a right for some names
    Grant(Granted),
    /// Take a right for some names away again
    Revoke(Granted),
    /// Show the rights of an account
    Rights {
        /// Its name
        name: String,
    },
    /// List the accounts
    List,
    /// Remove an account with its rights; its connections end
    Remove {
        /// Its name
        name: String,
    },
}

#[derive(Args, Clone, Debug)]
pub struct Granted {
    /// The account
    pub name: String,
    /// list, publish, subscribe, serve, call, blob_read, blob_write, database_read, database_write or administer
    #[arg(value_parser = right)]
    pub right: Right,
    /// Names of channels or databases; one with `*` at its end is all names that begin so. To revoke without any is
    /// to take all
    pub patterns: Vec<Pattern>,
}

fn right(text: &str) -> Result<Right, String> {
    let names: Vec<&str> = Right::ALL.into_iter().map(Right::name).collect();
    Right::by_name(text).ok_or_else(|| format!("there are {}", names.join(", ")))
}

/// One command about accounts, on its way.
struct Manager {
    link: Link,
    task: User,
    /// The answer is for a program.
    json: bool,
    /// The account that this program is logged in to, if that is not the owner's.
    own: Option<String>,
    new_password: Option<Password>,
    /// What is printed when a right was written.
    written: String,
}

object! { Manager { slots { on_entered() on_done() on_refused(&str) } } }

pub fn run(arguments: &Arguments, task: &User) -> Result<(), String> {
    // All that is typed comes before the hub waits for us.
    let credentials = session::credentials(arguments)?;
    let new_password = match task {
        User::Add { name } | User::Passwd { name } => Some(password::new(name)?),
        _ => None,
    };
    let mut visit = Visit::begin_as(arguments, credentials)?;
    let session = visit.session;
    let link = Link { hub: visit.hub, session };
    let cx = visit.app.cx();
    let (task, own, written) = (task.clone(), arguments.user.clone(), String::new());
    let manager = cx.spawn(Manager { link, task, json: arguments.json, own, new_password, written });
    attach!(cx, session.entered => manager.on_entered, Queued);
    visit.run()
}

impl Manager {
    fn on_entered(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let link = self.link;
        match self.task.clone() {
            User::Add { name } => self.add(cx, name),
            User::Passwd { name } if self.own.as_ref() == Some(&name) => self.set(cx, &name, "changed"),
            User::Passwd { name } => self.change(cx, name),
            User::Remove { name } => self.link.hub.remove_account(cx, &name.clone(), move |cx, outcome| {
                let removed = format!("account {name} removed; its connections have ended\n");
                link.end(cx, outcome.map(|()| removed));
            }),
            User::List => {
                let json = self.json;
                self.link.hub.accounts(cx, move |cx, accounts| {
                    link.end(cx, accounts.map(|accounts| list(&accounts, json)));
                })
            }
            User::Rights { name } => self.show(cx, &name),
            User::Grant(granted) => self.change_right(cx, granted, true),
            User::Revoke(granted) => self.change_right(cx, granted, false),
        }
    }

    fn add(&mut self, cx: &mut Cx, name: String) -> std::io::Result<()> {
        self.if_known(cx, name, |manager, cx, name, known| {
            if known {
                let why = format!("there is an account {name}: `sk user passwd {name}` changes its password");
                manager.link.end(cx, Err(why));
                return Ok(());
            }
            manager.set(cx, name, "added; it has no rights yet: `sk user grant` gives it some")
        })
    }

    fn change(&mut self, cx: &mut Cx, name: String) -> std::io::Result<()> {
        self.if_known(cx, name, |manager, cx, name, known| {
            if !known {
                manager.link.end(cx, Err(format!("there is no account {name}: `sk user list`")));
                return Ok(());
            }
            manager.set(cx, name, "has a new password")
        })
    }

    fn if_known(
        &mut self,
        cx: &mut Cx,
        name: String,
        then: impl FnOnce(&mut Manager, &mut Cx, &str, bool) -> std::io::Result<()> + 'static,
    ) -> std::io::Result<()> {
        let (this, link) = (cx.this(self), self.link);
        self.link.hub.accounts(cx, move |cx, accounts| {
            let done = accounts.and_then(|accounts| {
                let known = accounts.iter().any(|account| account.name == name);
                match cx.with(this, |manager, cx| then(manager, cx, &name, known)) {
                    Ok(done) => done.map_err(|error| error.to_string()),
                    Err(error) => Err(error.to_string()),
                }
            });
            if let Err(why) = done {
                link.end(cx, Err(why));
            }
        })
    }

    fn set(&mut self, cx: &mut Cx, name: &str, what: &str) -> std::io::Result<()> {
        let (link, text) = (self.link, format!("account {name} {what}\n"));
        let Some(password) = self.new_password.take() else { return Ok(()) };
        self.link.hub.set_account(cx, name, password, move |cx, outcome| {
            link.end(cx, outcome.map(|()| text));
        })
    }

    // ---- rights ----

    fn database(&self, cx: &mut Cx, name: &str) -> std::io::Result<Handle<FlowDatabase>> {
        self.link.hub.database(cx, &format!("user:{name}"))
    }

    fn show(&mut self, cx: &mut Cx, name: &str) -> std::io::Result<()> {
        let database = self.database(cx, name)?;
        let link = self.link;
        for right in Right::ALL {
            let last = right == Right::Administer;
            let name = name.to_owned();
            database.get(cx, &key_of(right), move |cx, value| match value {
                Err(why) => link.end(cx, Err(format!("account {name}: {why}"))),
                Ok(value) => {
                    let line = value.map(|value| format!("{:15} {}\n", right.name(), shown(right, &value)));
                    let printed = print(cx, &line.unwrap_or_default());
                    if last || printed.is_err() {
                        link.end(cx, printed.map(|()| String::new()));
                    }
                }
            });
        }
        Ok(())
    }

    fn change_right(&mut self, cx: &mut Cx, granted: Granted, add: bool) -> std::io::Result<()> {
        let (this, link) = (cx.this(self), self.link);
        let database = self.database(cx, &granted.name)?;
        attach!(cx, database.done => this.on_done());
        attach!(cx, database.refused => this.on_refused);
        let right = granted.right;
        let asked = database.get(cx, &key_of(right), move |cx, value| {
            let wanted = value.and_then(|value| wanted(right, value.as_ref(), &granted.patterns, add));
            let patterns = match wanted {
                Ok(patterns) => patterns,
                Err(why) => return link.end(cx, Err(format!("account {}: {why}", granted.name))),
            };
            let texts: Vec<String> = patterns.iter().map(Pattern::to_string).collect();
            let text = match texts.is_empty() {
                true => format!("{} may {} nothing\n", granted.name, right.name()),
                false => format!("{} may {}: {}\n", granted.name, right.name(), texts.join(" ")),
            };
            // It was there when it asked.
            let _ = cx.with(this, |manager, _| manager.written = text);
            let sent = match texts.is_empty() {
                true => database.delete(cx, &key_of(right)),
                false => database.set(cx, &key_of(right), SkVariant::list(texts)),
            };
            if !sent {
                link.end(cx, Err("too much waits to be sent".to_owned()));
            }
        });
        if !asked {
            link.end(cx, Err("too much waits to be sent".to_owned()));
        }
        Ok(())
    }

    fn on_done(&mut self, cx: &mut Cx) {
        self.link.end(cx, Ok(std::mem::take(&mut self.written)));
    }

    fn on_refused(&mut self, cx: &mut Cx, why: &str) {
        self.link.end(cx, Err(why.to_owned()));
    }
}

fn key_of(right: Right) -> String {
    format!("{RIGHT_PREFIX}{}", right.name())
}

/// The patterns of a right after a change.
fn wanted(
    right: Right,
    value: Option<&SkVariant>,
    patterns: &[Pattern],
    add: bool,
) -> Result<BTreeSet<Pattern>, String> {
    if !add && patterns.is_empty() {
        return Ok(BTreeSet::new());
    }
    let there = value.map(|value| read_right(&key_of(right), value)).transpose();
    let there = there.map_err(|why| {
        format!("its right to {} cannot be read: {why}; revoke it without patterns first", right.name())
    })?;
    let mut all: BTreeSet<Pattern> =
        there.map(|(_, patterns)| patterns).unwrap_or_default().into_iter().collect();
    for pattern in patterns {
        if add {
            all.insert(pattern.clone());
        } else if !all.remove(pattern) {
            return Err(format!("it was not granted {} for {pattern}", right.name()));
        }
    }
    Ok(all)
}

fn shown(right: Right, value: &SkVariant) -> String {
    match read_right(&key_of(right), value) {
        Ok((_, patterns)) => patterns.iter().map(Pattern::to_string).collect::<Vec<_>>().join(" "),
        Err(why) => format!("grants nothing: {why}"),
    }
}

fn list(accounts: &[AccountInfo], json: bool) -> String {
    if json {
        let line = |account: &AccountInfo| {
            let name = SkVariant::from(account.name.as_str());
            let object = SkVariant::map([("connections", account.connections.into()), ("name", name)]);
            // A name and a number have a JSON form.
            object.to_json().map(|json| json + "\n").unwrap_or_default()
        };
        return accounts.iter().map(line).collect();
    }
    let names = accounts.iter().map(|account| account.name.chars().count());
    let width = names.max().unwrap_or(0).max("ACCOUNT".len());
    let head = format!("{:width$}  CONNECTIONS\n", "ACCOUNT");
    let line = |account: &AccountInfo| format!("{:width$}  {}\n", safe(&account.name), account.connections);
    std::iter::once(head).chain(accounts.iter().map(line)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patterns(texts: &[&str]) -> Vec<Pattern> {
        texts.iter().map(|text| text.parse().unwrap()).collect()
    }

    #[test]
    fn granting_adds_and_revoking_takes_away_what_was_granted_and_nothing_else() {
        let there = SkVariant::list(["ada.*", "bob.imu"]);
        let change = |value: Option<&SkVariant>, texts: &[&str], add| {
            let all = wanted(Right::Publish, value, &patterns(texts), add)?;
            Ok::<_, String>(all.iter().map(Pattern::to_string).collect::<Vec<_>>())
        };
        assert_eq!(change(None, &["ada.*"], true).unwrap(), ["ada.*"]);
        assert_eq!(change(Some(&there), &["ada.*", "x"], true).unwrap(), ["ada.*", "bob.imu", "x"]);
        assert_eq!(change(Some(&there), &["ada.*"], false).unwrap(), ["bob.imu"]);
        assert!(change(Some(&there), &["ada"], false).is_err(), "it was not granted");
        assert!(change(Some(&"*".into()), &["x"], true).is_err(), "what is there cannot be read");
        assert_eq!(change(Some(&"*".into()), &[], false).unwrap(), [""; 0]);
    }
}
