//! Tables, and quantities for people.

use std::time::Duration;

/// Lines with aligned columns; one in which nothing stands is left out.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let cell = |row: &[String], column: usize| row.get(column).cloned().unwrap_or_default();
    let shown: Vec<usize> = (0..head.len())
        .filter(|column| *column == 0 || rows.iter().any(|row| !cell(row, *column).is_empty()))
        .collect();
    let head: Vec<String> = head.iter().map(|&name| name.to_owned()).collect();
    let all = || std::iter::once(&head).chain(rows);
    let width = |column: usize| all().map(|row| cell(row, column).chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = shown.iter().map(|column| width(*column)).collect();
    let line = |row: &Vec<String>| {
        let cells = shown.iter().zip(&widths);
        let padded: Vec<String> =
            cells.map(|(column, width)| format!("{:width$}", cell(row, *column))).collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    all().map(line).collect()
}

/// Lines of a name and what it is.
pub fn facts(rows: &[(&str, String)]) -> String {
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    rows.iter().map(|(name, what)| format!("{name:width$}  {what}\n")).collect()
}

/// A span with two digits that matter: `3.2 ms`, `4 min 10 s`.
pub fn span(span: Duration) -> String {
    let (whole, seconds) = (span.as_secs(), span.as_secs_f64());
    match whole {
        86_400.. => format!("{} d {} h", whole / 86_400, whole % 86_400 / 3_600),
        3_600.. => format!("{} h {} min", whole / 3_600, whole % 3_600 / 60),
        60.. => format!("{} min {} s", whole / 60, whole % 60),
        1.. => format!("{seconds:.1} s"),
        0 if seconds >= 0.001 => format!("{:.1} ms", seconds * 1e3),
        0 => format!("{:.0} us", seconds * 1e6),
    }
}

/// Bytes: `312 B`, `1.4 kB`.
pub fn bytes(count: f64) -> String {
    let units = ["B", "kB", "MB", "GB", "TB"];
    let (mut count, mut unit) = (count, 0);
    while count >= 1000.0 && unit + 1 < units.len() {
        count /= 1000.0;
        unit += 1;
    }
    match unit {
        0 => format!("{count:.0} B"),
        _ => format!("{count:.1} {}", units[unit]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_empty_ones_left_out() {
        let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
        let shown = table(&["NAME", "RATE", "WHAT"], &[row(["a", "", "x"]), row(["longer", "", ""])]);
        assert_eq!(shown, "NAME    WHAT\na       x\nlonger\n");
    }

    #[test]
    fn quantities_are_short() {
        let spans = [(0, 40_000), (0, 2_500_000), (3, 0), (250, 0), (7_300, 0), (90_000, 0)];
        let shown = spans.map(|(seconds, nanos)| span(Duration::new(seconds, nanos)));
        assert_eq!(shown, ["40 us", "2.5 ms", "3.0 s", "4 min 10 s", "2 h 1 min", "1 d 1 h"]);
        assert_eq!([312.0, 1_449.0, 2e6, 9e15].map(bytes), ["312 B", "1.4 kB", "2.0 MB", "9000.0 TB"]);
    }
}
