//! What the runs of a bench came to: medians, bounds and ratios, as a table and as JSON.

use crate::Spread;
use std::fmt::Write;

/// One metric of one case by one side, with its value in every run.
#[derive(Clone, Debug)]
pub struct Figure {
    /// What was done.
    pub case: String,
    /// What was measured about it.
    pub metric: String,
    /// In which unit.
    pub unit: String,
    /// By whom; `None` for us.
    pub peer: Option<&'static str>,
    values: Vec<f64>,
}

impl Figure {
    /// The middle value; of an even number of values the mean of the two in the middle.
    pub fn median(&self) -> f64 {
        let mut sorted = self.values.clone();
        sorted.sort_by(f64::total_cmp);
        let half = sorted.len() / 2;
        match sorted.len() {
            0 => 0.0,
            odd if odd % 2 == 1 => sorted[half],
            _ => (sorted[half - 1] + sorted[half]) / 2.0,
        }
    }

    /// The lowest value.
    pub fn min(&self) -> f64 {
        self.values.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The highest value.
    pub fn max(&self) -> f64 {
        self.values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Everything that was measured in one invocation of a bench.
///
/// ```
/// let mut report = sk_benches::Report::new("sums");
/// for (ours, theirs) in [(1.0, 10.0), (3.0, 20.0), (2.0, 30.0)] {
///     report.add("sum", "ns_per_call", "ns", None, ours);
///     report.add("sum", "ns_per_call", "ns", Some("floor"), theirs);
/// }
/// assert!(report.table(&[]).contains("0.100"), "our median over theirs");
/// let first = report.json_lines().lines().next().unwrap().to_owned();
/// assert_eq!(first, r#"{"bench":"sums","case":"sum","metric":"ns_per_call","value":2.0,"unit":"ns","peer":null}"#);
/// ```
pub struct Report {
    bench: &'static str,
    figures: Vec<Figure>,
    spreads: Vec<(String, Option<&'static str>, Spread)>,
    notes: Vec<String>,
    /// Sides that did not end in time, and after how many seconds they were killed.
    timed_out: Vec<(String, u64)>,
}

impl Report {
    /// A report of nothing yet.
    pub fn new(bench: &'static str) -> Report {
        Report { bench, figures: Vec::new(), spreads: Vec::new(), notes: Vec::new(), timed_out: Vec::new() }
    }

    /// The value of one more run.
    pub fn add(&mut self, case: &str, metric: &str, unit: &str, peer: Option<&'static str>, value: f64) {
        let same = |f: &&mut Figure| f.case == case && f.metric == metric && f.peer == peer;
        match self.figures.iter_mut().find(same) {
            Some(figure) => figure.values.push(value),
            None => self.figures.push(Figure {
                case: case.to_owned(),
                metric: metric.to_owned(),
                unit: unit.to_owned(),
                peer,
                values: vec![value],
            }),
        }
    }

    /// The distribution of one more run: its quantiles become metrics, all runs together the histogram.
    pub fn add_spread(&mut self, case: &str, metric: &str, peer: Option<&'static str>, spread: &Spread) {
        let name = |end: &str| if metric.is_empty() { end.to_owned() } else { format!("{metric}_{end}") };
        let ends = [
            ("min", spread.min()),
            ("p50", spread.quantile(0.5)),
            ("p99", spread.quantile(0.99)),
            ("p999", spread.quantile(0.999)),
            ("max", spread.max()),
        ];
        for (end, ns) in ends {
            self.add(case, &name(end), "ns", peer, ns as f64);
        }
        match self.spreads.iter_mut().find(|(c, p, _)| c == case && *p == peer) {
            Some((_, _, all)) => all.add_all(spread),
            None => self.spreads.push((case.to_owned(), peer, spread.clone())),
        }
    }

    /// Something a reader of the table should know; told once.
    pub fn note(&mut self, text: &str) {
        if !self.notes.iter().any(|note| note == text) {
            self.notes.push(text.to_owned());
        }
    }

    /// The side was killed because it hung. It has a line in the table and no more figures from now on.
    pub fn time_out(&mut self, side: &str, part: Option<&str>, limit_s: u64) {
        let side = part.map_or_else(|| side.to_owned(), |part| format!("{side} ({part})"));
        self.timed_out.push((side, limit_s));
    }

    /// All figures, in the order in which they first came.
    pub fn figures(&self) -> &[Figure] {
        &self.figures
    }

    /// All distributions: the case, by whom, and the spans of all runs.
    pub fn spreads(&self) -> &[(String, Option<&'static str>, Spread)] {
        &self.spreads
    }

    fn find(&self, case: &str, metric: &str, peer: Option<&str>) -> Option<&Figure> {
        self.figures
            .iter()
            .find(|f| f.case == case && f.metric == metric && f.peer == peer)
    }

    /// The median of ours divided by that of the peer, where that says something: a deviation that may have
    /// either sign has no ratio.
    fn ratio(&self, figure: &Figure) -> Option<f64> {
        figure.peer?;
        let ours = self.find(&figure.case, &figure.metric, None)?.median();
        let theirs = figure.median();
        (theirs > 0.0 && ours >= 0.0 && figure.metric != "drift").then(|| ours / theirs)
    }

    /// The figures by case and metric, ours first within each.
    fn grouped(&self) -> Vec<&Figure> {
        let mut grouped: Vec<&Figure> = Vec::new();
        for figure in &self.figures {
            let same = |f: &&Figure| f.case == figure.case && f.metric == figure.metric;
            if !grouped.iter().any(same) {
                let mut group: Vec<&Figure> = self.figures.iter().filter(same).collect();
                group.sort_by_key(|figure| figure.peer.is_some());
                grouped.extend(group);
            }
        }
        grouped
    }

    /// The readable table. `growth` names quotients told below it: the metric, one case, the case it is
    /// divided by.
    pub fn table(&self, growth: &[(String, String, String)]) -> String {
        let head = ["case", "metric", "side", "median", "min", "max", "unit", "ours/peer"];
        let mut rows = vec![head.map(str::to_owned)];
        for figure in self.grouped() {
            rows.push([
                figure.case.clone(),
                figure.metric.clone(),
                figure.peer.unwrap_or("ours").to_owned(),
                number(figure.median()),
                number(figure.min()),
                number(figure.max()),
                figure.unit.clone(),
                self.ratio(figure).map(|ratio| format!("{ratio:.3}")).unwrap_or_default(),
            ]);
        }
        let mut text = format!("{}\n", self.bench);
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..head.len()).map(width).collect();
        for row in &rows {
            let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
                if (3..6).contains(&column) { format!("{cell:>width$}") } else { format!("{cell:<width$}") }
            });
            // Writing to a string does not fail.
            let _ = writeln!(text, "  {}", cells.collect::<Vec<_>>().join("  ").trim_end());
        }
        for (metric, of, over) in growth {
            self.tell_growth(&mut text, metric, of, over);
        }
        for (side, limit_s) in &self.timed_out {
            let _ = writeln!(text, "  {side}: timed out after {limit_s} s");
        }
        for note in &self.notes {
            let _ = writeln!(text, "  note: {note}");
        }
        text
    }

    fn tell_growth(&self, text: &mut String, metric: &str, of: &str, over: &str) {
        for figure in self.figures.iter().filter(|f| f.case == of && f.metric == metric) {
            if let Some(base) = self.find(over, metric, figure.peer).filter(|base| base.median() != 0.0) {
                let side = figure.peer.unwrap_or("ours");
                let quotient = figure.median() / base.median();
                let _ = writeln!(text, "  {of} is {quotient:.2} times {over} ({metric}, {side})");
            }
        }
    }

    /// One JSON object a line: `bench`, `case`, `metric`, `value` (the median), `unit`, `peer`.
    pub fn json_lines(&self) -> String {
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        let mut lines = String::new();
        for f in self.grouped() {
            let peer = f.peer.map_or_else(|| "null".to_owned(), quoted);
            let (bench, case, metric) = (quoted(self.bench), quoted(&f.case), quoted(&f.metric));
            let (value, unit) = (serde_json::Value::from(f.median()), quoted(&f.unit));
            let _ = writeln!(
                lines,
                r#"{{"bench":{bench},"case":{case},"metric":{metric},"value":{value},"unit":{unit},"peer":{peer}}}"#
            );
        }
        lines
    }
}

/// A number in as many digits as a reader needs.
fn number(value: f64) -> String {
    match value.abs() {
        large if large >= 1000.0 => format!("{value:.0}"),
        middle if middle >= 10.0 => format!("{value:.1}"),
        _ => format!("{value:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_of_runs_lies_between_the_middle_two() {
        let mut report = Report::new("b");
        for value in [4.0, 1.0, 3.0, 100.0] {
            report.add("c", "m", "ns", None, value);
        }
        let figure = &report.figures()[0];
        assert_eq!((figure.median(), figure.min(), figure.max()), (3.5, 1.0, 100.0));
    }

    #[test]
    fn a_spread_becomes_metrics_with_and_without_a_prefix() {
        let mut spread = Spread::default();
        spread.add(5, 10);
        let mut report = Report::new("b");
        report.add_spread("queued/idle-one-way", "", None, &spread);
        report.add_spread("tick", "wake_error", None, &spread);
        let metrics: Vec<_> = report.figures().iter().map(|f| f.metric.as_str()).collect();
        assert_eq!(metrics[..3], ["min", "p50", "p99"]);
        assert_eq!(
            metrics[5..],
            ["wake_error_min", "wake_error_p50", "wake_error_p99", "wake_error_p999", "wake_error_max"]
        );
    }

    #[test]
    fn growth_is_told_for_every_side_that_has_both_cases() {
        let mut report = Report::new("b");
        for (case, value) in [("n/10", 2.0), ("n/10000", 3.0)] {
            report.add(case, "pulse_ns", "ns", None, value);
        }
        report.add("n/10", "pulse_ns", "ns", Some("qt6"), 1.0);
        let growth = [("pulse_ns".to_owned(), "n/10000".to_owned(), "n/10".to_owned())];
        let table = report.table(&growth);
        assert!(table.contains("n/10000 is 1.50 times n/10 (pulse_ns, ours)"), "{table}");
        assert!(!table.contains("(pulse_ns, qt6)"), "{table}");
    }
}
