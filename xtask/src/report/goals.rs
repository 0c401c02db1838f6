//! The goals of the benches, and which figures decide each.

/// What is compared.
#[derive(Clone, Copy)]
pub(super) enum Against {
    /// The same figure of a peer.
    Peer(&'static str),
    /// The same metric of ours in another case.
    Case(&'static str),
    /// Nothing: the figure itself has a limit.
    Itself,
    /// Nothing: that there is a figure says that it was done at all.
    Done,
}

/// A goal: our figure, or its quotient, is at most `limit`.
pub(super) struct Goal {
    pub(super) bench: &'static str,
    pub(super) case: &'static str,
    pub(super) metric: &'static str,
    pub(super) against: Against,
    pub(super) limit: f64,
}

const fn goal(
    bench: &'static str,
    case: &'static str,
    metric: &'static str,
    against: Against,
    limit: f64,
) -> Goal {
    Goal { bench, case, metric, against, limit }
}

use Against::{Case, Done, Itself, Peer};

const TICK: &str = "tick_jitter";
const CALL: &str = "signal_slot";
const LOOP: &str = "loop_scale";
const LIFE: &str = "objects";

/// How much dearer each of 1,000,000 children may be than each of 10,000 and their burial still be linear. If it
/// were quadratic it would be a hundred times; memory that no cache holds costs a few times.
const LINEAR: f64 = 10.0;

/// All of them, in the order in which the page tells them.
pub(super) const GOALS: &[Goal] = &[
    goal(TICK, "realtime/1000us/fifo/idle", "wake_error_p50", Peer("cyclictest"), 0.01),
    goal(TICK, "realtime/1000us/fifo/idle", "wake_error_p99", Peer("cyclictest"), 0.1),
    goal(TICK, "realtime/1000us/fifo/idle", "wake_error_p999", Peer("cyclictest"), 1.0),
    goal(TICK, "realtime/1000us/fifo/idle", "drift", Itself, 20.0),
    goal(TICK, "realtime/1000us/fifo/idle", "cpu", Itself, 8.0),
    goal(TICK, "realtime/1000us/fifo/load", "wake_error_p50", Peer("cyclictest"), 0.01),
    goal(TICK, "realtime/1000us/fifo/load", "wake_error_p99", Peer("cyclictest"), 0.5),
    goal(TICK, "realtime/1000us/fifo/load", "wake_error_p999", Peer("cyclictest"), 1.0),
    goal(TICK, "realtime/1000us/fifo/load", "drift", Itself, 20.0),
    goal(TICK, "realtime/1000us/fifo/load", "cpu", Itself, 8.0),
    goal(TICK, "realtime/100us/fifo/idle", "wake_error_p50", Peer("cyclictest"), 0.05),
    goal(TICK, "realtime/100us/fifo/idle", "cpu", Itself, 60.0),
    goal(TICK, "realtime/1000us/other/idle", "wake_error_p50", Peer("absolute-sleep"), 0.05),
    goal(CALL, "direct/1", "ns_per_call", Peer("qt6"), 0.12),
    goal(CALL, "direct/100", "ns_per_call", Peer("sigc++"), 1.25),
    goal(CALL, "direct/1", "ns_per_call", Peer("floor"), 1.5),
    goal(CALL, "direct/100", "ns_per_call", Peer("floor"), 1.5),
    goal(CALL, "direct/none", "ns_per_call", Itself, 1.0),
    goal(CALL, "queued/same-thread", "ns_per_call", Peer("qt6"), 0.05),
    goal(CALL, "queued/same-thread", "allocations", Itself, 0.0),
    goal(CALL, "queued/cross-thread", "ns_per_call", Peer("qt6"), 0.05),
    goal(CALL, "queued/idle-one-way", "p50", Peer("eventfd"), 1.1),
    goal(CALL, "queued/to-spinning", "send_ns", Itself, 100.0),
    goal(LOOP, "loop/empty", "pulse_ns", Itself, 100.0),
    goal(LOOP, "loop/sockets/10000", "pulse_ns", Case("loop/sockets/10"), 1.1),
    goal(LOOP, "loop/timers/10000", "pulse_ns", Case("loop/timers/10"), 1.1),
    goal(LOOP, "loop/objects/10000", "pulse_ns", Case("loop/objects/10"), 1.1),
    goal(LIFE, "objects/flat", "bury_ns", Peer("qt6"), 0.12),
    goal(LIFE, "objects/flat", "bytes", Peer("qt6"), 0.75),
    goal(LIFE, "objects/connected", "bytes", Peer("qt6"), 0.4),
    goal(LIFE, "objects/chain/1000000", "bury_ns", Done, f64::INFINITY),
    goal(
        LIFE,
        "objects/bury-order/random/1000000",
        "bury_ns",
        Case("objects/bury-order/random/10000"),
        LINEAR,
    ),
    goal("build_time", "build/100x300", "seconds", Itself, 8.0),
];

/// One line of a bench's JSON.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Figure {
    pub(super) bench: String,
    pub(super) case: String,
    pub(super) metric: String,
    pub(super) value: f64,
    pub(super) peer: Option<String>,
}

impl Figure {
    /// Reads a line; `None` if it is no figure.
    pub(super) fn read(line: &str) -> Option<Figure> {
        let line: serde_json::Value = serde_json::from_str(line).ok()?;
        let text = |field: &str| line[field].as_str().map(str::to_owned);
        Some(Figure {
            bench: text("bench")?,
            case: text("case")?,
            metric: text("metric")?,
            value: line["value"].as_f64()?,
            peer: text("peer"),
        })
    }
}

impl Goal {
    /// What was reached; `None` if a figure is missing. A deviation counts by its size.
    pub(super) fn reached(&self, figures: &[Figure]) -> Option<f64> {
        let find = |case: &str, peer: Option<&str>| {
            let same = |f: &&Figure| {
                f.bench == self.bench
                    && f.case == case
                    && f.metric == self.metric
                    && f.peer.as_deref() == peer
            };
            figures.iter().find(same).map(|figure| figure.value.abs())
        };
        let ours = find(self.case, None)?;
        let base = match self.against {
            Peer(peer) => find(self.case, Some(peer))?,
            Case(case) => find(case, None)?,
            Itself | Done => return Some(ours),
        };
        (base > 0.0).then(|| ours / base)
    }

    /// The goal's line in the table of the page.
    pub(super) fn row(&self, figures: &[Figure]) -> String {
        let against = match self.against {
            Peer(peer) => format!("ours / {peer}"),
            Case(case) => format!("over `{case}`"),
            Itself => "itself".to_owned(),
            Done => "that it is done".to_owned(),
        };
        let (reached, verdict) = match self.reached(figures) {
            Some(value) if value <= self.limit => (format!("{value:.3}"), "reached"),
            Some(value) => (format!("{value:.3}"), "**missed**"),
            None => ("not measured".to_owned(), ""),
        };
        let Goal { case, metric, .. } = self;
        let limit = if self.limit.is_finite() { self.limit.to_string() } else { "any".to_owned() };
        format!("| `{case}` | `{metric}` | {against} | {limit} | {reached} | {verdict} |")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(case: &str, value: f64, peer: Option<&str>) -> Figure {
        let line = serde_json::json!({
            "bench": "b", "case": case, "metric": "m", "value": value, "unit": "ns", "peer": peer,
        });
        Figure::read(&line.to_string()).unwrap()
    }

    #[test]
    fn a_goal_is_decided_by_the_quotient_that_it_names() {
        let figures = [figure("c", 3.0, None), figure("c", 10.0, Some("qt6")), figure("d", -6.0, None)];
        assert_eq!(goal("b", "c", "m", Peer("qt6"), 1.0).reached(&figures), Some(0.3));
        assert_eq!(goal("b", "d", "m", Case("c"), 1.0).reached(&figures), Some(2.0));
        assert_eq!(goal("b", "d", "m", Itself, 1.0).reached(&figures), Some(6.0));
        assert_eq!(goal("b", "c", "m", Peer("tokio"), 1.0).reached(&figures), None);
    }

    #[test]
    fn a_missed_goal_says_so() {
        let figures = [figure("c", 3.0, None)];
        assert!(
            goal("b", "c", "m", Itself, 2.0)
                .row(&figures)
                .ends_with("| 2 | 3.000 | **missed** |")
        );
        assert!(goal("b", "x", "m", Itself, 2.0).row(&figures).ends_with("| not measured |  |"));
    }

    #[test]
    fn what_only_has_to_be_done_is_reached_by_any_figure() {
        let done = |case| goal("b", case, "m", Done, f64::INFINITY).row(&[figure("c", 3.0, None)]);
        assert!(done("c").ends_with("| that it is done | any | 3.000 | reached |"), "{}", done("c"));
        assert!(done("x").ends_with("| not measured |  |"), "{}", done("x"));
    }
}
