//! `sk doctor`: what keeps a hub from running, or from running well; a line for each check.

mod finding;
mod machine;

use crate::arguments::Arguments;
use crate::commands::call::ask;
use crate::commands::module;
use crate::output::{safe, write};
use crate::session::{Link, Visit};
use crate::table::span;
use finding::{Finding, Mark};
use sk_core::flow::report::HubReport;
use sk_core::prelude::*;
use sk_core::world::World;
use sk_flat::FromVariant;
use sk_robot::places::Places;
use std::cell::RefCell;
use std::rc::Rc;

/// What is found while the hub is asked.
type Findings = Rc<RefCell<Vec<Finding>>>;

pub fn run(arguments: &Arguments) -> Result<(), String> {
    let places = Places::find(arguments.state_dir.as_deref()).map_err(|error| error.to_string())?;
    let world = World::real().map_err(|error| error.to_string())?;
    let mut all = machine::checks(&places, &world);
    drop(world);
    all.extend(of_hub(arguments));
    for finding in &all {
        if !write(finding.shown(arguments.json)?.as_bytes())? {
            break;
        }
    }
    let fails = all.iter().filter(|finding| finding.mark == Mark::Fail).count();
    match fails {
        0 => Ok(()),
        1 => Err("one check failed".to_owned()),
        fails => Err(format!("{fails} checks failed")),
    }
}

fn of_hub(arguments: &Arguments) -> Vec<Finding> {
    let findings = Findings::default();
    let told = findings.clone();
    let visited = Visit::once(arguments, move |cx, link| {
        let asked = cx.clock_now();
        link.hub.inspect(cx, "hub", move |cx, report| {
            let took = cx.clock_now().since(asked);
            let report =
                report.and_then(|report| HubReport::from_variant(&report).map_err(|error| error.to_string()));
            match report {
                Ok(report) => told.borrow_mut().extend(of_report(&report, took)),
                Err(failure) => return link.fail(cx, failure),
            }
            modules(cx, link, told.clone());
        });
    });
    let mut findings = findings.take();
    if let Err(failure) = visited {
        findings.insert(0, Finding::new(Mark::Fail, "hub", failure, "start it: `skrobot`"));
    }
    findings
}

fn of_report(report: &HubReport, took: Duration) -> Vec<Finding> {
    let own = env!("CARGO_PKG_VERSION");
    let says = format!("answers in {}, up {}, {} channels", span(took), span(report.up), report.channels);
    let mut findings = vec![Finding::ok("hub", says)];
    findings.push(match report.version == own {
        true => Finding::ok("version", own.to_owned()),
        false => {
            let says = format!("the hub is {}, this tool {own}", report.version);
            Finding::new(
                Mark::Warn,
                "version",
                says,
                "use those of one release; start the hub again after an update",
            )
        }
    });
    let dropped: u64 = report
        .counts
        .dropped
        .iter()
        .filter(|(why, _)| *why != "gone")
        .map(|(_, count)| count)
        .sum();
    let says = format!("{} delivered, {dropped} dropped", report.counts.delivered);
    findings.push(match dropped * 100 > report.counts.delivered {
        true => Finding::new(
            Mark::Warn,
            "messages",
            says,
            "somebody does not keep up: `sk info CHANNEL` says who",
        ),
        false => Finding::ok("messages", says),
    });
    if report.spurious > 0 {
        let says = format!("{} connections were ended for what they sent", report.spurious);
        findings.push(Finding::new(Mark::Warn, "strangers", says, "the hub's log says where they came from"));
    }
    findings
}

/// The modules that do not run as they should.
fn modules(cx: &mut Cx, link: Link, told: Findings) {
    let Some(service) = module::service(cx, link) else { return cx.quit() };
    let request = SkVariant::map([("do", "list".into())]);
    ask(cx, link, &service, request, Duration::from_secs(2), move |cx, answer| {
        let list = match answer.value() {
            Ok(list) => list,
            Err(error) => {
                told.borrow_mut()
                    .push(Finding::new(Mark::Warn, "modules", error.to_string(), ""));
                return cx.quit();
            }
        };
        let word = |module: &SkVariant, key: &str| {
            module.get(key).and_then(SkVariant::as_str).unwrap_or_default().to_owned()
        };
        let list = list.as_list().unwrap_or_default();
        let mut runs = Vec::new();
        for module in list {
            let (name, state) = (word(module, "name"), word(module, "state"));
            match state.as_str() {
                "running" => runs.push(name),
                "stopped" => {
                    let todo = format!("`sk module start {}`, if it should run", safe(&name));
                    told.borrow_mut().push(Finding::new(
                        Mark::Warn,
                        "module",
                        format!("{name} is stopped"),
                        &todo,
                    ));
                }
                _ => {
                    let says = format!("{name} is {state} {}", word(module, "reason"));
                    let todo = format!("`sk module info {}` tells more", safe(&name));
                    told.borrow_mut().push(Finding::new(
                        Mark::Fail,
                        "module",
                        says.trim_end().to_owned(),
                        &todo,
                    ));
                }
            }
        }
        let says =
            if runs.is_empty() { "none runs".to_owned() } else { format!("{} running", runs.join(", ")) };
        told.borrow_mut().push(Finding::ok("modules", says));
        cx.quit();
    });
}
