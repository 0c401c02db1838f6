//! `cargo xtask bench-report`: runs every bench and writes `docs/performance.md` from what came out.
//!
//! The page says on what was measured and how, tells every goal beside the figure reached, and holds the
//! tables of all benches and the plots of the ticks.

mod goals;
mod kept;

use crate::process::{self, Failure};
use crate::workspace::Workspace;
use goals::{Figure, GOALS};
use kept::Kept;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// How the report is made. As it stands it takes some 25 minutes on a quiet machine.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// How often every side of every bench is run.
    #[arg(long, default_value_t = 5, value_name = "N")]
    runs: usize,
    /// How long each side ticks in each run where the 99.9th percentile decides: with five runs of a tick of
    /// 1 ms, 100,000 cycles. The other ticks take a fifth of it.
    #[arg(long, default_value_t = 20.0, value_name = "S")]
    seconds: f64,
    /// Three runs of 3 s instead, for a first look: some minutes.
    #[arg(long, conflicts_with_all = ["runs", "seconds"])]
    quick: bool,
    /// Measure only this anew and take the rest as it was measured last on this machine: the name of a bench, or
    /// of a plot of `tick_jitter`. Can be given several times.
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
}

impl Options {
    fn wants(&self, part: &Part) -> bool {
        self.only.is_empty() || self.only.iter().any(|name| part.is_called(name))
    }

    fn runs(&self) -> usize {
        if self.quick { QUICK_RUNS } else { self.runs.max(1) }
    }

    fn seconds(&self) -> f64 {
        if self.quick { QUICK_SECONDS } else { self.seconds }
    }
}

const QUICK_RUNS: usize = 3;
const QUICK_SECONDS: f64 = 3.0;
/// The share of `--seconds` for which those ticks last that have no figure in the tail to be judged.
const SHORT_SHARE: f64 = 0.2;

/// One invocation of a bench.
struct Part {
    title: &'static str,
    bench: &'static str,
    arguments: Vec<String>,
    /// The name of the plot, below the page's folder.
    plot: Option<&'static str>,
    /// How many cycles each side ticks, all runs together.
    cycles: Option<u64>,
}

impl Part {
    /// Tells it apart from all others.
    fn key(&self) -> &'static str {
        self.plot.map_or(self.bench, |plot| plot.trim_end_matches(".svg"))
    }

    fn is_called(&self, name: &str) -> bool {
        name == self.bench || name == self.key()
    }
}

/// What it came to.
struct Outcome {
    command: String,
    /// When, and at which commit.
    measured: String,
    cycles: Option<u64>,
    /// What else kept the machine busy: its load average before.
    load_before: String,
    table: String,
    figures: Vec<Figure>,
    /// The figures as the bench wrote them.
    lines: String,
}

/// The page, and the folder of its plots.
const PAGE: &str = "docs/performance.md";
const PLOTS: &str = "docs/performance";

/// The two parts whose tails are judged come first: where a later one has a figure of the same name, theirs
/// decides.
fn parts(options: &Options) -> Vec<Part> {
    let tick = |title, plot: &'static str, interval_us: u64, seconds: f64, words: &[&str]| {
        let numbers = [("--interval-us", interval_us.to_string()), ("--seconds", seconds.to_string())];
        let numbers = numbers.into_iter().flat_map(|(option, number)| [option.to_owned(), number]);
        let arguments = words.iter().map(|&word| word.to_owned()).chain(numbers).collect();
        let each = (seconds * 1e6 / interval_us as f64) as u64;
        let cycles = Some(each * options.runs() as u64);
        Part { title, bench: "tick_jitter", arguments, plot: Some(plot), cycles }
    };
    let plain = |title, bench| Part { title, bench, arguments: Vec::new(), plot: None, cycles: None };
    let (long, short) = (options.seconds(), options.seconds() * SHORT_SHARE);
    let two = ["--only", "ours", "--only", "cyclictest"];
    let two_loaded = ["--load", "--only", "ours", "--only", "cyclictest"];
    vec![
        tick("Tick of 1 ms, real-time class, idle", "tick-1000us-fifo-idle.svg", 1_000, long, &two),
        tick(
            "Tick of 1 ms, real-time class, under load",
            "tick-1000us-fifo-load.svg",
            1_000,
            long,
            &two_loaded,
        ),
        tick("The same beside all peers, idle", "tick-1000us-fifo-idle-all.svg", 1_000, short, &[]),
        tick(
            "The same beside all peers, under load",
            "tick-1000us-fifo-load-all.svg",
            1_000,
            short,
            &["--load"],
        ),
        tick("Tick of 100 us, real-time class, idle", "tick-100us-fifo-idle.svg", 100, short, &[]),
        tick(
            "Tick of 1 ms without privilege, idle",
            "tick-1000us-other-idle.svg",
            1_000,
            short,
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
    let kept = Kept::below(&workspace.target)?;
    let parts = parts(options);
    if let Some(name) = options.only.iter().find(|name| !parts.iter().any(|part| part.is_called(name))) {
        let known: Vec<_> = parts.iter().map(Part::key).collect();
        return Err(Failure::Other(format!("nothing is called {name}; there are {}", known.join(", "))));
    }
    let mut outcomes = Vec::new();
    for part in parts {
        let outcome = if options.wants(&part) {
            println!("== {}", part.title);
            let outcome = measure(&part, options)?;
            kept.write(part.key(), &outcome)?;
            outcome
        } else {
            kept.read(part.key()).ok_or_else(|| {
                Failure::Other(format!("{} was not measured here yet: leave out --only", part.key()))
            })?
        };
        outcomes.push((part, outcome));
    }
    let page = page(&machine(), &outcomes, &profiles()?);
    std::fs::write(PAGE, page).map_err(|error| Failure::file(Path::new(PAGE), error))?;
    println!("written: {PAGE}");
    Ok(())
}

/// Pages beside this one that show where the time goes, by name.
fn profiles() -> Result<Vec<String>, Failure> {
    let folder = Path::new(PLOTS);
    let entries = std::fs::read_dir(folder).map_err(|error| Failure::file(folder, error))?;
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut names: Vec<String> = names
        .filter(|name| name.starts_with("profiles") && name.ends_with(".md"))
        .collect();
    names.sort_unstable();
    Ok(names)
}

fn measure(part: &Part, options: &Options) -> Result<Outcome, Failure> {
    let load_before = load_average();
    let mut command = process::cargo();
    command.args(["bench", "--quiet", "--package", "sk-benches", "--bench", part.bench, "--"]);
    command.args(&part.arguments).args(["--runs", &options.runs().to_string()]);
    let spelled = process::spelled(&command);
    if let Some(plot) = part.plot {
        // Cargo starts a bench in the folder of its package.
        command.arg("--plot").arg(Path::new("..").join(PLOTS).join(plot));
    }
    let (lines, said) = process::read_both(command.arg("--json"))?;
    let table = table_in(&said, part.bench);
    print!("{table}");
    let measured = format!("{} at {}", now(), commit());
    let figures = lines.lines().filter_map(Figure::read).collect();
    Ok(Outcome { command: spelled, measured, cycles: part.cycles, load_before, table, figures, lines })
}

/// Over one, five and fifteen minutes.
fn load_average() -> String {
    let said = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    said.split(' ').take(3).collect::<Vec<_>>().join(" ")
}

/// The table begins with the name of the bench; before it stand progress and what peers complained of.
fn table_in(said: &str, bench: &str) -> String {
    let lines: Vec<&str> = said.lines().skip_while(|line| *line != bench).collect();
    lines.join("\n") + "\n"
}

/// The first line of what a program says; nothing if it cannot be asked.
fn said(program: &str, words: &[&str]) -> String {
    let answer = process::read(Command::new(program).args(words)).unwrap_or_default();
    answer.lines().next().unwrap_or_default().trim().to_owned()
}

fn now() -> String {
    said("date", &["-u", "+%Y-%m-%d %H:%M UTC"])
}

fn commit() -> String {
    said("git", &["rev-parse", "--short", "HEAD"])
}

/// On what was measured: one line each.
fn machine() -> Vec<(&'static str, String)> {
    let file = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let cpu = file("/proc/cpuinfo");
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split(": ").nth(1));
    let cpus = std::thread::available_parallelism().map_or(0, usize::from);
    let virtual_machine = cpu
        .lines()
        .any(|line| line.starts_with("flags") && line.contains(" hypervisor"));
    vec![
        ("date", now()),
        ("commit", commit()),
        ("processor", format!("{}, {cpus} CPUs", model.unwrap_or("unknown"))),
        ("virtual machine", if virtual_machine { "yes" } else { "no" }.to_owned()),
        ("kernel", said("uname", &["-sr"])),
        ("load average at the end", load_average()),
        ("Rust", said("rustc", &["--version"])),
        ("C++", said("g++", &["--version"])),
        ("Qt", said("pkg-config", &["--modversion", "Qt6Core"])),
        ("libsigc++", said("pkg-config", &["--modversion", "sigc++-2.0"])),
        ("Boost", said("dpkg-query", &["--show", "--showformat=${Version}", "libboost-dev"])),
        ("rt-tests", said("dpkg-query", &["--show", "--showformat=${Version}", "rt-tests"])),
    ]
}

fn page(machine: &[(&'static str, String)], outcomes: &[(Part, Outcome)], profiles: &[String]) -> String {
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
    if !profiles.is_empty() {
        let links: Vec<_> = profiles.iter().map(|name| format!("[{name}](performance/{name})")).collect();
        let _ = writeln!(
            page,
            "\nWhere the time goes, and what stands in the way where a goal is missed: {}.",
            links.join(", ")
        );
    }
    for (part, outcome) in outcomes {
        let _ = write!(page, "\n## {}\n\n    {}\n", part.title, outcome.command);
        let _ = write!(page, "\nMeasured {}.", outcome.measured);
        if !outcome.load_before.is_empty() {
            let _ = write!(page, " Load average as it began: {}.", outcome.load_before);
        }
        page.push('\n');
        if let Some(cycles) = outcome.cycles {
            let _ = write!(page, "\nCycles of each side, all runs together: {cycles}.\n");
        }
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
    fn five_runs_of_the_judged_ticks_are_100_000_cycles() {
        let options = |quick| Options { runs: 5, seconds: 20.0, quick, only: Vec::new() };
        let cycles = |quick| parts(&options(quick)).iter().map(|part| part.cycles).collect::<Vec<_>>();
        assert_eq!(cycles(false)[..2], [Some(100_000); 2]);
        assert_eq!(cycles(true)[..2], [Some(9_000); 2]);
        assert_eq!(cycles(false)[6..], [None; 4]);
    }

    #[test]
    fn the_page_tells_machine_goals_and_tables() {
        let line = r#"{"bench":"signal_slot","case":"direct/none","metric":"ns_per_call","value":0.5,"unit":"ns","peer":null}"#;
        let outcome = Outcome {
            command: "cargo bench".into(),
            measured: "2026-01-01 12:00 UTC at abc".into(),
            cycles: Some(100_000),
            load_before: "3.00 2.00 1.00".into(),
            table: "signal_slot\n  case\n".into(),
            figures: Figure::read(line).into_iter().collect(),
            lines: line.into(),
        };
        let plot = Some("a.svg");
        let part =
            Part { title: "Signals", bench: "signal_slot", arguments: vec![], plot, cycles: Some(100_000) };
        let machine = [("kernel", "Linux".into()), ("Qt", String::new())];
        let page = page(&machine, &[(part, outcome)], &["profiles-a.md".to_owned()]);
        assert!(page.contains("[profiles-a.md](performance/profiles-a.md)."), "{page}");
        assert!(page.contains("all runs together: 100000."), "{page}");
        let measured = "\nMeasured 2026-01-01 12:00 UTC at abc. Load average as it began: 3.00 2.00 1.00.\n";
        assert!(page.contains(measured), "{page}");
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
