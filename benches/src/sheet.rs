//! The lines in which a side tells what it measured.
//!
//! A line is a word and its columns, separated by tabs:
//!
//! ```text
//! figure  CASE  METRIC  UNIT  VALUE      one number
//! sample  CASE  METRIC  NS    COUNT      a span of a distribution, and how often it came
//! note    TEXT                           something a reader of the table should know
//! ```
//!
//! Anything else is passed over, so that a library may print what it likes.

use std::io::{self, Write};

/// One line of a sheet.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    /// A number.
    Figure {
        /// What was done.
        case: String,
        /// What was measured about it.
        metric: String,
        /// In which unit.
        unit: String,
        /// How much it was.
        value: f64,
    },
    /// One span of a distribution; the metrics made of it begin with `metric`.
    Sample {
        /// What was done.
        case: String,
        /// The beginning of the names of the metrics: `wake_error` for `wake_error_p50`, or nothing.
        metric: String,
        /// The span.
        ns: u64,
        /// How often it came.
        count: u64,
    },
    /// A remark.
    Note(String),
}

impl Line {
    /// Reads one line; `None` if it is no line of a sheet.
    ///
    /// ```
    /// use sk_benches::Line;
    /// let line = Line::read("figure\tdirect/1\tns_per_call\tns\t2.5").unwrap();
    /// assert!(matches!(line, Line::Figure { value: 2.5, .. }));
    /// assert_eq!(Line::read("hello"), None);
    /// ```
    pub fn read(line: &str) -> Option<Line> {
        let columns: Vec<&str> = line.split('\t').collect();
        match columns[..] {
            ["figure", case, metric, unit, value] => Some(Line::Figure {
                case: case.to_owned(),
                metric: metric.to_owned(),
                unit: unit.to_owned(),
                value: value.trim().parse().ok().filter(|value: &f64| value.is_finite())?,
            }),
            ["sample", case, metric, ns, count] => Some(Line::Sample {
                case: case.to_owned(),
                metric: metric.to_owned(),
                ns: ns.parse().ok()?,
                count: count.trim().parse().ok()?,
            }),
            ["note", text] => Some(Line::Note(text.trim().to_owned())),
            _ => None,
        }
    }
}

/// What a side of ours writes its lines with. A reader that went away ends the process quietly, as nobody is
/// left to measure for.
pub struct Sheet {
    to: io::BufWriter<io::Stdout>,
}

impl Sheet {
    /// A sheet on the standard output.
    pub(crate) fn new() -> Sheet {
        Sheet { to: io::BufWriter::new(io::stdout()) }
    }

    /// One number.
    pub fn figure(&mut self, case: &str, metric: &str, unit: &str, value: f64) {
        self.line(format_args!("figure\t{case}\t{metric}\t{unit}\t{value}"));
    }

    /// One span of a distribution.
    pub fn sample(&mut self, case: &str, metric: &str, ns: u64, count: u64) {
        self.line(format_args!("sample\t{case}\t{metric}\t{ns}\t{count}"));
    }

    /// A remark.
    pub fn note(&mut self, text: &str) {
        self.line(format_args!("note\t{}", text.replace(['\t', '\n'], " ")));
    }

    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        if writeln!(self.to, "{line}").is_err() {
            std::process::exit(1);
        }
    }

    pub(crate) fn close(mut self) -> io::Result<()> {
        self.to.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_line_of_a_sheet_is_passed_over() {
        for line in ["", "figure", "figure\ta\tb\tns\tmuch", "figure\ta\tb\tns\tNaN", "sample\ta\tb\t-1\t1"] {
            assert_eq!(Line::read(line), None, "{line:?}");
        }
        assert_eq!(Line::read("note\thello"), Some(Line::Note("hello".into())));
        let sample = Line::Sample { case: "c".into(), metric: String::new(), ns: 12, count: 3 };
        assert_eq!(Line::read("sample\tc\t\t12\t3"), Some(sample));
    }
}
