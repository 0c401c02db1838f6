//! `sk hz`: how often messages come, how regularly, and how many bytes.

use crate::arguments::Arguments;
use crate::names;
use crate::output::{json, print, safe};
use crate::session::{Link, Visit};
use crate::table::{bytes, span};
use clap::Args;
use sk_core::flow::FlowMessage;
use sk_core::prelude::*;
use std::collections::BTreeMap;

/// How often it is told.
const TOLD_EVERY: Duration = Duration::from_secs(1);
/// The deepest queue that a hub keeps, so that what is counted as lost is lost for want of time.
const DEPTH: u16 = 1_024;

#[derive(Args, Debug, Clone)]
pub struct Hz {
    /// The channel, with or without the account
    pub channel: String,
    /// End after this many lines, one a second
    #[arg(short = 'n', long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
}

/// What is known of the intervals between messages (Welford's running mean and deviation).
#[derive(Default)]
struct Intervals {
    count: u64,
    mean: f64,
    squares: f64,
    least: f64,
    most: f64,
}

impl Intervals {
    fn add(&mut self, seconds: f64) {
        self.count += 1;
        let from_mean = seconds - self.mean;
        self.mean += from_mean / self.count as f64;
        self.squares += from_mean * (seconds - self.mean);
        self.least = if self.count == 1 { seconds } else { self.least.min(seconds) };
        self.most = self.most.max(seconds);
    }

    /// The standard deviation: what is called jitter.
    fn deviation(&self) -> f64 {
        if self.count < 2 { 0.0 } else { (self.squares / (self.count - 1) as f64).sqrt() }
    }

    fn rate(&self) -> f64 {
        if self.mean > 0.0 { 1.0 / self.mean } else { 0.0 }
    }
}

struct Meter {
    link: Link,
    as_json: bool,
    left: Option<u64>,
    channel: String,
    intervals: Intervals,
    last: Option<Instant>,
    messages: u64,
    bytes: u64,
    /// In the second that is being measured.
    messages_now: u64,
    bytes_now: u64,
    lost: BTreeMap<String, u64>,
}

object! { Meter { slots { on_message(&FlowMessage) on_dropped(String, String, u64) on_second() } } }

pub fn run(arguments: &Arguments, task: &Hz) -> Result<(), String> {
    let (task, as_json) = (task.clone(), arguments.json);
    Visit::once(arguments, move |cx, link| {
        let channel = match names::channel(&link.hub.channels(cx), &task.channel) {
            Ok(channel) => channel.name,
            Err(failure) => return link.fail(cx, failure),
        };
        if let Err(error) = link.hub.subscribe_to_newest(cx, &channel, DEPTH) {
            return link.fail(cx, error.to_string());
        }
        cx.spawn_with(|cx, this: Handle<Meter>| {
            let second = cx.under(this).spawn(Timer::default());
            attach!(cx, second.timeout => this.on_second);
            attach!(cx, link.hub.message => this.on_message);
            attach!(cx, link.hub.dropped => this.on_dropped);
            // It was made just now.
            let _ = second.start(cx, TOLD_EVERY);
            Meter {
                link,
                as_json,
                left: task.count,
                channel,
                intervals: Intervals::default(),
                last: None,
                messages: 0,
                bytes: 0,
                messages_now: 0,
                bytes_now: 0,
                lost: BTreeMap::new(),
            }
        });
    })
}

impl Meter {
    fn on_message(&mut self, cx: &mut Cx, message: &FlowMessage) {
        // The clock is read: several messages of one round came at several times.
        let now = cx.clock_now();
        let length = message.payload().len() as u64;
        if let Some(last) = self.last.replace(now) {
            self.intervals.add(now.since(last).as_secs_f64());
        }
        (self.messages, self.bytes) = (self.messages + 1, self.bytes + length);
        (self.messages_now, self.bytes_now) = (self.messages_now + 1, self.bytes_now + length);
    }

    fn on_dropped(&mut self, _cx: &mut Cx, channel: String, reason: String, total: u64) {
        if channel == self.channel {
            self.lost.insert(reason, total);
        }
    }

    fn on_second(&mut self, cx: &mut Cx) {
        let line = self.line();
        (self.messages_now, self.bytes_now) = (0, 0);
        if let Err(failure) = line.and_then(|line| print(cx, &line)) {
            return self.link.fail(cx, failure);
        }
        if let Some(left) = &mut self.left {
            *left -= 1;
            if *left == 0 {
                cx.quit();
            }
        }
    }

    fn line(&self) -> Result<String, String> {
        let intervals = &self.intervals;
        let lost: u64 = self.lost.values().sum();
        let mean_bytes = self.bytes as f64 / self.messages.max(1) as f64;
        if self.as_json {
            return json(&SkVariant::map([
                ("channel", self.channel.as_str().into()),
                ("hz", intervals.rate().into()),
                ("hz_now", (self.messages_now as f64 / TOLD_EVERY.as_secs_f64()).into()),
                ("interval_mean_s", intervals.mean.into()),
                ("interval_min_s", intervals.least.into()),
                ("interval_max_s", intervals.most.into()),
                ("jitter_s", intervals.deviation().into()),
                ("bytes_per_s", (self.bytes_now as f64 / TOLD_EVERY.as_secs_f64()).into()),
                ("bytes_per_message", mean_bytes.into()),
                ("messages", self.messages.into()),
                ("lost", lost.into()),
            ]));
        }
        if self.messages == 0 {
            return Ok(format!("{}: nothing yet\n", safe(&self.channel)));
        }
        let seconds = |seconds: f64| span(Duration::from_secs_f64(seconds));
        let lost: Vec<String> = self
            .lost
            .iter()
            .map(|(reason, count)| format!("{count} ({})", safe(reason)))
            .collect();
        let lost = if lost.is_empty() { "0".to_owned() } else { lost.join(", ") };
        Ok(format!(
            "{:.2} Hz ({} in the last second)  jitter {}  interval {} … {}  {}/s  {}/message  lost {lost}\n",
            intervals.rate(),
            self.messages_now,
            seconds(intervals.deviation()),
            seconds(intervals.least),
            seconds(intervals.most),
            bytes(self.bytes_now as f64),
            bytes(mean_bytes),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_deviation_are_those_of_all_intervals() {
        let mut intervals = Intervals::default();
        for seconds in [0.1, 0.2, 0.3] {
            intervals.add(seconds);
        }
        assert!((intervals.mean - 0.2).abs() < 1e-12 && (intervals.rate() - 5.0).abs() < 1e-9);
        assert!((intervals.deviation() - 0.1).abs() < 1e-12);
        assert_eq!((intervals.least, intervals.most), (0.1, 0.3));
    }
}
