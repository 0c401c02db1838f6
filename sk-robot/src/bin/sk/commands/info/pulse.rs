//! What a satellite tells of its own pulse, in its own database.

use crate::output::safe;
use crate::table::span;
use sk_core::prelude::*;

/// The keys of what it tells begin so.
pub const PREFIX: &str = "pulse.";

/// Lines for people: how it waits, how late it was, how long its work took. What it does not tell is left out, as is
/// what cannot be: it says what it likes.
pub fn rows(told: &[(String, SkVariant)]) -> Vec<(&'static str, String)> {
    let of = |key: &str| told.iter().find(|(known, _)| known == key).map(|(_, value)| value);
    let statistics = of("pulse.statistics");
    let interval = of("pulse.interval_ms").and_then(SkVariant::as_f64);
    let mut rows = Vec::new();
    if let Some(interval) = interval.and_then(|ms| quantity(ms / 1000.0)) {
        let mode = of("pulse.mode").and_then(SkVariant::as_str).unwrap_or("unknown");
        let mut text = format!("every {interval}, in the mode {}", safe(mode));
        let count = |key: &str| statistics.and_then(|map| map.get(key)).and_then(SkVariant::as_u64);
        if let (Some(ticks), Some(missed)) = (count("ticks"), count("missed")) {
            text += &format!("; {ticks} ticks, {missed} missed");
        }
        rows.push(("pulse", text));
    }
    for (name, key) in [("late", "wake_error"), ("busy", "job_time")] {
        if let Some(text) = statistics.and_then(|map| figures(map.get(key)?)) {
            rows.push((name, text));
        }
    }
    rows
}

fn figures(told: &SkVariant) -> Option<String> {
    let of = |key: &str| quantity(told.get(key)?.as_f64()?);
    Some(format!("{} usually, {} in one of 100, {} at most", of("p50")?, of("p99")?, of("max")?))
}

fn quantity(seconds: f64) -> Option<String> {
    Duration::try_from_secs_f64(seconds).ok().map(span)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(statistics: SkVariant) -> Vec<(String, SkVariant)> {
        let pairs = [
            ("pulse.interval_ms", 20.0.into()),
            ("pulse.mode", "Coarse".into()),
            ("pulse.statistics", statistics),
        ];
        pairs.map(|(key, value)| (key.to_owned(), value)).to_vec()
    }

    #[test]
    fn what_is_told_is_shown_and_nothing_else() {
        let late = SkVariant::map([("p50", 70e-6.into()), ("p99", 0.0012.into()), ("max", 2.5.into())]);
        let all = SkVariant::map([("ticks", 50.into()), ("missed", 0.into()), ("wake_error", late)]);
        let shown = rows(&told(all));
        assert_eq!(shown[0], ("pulse", "every 20.0 ms, in the mode Coarse; 50 ticks, 0 missed".to_owned()));
        assert_eq!(shown[1], ("late", "70 us usually, 1.2 ms in one of 100, 2.5 s at most".to_owned()));
        assert_eq!(shown.len(), 2);
        assert_eq!(rows(&told(SkVariant::Null)).len(), 1);
        assert_eq!(rows(&[]).len(), 0);
    }

    #[test]
    fn what_cannot_be_is_left_out() {
        let odd = SkVariant::map([("p50", (-1.0).into()), ("p99", f64::NAN.into()), ("max", "x".into())]);
        assert_eq!(rows(&told(SkVariant::map([("wake_error", odd)]))).len(), 1);
        let endless = [("pulse.interval_ms".to_owned(), SkVariant::from(f64::INFINITY))];
        assert_eq!(rows(&endless).len(), 0);
    }
}
