//! `sk graph`: who publishes to whom.

use crate::arguments::Arguments;
use crate::names::own_flow;
use crate::output::{json, safe};
use crate::session::Visit;
use clap::Args;
use sk_core::flow::report::{GraphChannel, GraphReport};
use sk_flat::FromVariant;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

#[derive(Args, Debug, Clone)]
pub struct Graph {
    /// For Graphviz: `sk graph --dot | dot -Tsvg`
    #[arg(long)]
    pub dot: bool,
}

pub fn run(arguments: &Arguments, task: &Graph) -> Result<(), String> {
    let (dot, as_json) = (task.dot, arguments.json);
    Visit::once(arguments, move |cx, link| {
        let own = own_flow(cx, link.hub);
        link.hub.inspect(cx, "graph", move |cx, told| {
            let text = told.and_then(|told| {
                if as_json {
                    return json(&told);
                }
                let mut graph = GraphReport::from_variant(&told).map_err(|error| error.to_string())?;
                // This visit is no part of what is looked at.
                graph.flows.retain(|flow| *flow != own);
                Ok(if dot { as_dot(&graph) } else { as_text(&graph) })
            });
            link.end(cx, text);
        });
    })
}

/// Each owner with its channels, and behind each arrow who hears them.
fn as_text(graph: &GraphReport) -> String {
    let mut owners: BTreeMap<&str, Vec<&GraphChannel>> = BTreeMap::new();
    let mut alone: BTreeSet<&str> = graph.flows.iter().map(String::as_str).collect();
    for channel in &graph.channels {
        owners.entry(&channel.owner).or_default().push(channel);
        alone.remove(channel.owner.as_str());
        for subscriber in &channel.subscribers {
            alone.remove(subscriber.as_str());
        }
    }
    let mut text = String::new();
    for (owner, mut channels) in owners {
        channels.sort_by(|one, other| one.name.cmp(&other.name));
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(text, "{}", safe(owner));
        for (index, channel) in channels.iter().enumerate() {
            let branch = if index + 1 == channels.len() { "└─" } else { "├─" };
            let _ = write!(text, "  {branch} {}", safe(&channel.name));
            if channel.kind != "stream" {
                let _ = write!(text, " ({})", safe(&channel.kind));
            }
            if let Some(source) = &channel.repeats {
                let _ = write!(text, " ⟵ repeats {}", safe(source));
            }
            if !channel.subscribers.is_empty() {
                let _ = write!(text, " ──▶ {}", safe(&channel.subscribers.join(", ")));
            }
            text.push('\n');
        }
    }
    for flow in alone {
        let _ = writeln!(text, "{}  (no channels)", safe(flow));
    }
    if graph.left_out > 0 {
        let _ = writeln!(text, "and {} more", graph.left_out);
    }
    if text.is_empty() { "nothing\n".to_owned() } else { text }
}

fn as_dot(graph: &GraphReport) -> String {
    let quoted = |name: &str| format!("{:?}", safe(name));
    let mut text = String::from("digraph flow {\n  rankdir=LR;\n");
    for flow in &graph.flows {
        let _ = writeln!(text, "  {} [shape=ellipse];", quoted(flow));
    }
    for channel in &graph.channels {
        let name = quoted(&channel.name);
        let shape = if channel.kind == "stream" { "box" } else { "component" };
        let _ = writeln!(text, "  {name} [shape={shape}];\n  {} -> {name};", quoted(&channel.owner));
        if let Some(source) = &channel.repeats {
            let _ = writeln!(text, "  {} -> {name} [style=dashed];", quoted(source));
        }
        for subscriber in &channel.subscribers {
            let _ = writeln!(text, "  {name} -> {};", quoted(subscriber));
        }
    }
    text + "}\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph() -> GraphReport {
        let channel = |name: &str, kind: &str, subscribers: &[&str]| GraphChannel {
            name: name.to_owned(),
            kind: kind.to_owned(),
            owner: if kind == "service" { "hub".to_owned() } else { "robot.arm".to_owned() },
            repeats: None,
            subscribers: subscribers.iter().map(|&name| name.to_owned()).collect(),
        };
        GraphReport {
            flows: ["robot.arm", "robot.eye", "robot.idle"].map(str::to_owned).to_vec(),
            channels: vec![
                channel("robot.b", "stream", &["robot.eye"]),
                channel("robot.a", "stream", &[]),
                channel("robot.modules", "service", &[]),
            ],
            left_out: 0,
        }
    }

    #[test]
    fn owners_have_their_channels_below_them_and_hearers_behind() {
        let drawn = "hub\n  └─ robot.modules (service)\nrobot.arm\n  ├─ robot.a\n  └─ robot.b ──▶ robot.eye\nrobot.idle  (no channels)\n";
        assert_eq!(as_text(&graph()), drawn);
    }

    #[test]
    fn graphviz_gets_nodes_and_edges() {
        let dot = as_dot(&graph());
        assert!(
            dot.contains("\"robot.b\" -> \"robot.eye\";") && dot.contains("\"robot.arm\" -> \"robot.b\";")
        );
        assert!(dot.starts_with("digraph flow {") && dot.ends_with("}\n"));
    }
}
