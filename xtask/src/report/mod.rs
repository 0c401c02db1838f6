//! `cargo xtask bench-report`: runs every bench and writes `docs/performance.md` from what came out.
//!
//! The page says on what was measured and how, tells every goal beside the figure reached, and holds the
//! tables of all benches and the plots of the ticks.

mod goals;

use crate::process::{self, Failure};
use crate::workspace::Workspace;
use goals::{Figure, GOALS};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// How the report is made.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// How often every side of every bench is run.
    #[arg(long, default_value_t = 5, value_name = "N")]
    runs: usize,
    /// How long each side ticks in each run.
    #[arg(long, default_value_t = 20.0, value_name = "S")]
    seconds: f64,
}

/// One invocation of a bench.
struct Part {
    title: &'static str,
    bench: &'static str,
    arguments: Vec<String>,
    /// The name of the plot, below the page's folder.
    plot: Option<&'static str>,
}

/// What it came to.
struct Outcome {
    command: String,
    table: String,
    figures: Vec<Figure>,
}

/// The page, and the folder of its plots.
const PAGE: &str = "docs/performance.md";
const PLOTS: &str = "docs/performance";

fn parts(options: &Options) -> Vec<Part> {
    let tick = |title, plot: &'static str, words: &[&str]| {
        let seconds = options.seconds.to_string();
        let arguments = words
            .iter()
            .copied()
            .chain(["--seconds", &seconds])
            .map(str::to_owned)
            .collect();
        Part { title, bench: "tick_jitter", arguments, plot: Some(plot) }
    };
    let plain = |title, bench| Part { title, bench, arguments: Vec::new(), plot: None };
    vec![
        tick("Tick of 1 ms, real-time class, idle", "tick-1000us-fifo-idle.svg", &[]),
        tick("Tick of 1 ms, real-time class, under load", "tick-1000us-fifo-load.svg", &["--load"]),
        tick(
            "Tick of 100 us, real-time class, idle",
            "tick-100us-fifo-idle.svg",
            &["--interval-us", "100"],
        ),
        tick(
            "Tick of 1 ms without privilege, idle",
            "tick-1000us-other-idle.svg",
            &["--policy", "other"],
        ),
        plain("Signals and slots", "signal_slot"),
        plain("Objects", "objects"),
        plain("The loop with many idle things", "loop_scale"),
        plain("Build time", "build_time"),
    ]
}

/// Runs and writes.
pub(crate) fn run(options: &Options) -> Result<(), Failure> {
    let workspace = Workspace::load()?;
    std::env::set_current_dir(&workspace.root).map_err(|error| Failure::file(&workspace.root, error))?;
    std::fs::create_dir_all(PLOTS).map_err(|error| Failure::file(Path::new(PLOTS), error))?;
    let mut outcomes = Vec::new();
    for part in parts(options) {
        println!("== {}", part.title);
        let outcome = measure(&part, options)?;
        outcomes.push((part, outcome));
    }
    let page = page(&machine(), &outcomes);
    std::fs::write(PAGE, page).map_err(|error| Failure::file(Path::new(PAGE), error))?;
    println!("written: {PAGE}");
    Ok(())
}

fn measure(part: &Part, options: &Options) -> Result<Outcome, Failure> {
    let mut command = process::cargo();
    command.args(["bench", "--quiet", "--package", "sk-benches", "--bench", part.bench, "--"]);
    command.args(&part.arguments).args(["--runs", &options.runs.to_string()]);
    let spelled = process::spelled(&command);
    if let Some(plot) = part.plot {
        // Cargo starts a bench in the folder of its package.
        command.arg("--plot").arg(Path::new("..").join(PLOTS).join(plot));
    }
    let (figures, said) = process::read_both(command.arg("--json"))?;
    let table = table_in(&said, part.bench);
    print!("{table}");
    let figures = figures.lines().filter_map(Figure::read).collect();
    Ok(Outcome { command: spelled, table, figures })
}

/// The table begins with the name of the bench; before it stand progress and what peers complained of.
fn table_in(said: &str, bench: &str) -> String {
    let lines: Vec<&str> = said.lines().skip_while(|line| *line != bench).collect();
    lines.join("\n") + "\n"
}

/// On what was measured: one line each.
fn machine() -> Vec<(&'static str, String)> {
    let said = |program: &str, words: &[&str]| {
        let answer = process::read(Command::new(program).args(words)).unwrap_or_default();
        answer.lines().next().unwrap_or_default().trim().to_owned()
    };
    let file = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let cpu = file("/proc/cpuinfo");
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split(": ").nth(1));
    let cpus = std::thread::available_parallelism().map_or(0, usize::from);
    let virtual_machine = cpu
        .lines()
        .any(|line| line.starts_with("flags") && line.contains(" hypervisor"));
    vec![
        ("date", said("date", &["-u", "+%Y-%m-%d %H:%M UTC"])),
        ("commit", said("git", &["rev-parse", "--short", "HEAD"])),
        ("processor", format!("{}, {cpus} CPUs", model.unwrap_or("unknown"))),
        ("virtual machine", if virtual_machine { "yes" } else { "no" }.to_owned()),
        ("kernel", said("uname", &["-sr"])),
        (
            "load average at the end",
            file("/proc/loadavg").split(' ').take(3).collect::<Vec<_>>().join(" "),
        ),
        ("Rust", said("rustc", &["--version"])),
        ("C++", said("g++", &["--version"])),
        ("Qt", said("pkg-config", &["--modversion", "Qt6Core"])),
        ("libsigc++", said("pkg-config", &["--modversion", "sigc++-2.0"])),
        ("Boost", said("dpkg-query", &["--show", "--showformat=${Version}", "libboost-dev"])),
        ("rt-tests", said("dpkg-query", &["--show", "--showformat=${Version}", "rt-tests"])),
    ]
}

fn page(machine: &[(&'static str, String)], outcomes: &[(Part, Outcome)]) -> String {
    let mut page = String::from(
        "# Performance\n\nThis page is written by `cargo xtask bench-report`, after `cargo xtask bench-peers`; \
         do not edit it by hand.\n\nEvery side of every run is a process of its own, and the sides take turns. \
         A figure is the median over the runs, with the lowest and the highest beside it. The ratio is our \
         median divided by the peer's: below 1 ours is smaller. The 99.9th percentile and the maximum of a tick \
         belong to the host when the machine is a virtual one.\n\nWhat the hot paths cost part by part, \
         counted in instructions, stands in [profiles](performance/profiles.md).\n\n| measured on | |\n|---|---|\n",
    );
    for (what, value) in machine.iter().filter(|(_, value)| !value.is_empty()) {
        // Writing to a string does not fail.
        let _ = writeln!(page, "| {what} | {value} |");
    }
    let figures: Vec<Figure> = outcomes.iter().flat_map(|(_, outcome)| outcome.figures.clone()).collect();
    page.push_str(
        "\n## Goals\n\n| case | metric | compared with | at most | reached | |\n|---|---|---|---|---|---|\n",
    );
    for goal in GOALS {
        let _ = writeln!(page, "{}", goal.row(&figures));
    }
    for (part, outcome) in outcomes {
        let _ = write!(page, "\n## {}\n\n    {}\n", part.title, outcome.command);
        if let Some(plot) = part.plot {
            let _ = write!(page, "\n![{}](performance/{plot})\n", part.title);
        }
        let _ = write!(page, "\n```text\n{}\n```\n", outcome.table.trim_end());
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_before_the_table_is_left_out() {
        assert_eq!(table_in("objects: run 1 of 1 done\nobjects\n  case\n", "objects"), "objects\n  case\n");
    }

    #[test]
    fn the_page_tells_machine_goals_and_tables() {
        let line = r#"{"bench":"signal_slot","case":"direct/none","metric":"ns_per_call","value":0.5,"unit":"ns","peer":null}"#;
        let outcome = Outcome {
            command: "cargo bench".into(),
            table: "signal_slot\n  case\n".into(),
            figures: Figure::read(line).into_iter().collect(),
        };
        let part = Part { title: "Signals", bench: "signal_slot", arguments: vec![], plot: Some("a.svg") };
        let page = page(&[("kernel", "Linux".into()), ("Qt", String::new())], &[(part, outcome)]);
        assert!(page.contains("| kernel | Linux |") && !page.contains("| Qt |"), "{page}");
        assert!(
            page.contains("| `direct/none` | `ns_per_call` | itself | 1 | 0.500 | reached |"),
            "{page}"
        );
        assert!(
            page.contains("![Signals](performance/a.svg)") && page.contains("```text\nsignal_slot\n"),
            "{page}"
        );
    }
}
