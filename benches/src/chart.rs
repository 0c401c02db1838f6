//! Distributions drawn: as text for the terminal, as SVG for a page.

use crate::Spread;
use std::fmt::Write;

/// How wide the longest bar of a text histogram is.
const BAR_CHARACTERS_MAX: f64 = 50.0;
/// The plot's size and the room for its scales, in pixels.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 360.0;
const MARGIN: f64 = 50.0;
/// One per side; they start anew when there are more sides.
const COLOURS: [&str; 6] = ["#0b6e99", "#d9480f", "#2b8a3e", "#862e9c", "#868e96", "#c2255c"];

/// A histogram whose classes double in width; each bar is the logarithm of its count, so that rare outliers
/// are seen.
///
/// ```
/// let mut spread = sk_benches::Spread::default();
/// spread.add(3, 100);
/// spread.add(1000, 1);
/// let text = sk_benches::histogram_text("ours", &spread);
/// assert!(text.contains(" 4 ns ") && text.contains(" 1.0 us "), "{text}");
/// ```
pub fn histogram_text(title: &str, spread: &Spread) -> String {
    let classes = classes(spread);
    let most = classes.iter().map(|(_, count)| *count).max().unwrap_or(0);
    let mut text = format!("  {title}, {} spans\n", spread.count());
    for (upper, count) in classes {
        let share = ((count + 1) as f64).ln() / ((most + 1) as f64).ln().max(f64::MIN_POSITIVE);
        let bar = "#".repeat((share * BAR_CHARACTERS_MAX).round() as usize);
        // Writing to a string does not fail.
        let _ = writeln!(text, "    below {:>8} {count:>9} {bar}", span(upper));
    }
    text
}

/// Classes from the shortest to the longest span: the upper bound of each and its count.
fn classes(spread: &Spread) -> Vec<(u64, u64)> {
    let mut classes: Vec<(u64, u64)> = Vec::new();
    for (ns, count) in spread.iter() {
        let upper = (ns + 1).next_power_of_two();
        match classes.last_mut() {
            Some((last, sum)) if *last == upper => *sum += count,
            _ => classes.push((upper, count)),
        }
    }
    classes
}

fn span(ns: u64) -> String {
    match ns {
        0..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{:.1} us", ns as f64 / 1e3),
        _ => format!("{:.1} ms", ns as f64 / 1e6),
    }
}

/// The share of spans that are longer, over the span; both scales are logarithmic. One line a side.
pub fn plot_svg(title: &str, sides: &[(String, &Spread)]) -> String {
    let longest = sides.iter().map(|(_, spread)| spread.max()).max().unwrap_or(1).max(10);
    let decades_x = (longest as f64).log10().ceil();
    let most = sides.iter().map(|(_, spread)| spread.count()).max().unwrap_or(1).max(10);
    let decades_y = (most as f64).log10().ceil();
    let x = |ns: u64| MARGIN + (ns.max(1) as f64).log10() / decades_x * (WIDTH - 2.0 * MARGIN);
    let y = |share: f64| MARGIN - share.max(1e-12).log10() / decades_y * (HEIGHT - 2.0 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n\
         <text x=\"{MARGIN}\" y=\"20\" font-size=\"14\">{}</text>\n",
        escaped(title)
    );
    for decade in 0..=decades_x as u32 {
        let (at, label) = (x(10u64.pow(decade)), span(10u64.pow(decade)));
        let bottom = HEIGHT - MARGIN;
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {MARGIN}V{bottom}\" stroke=\"#dee2e6\"/>\
             <text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
            bottom + 16.0
        );
    }
    for decade in 0..=decades_y as i32 {
        let at = y(10f64.powi(-decade));
        let right = WIDTH - MARGIN;
        let label = format!("{}%", 10f64.powi(2 - decade));
        let _ = writeln!(
            svg,
            "<path d=\"M{MARGIN} {at:.1}H{right}\" stroke=\"#dee2e6\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            MARGIN - 4.0,
            at + 4.0
        );
    }
    for (index, (name, spread)) in sides.iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        let _ = writeln!(
            svg,
            "<path d=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\" text-anchor=\"end\">{}</text>",
            curve(spread, x, y),
            WIDTH - MARGIN - 4.0,
            MARGIN + 16.0 * (index + 1) as f64,
            escaped(name)
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// The path of the share of spans that are at least as long as each.
fn curve(spread: &Spread, x: impl Fn(u64) -> f64, y: impl Fn(f64) -> f64) -> String {
    let mut left = spread.count();
    let mut path = String::new();
    let mut drawn = (f64::NAN, f64::NAN);
    for (ns, count) in spread.iter() {
        let at = (x(ns), y(left as f64 / spread.count() as f64));
        left -= count;
        // Points closer than half a pixel only make the file larger.
        let far = !((at.0 - drawn.0).abs() < 0.5 && (at.1 - drawn.1).abs() < 0.5);
        if far || left == 0 {
            let _ = write!(path, "{}{:.1} {:.1}", if path.is_empty() { 'M' } else { 'L' }, at.0, at.1);
            drawn = at;
        }
    }
    path
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_has_a_curve_and_a_name_for_each_side() {
        let mut spread = Spread::default();
        (1..=1000).for_each(|ns| spread.add(ns * 10, 1));
        let empty = Spread::default();
        let svg = plot_svg("a < b", &[("ours".to_owned(), &spread), ("qt6".to_owned(), &empty)]);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("a &lt; b") && svg.contains(">ours</text>") && svg.contains(">qt6</text>"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
