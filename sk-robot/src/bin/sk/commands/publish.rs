//! `sk pub`: publishes on a channel of this visit's own.

use crate::arguments::{Arguments, json};
use crate::output::{print, safe};
use crate::session::{Link, Visit};
use bytes::Bytes;
use clap::Args;
use sk_core::flow::report::ChannelReport;
use sk_core::flow::satellite::ChannelInfo;
use sk_core::prelude::*;
use sk_flat::FromVariant;
use std::io::BufRead;
use std::path::Path;
use std::sync::mpsc::{SyncSender, sync_channel};

/// How long somebody who waits for the channel has to hear of it, unless more is asked for.
const HEARD_WITHIN: Duration = Duration::from_millis(500);
/// How long those who hear have to take the last messages.
const TAKEN_WITHIN: Duration = Duration::from_secs(5);
/// How soon the hub is asked again whether they have.
const LOOK_AGAIN_AFTER: Duration = Duration::from_millis(5);

#[derive(Args, Debug, Clone)]
pub struct Publish {
    /// What the channel is called; the hub sets the account before it
    pub name: String,
    /// JSON; or @FILE for the bytes of a file; or - for a JSON value in each line of standard input
    #[arg(value_parser = source, allow_hyphen_values = true)]
    pub value: Source,
    /// Publish this often a second, again and again
    #[arg(long, value_name = "HZ", value_parser = rate)]
    pub rate: Option<f64>,
    /// End after this many messages [default: 1, with --rate without end]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Wait until somebody listens
    #[arg(long)]
    pub wait: bool,
}

/// What is published.
#[derive(Clone, Debug)]
pub enum Source {
    Value(SkVariant),
    File(Bytes, &'static str),
    Lines,
}

fn source(text: &str) -> Result<Source, String> {
    match text.strip_prefix('@') {
        Some(file) => {
            let bytes = std::fs::read(file).map_err(|error| format!("{file}: {error}"))?;
            Ok(Source::File(bytes.into(), mime(Path::new(file))))
        }
        None if text == "-" => Ok(Source::Lines),
        None => json(text).map(Source::Value),
    }
}

fn mime(file: &Path) -> &'static str {
    match file.extension().and_then(|ending| ending.to_str()) {
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("png") => "image/png",
        Some("txt") => "text/plain",
        Some("json") => "application/json",
        _ => "application/octet-stream",
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let rate: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if (0.001..=10_000.0).contains(&rate) { Ok(rate) } else { Err("0.001 to 10000 is possible".to_owned()) }
}

struct Publisher {
    link: Link,
    task: Publish,
    as_json: bool,
    left: Option<u64>,
    sent: u64,
    unheard: u64,
    /// The full name, once the channel exists.
    full_name: Option<String>,
    /// The next line of standard input; what it goes with is told when it was published, and asks for the next.
    line: Option<(SkVariant, SyncSender<()>)>,
    input_is_over: bool,
    begun: bool,
    pace: Handle<Timer>,
    patience: Handle<Timer>,
    again: Handle<Timer>,
    ending: Option<Instant>,
}

object! {
    Publisher {
        slots {
            on_entered() on_added(&ChannelInfo) on_listened(String) on_pace() on_impatient() on_again()
            on_refused(String)
        }
    }
}

pub fn run(arguments: &Arguments, task: &Publish) -> Result<(), String> {
    let mut visit = Visit::begin(arguments)?;
    let link = visit.link();
    let cx = visit.app.cx();
    let once = if task.rate.is_none() && !matches!(task.value, Source::Lines) { Some(1) } else { None };
    let left = task.count.or(once);
    let (task, as_json) = (task.clone(), arguments.json);
    let publisher = cx.spawn_with(|cx, this: Handle<Publisher>| {
        let [pace, patience, again] = [(); 3].map(|()| cx.under(this).spawn(Timer::default()));
        attach!(cx, pace.timeout => this.on_pace);
        attach!(cx, patience.timeout => this.on_impatient);
        attach!(cx, again.timeout => this.on_again);
        attach!(cx, link.session.entered => this.on_entered, Queued);
        attach!(cx, link.hub.channel_added => this.on_added);
        attach!(cx, link.hub.start_publishing => this.on_listened);
        attach!(cx, link.hub.refused => this.on_refused);
        Publisher {
            link,
            task,
            as_json,
            left,
            sent: 0,
            unheard: 0,
            full_name: None,
            line: None,
            input_is_over: false,
            begun: false,
            pace,
            patience,
            again,
            ending: None,
        }
    });
    let reads = cx.with(publisher, |publisher, _| matches!(publisher.task.value, Source::Lines));
    if reads == Ok(true) {
        read_lines(cx.remote(publisher));
    }
    visit.run()
}

/// Standard input has a thread of its own: reading it waits.
fn read_lines(publisher: Remote<Publisher>) {
    std::thread::spawn(move || {
        for (number, line) in std::io::stdin().lock().lines().enumerate() {
            let value = match line {
                Ok(line) if line.trim().is_empty() => continue,
                Ok(line) => {
                    json(&line).map_err(|error| format!("line {} of standard input: {error}", number + 1))
                }
                Err(error) => Err(format!("standard input: {error}")),
            };
            let failed = value.is_err();
            // One line at a time: who writes faster than is published waits.
            let (published, wait) = sync_channel(1);
            let posted = publisher.post(move |publisher, cx| publisher.take_line(cx, value, published));
            if posted.is_err() || wait.recv().is_err() || failed {
                return;
            }
        }
        // A program that has ended meanwhile needs no end of its input.
        let _ = publisher.post(|publisher, cx| {
            publisher.input_is_over = true;
            publisher.go_on(cx);
        });
    });
}

impl Publisher {
    fn take_line(&mut self, cx: &mut Cx, value: Result<SkVariant, String>, published: SyncSender<()>) {
        match value {
            Err(failure) => self.link.fail(cx, failure),
            Ok(value) => {
                self.line = Some((value, published));
                self.go_on(cx);
            }
        }
    }

    fn on_entered(&mut self, cx: &mut Cx) {
        let properties = match &self.task.value {
            Source::File(_, mime) => SkVariant::map([("format", "bytes".into()), ("mime", (*mime).into())]),
            _ => SkVariant::map([("format", "variant".into())]),
        };
        if let Err(error) = self.link.hub.open(cx, &self.task.name, properties) {
            return self.link.fail(cx, error.to_string());
        }
        let waits_for_all =
            self.task.wait || self.task.rate.is_some() || matches!(self.task.value, Source::Lines);
        // Timers are children of this object, here and below.
        if !waits_for_all {
            let _ = self.patience.start_once(cx, HEARD_WITHIN);
        }
        if let Some(rate) = self.task.rate
            && !self.task.wait
        {
            self.begin(cx, rate);
        }
    }

    fn begin(&mut self, cx: &mut Cx, rate: f64) {
        if !std::mem::replace(&mut self.begun, true) {
            let _ = self.pace.start(cx, Duration::from_secs_f64(1.0 / rate));
        }
    }

    fn on_added(&mut self, cx: &mut Cx, channel: &ChannelInfo) {
        let own = self.link.hub.connection(cx);
        if own == Some(channel.owner) {
            self.full_name = Some(channel.name.clone());
            self.go_on(cx);
        }
    }

    fn on_listened(&mut self, cx: &mut Cx, _name: String) {
        let _ = self.patience.stop(cx);
        match self.task.rate {
            Some(rate) => self.begin(cx, rate),
            None => self.go_on(cx),
        }
    }

    /// Publishes what there is to publish without a pace.
    fn go_on(&mut self, cx: &mut Cx) {
        if self.task.rate.is_some() || self.full_name.is_none() || self.ending.is_some() {
            return;
        }
        let reads = matches!(self.task.value, Source::Lines);
        let listened = self.link.hub.is_listened(cx, &self.task.name);
        // Lines come when they come; a single value is for somebody.
        while self.left != Some(0) && (listened || reads && !self.task.wait) {
            if reads && self.line.is_none() {
                break;
            }
            self.publish(cx);
        }
        let through = reads && self.input_is_over && self.line.is_none();
        if self.left == Some(0) || through {
            self.end(cx);
        }
    }

    fn on_pace(&mut self, cx: &mut Cx) {
        let reads = matches!(self.task.value, Source::Lines);
        if self.full_name.is_none() || self.ending.is_some() {
            return;
        }
        if reads && self.line.is_none() {
            if self.input_is_over {
                self.end(cx);
            }
            return;
        }
        self.publish(cx);
        if self.left == Some(0) {
            self.end(cx);
        }
    }

    fn publish(&mut self, cx: &mut Cx) {
        let name = &self.task.name;
        let sent = match &self.task.value {
            Source::Value(value) => self.link.hub.publish(cx, name, value.clone()),
            Source::File(bytes, _) => self.link.hub.publish_bytes(cx, name, bytes.clone()),
            Source::Lines => {
                let Some((value, published)) = self.line.take() else { return };
                // Whoever reads may have ended.
                let _ = published.send(());
                self.link.hub.publish(cx, name, value)
            }
        };
        if sent {
            self.sent += 1;
        } else {
            self.unheard += 1;
        }
        if let Some(left) = &mut self.left {
            *left -= 1;
        }
    }

    fn on_impatient(&mut self, cx: &mut Cx) {
        let name = self.full_name.clone().unwrap_or_else(|| self.task.name.clone());
        self.link
            .fail(cx, format!("nobody listens to {} (--wait waits for somebody)", safe(&name)));
    }

    fn on_refused(&mut self, cx: &mut Cx, why: String) {
        self.link.fail(cx, format!("the hub refused: {}", safe(&why)));
    }

    // ---- the end: when those who hear have taken the last message ----

    fn end(&mut self, cx: &mut Cx) {
        let _ = self.pace.stop(cx);
        self.ending = Some(cx.now());
        self.on_again(cx);
    }

    fn on_again(&mut self, cx: &mut Cx) {
        let Some(name) = &self.full_name else { return };
        let this = cx.this(self);
        self.link.hub.inspect(cx, &format!("channel {name}"), move |cx, told| {
            let report =
                told.and_then(|told| ChannelReport::from_variant(&told).map_err(|error| error.to_string()));
            // It lives as long as the program.
            let _ = cx.with(this, |publisher, cx| publisher.look(cx, report));
        });
    }

    fn look(&mut self, cx: &mut Cx, report: Result<ChannelReport, String>) {
        let report = match report {
            Ok(report) => report,
            Err(failure) => return self.link.fail(cx, failure),
        };
        let queued: u64 = report.subscribers.iter().map(|one| one.counts.queued).sum();
        let taken = report.published >= self.sent && queued == 0;
        let late = self.ending.is_some_and(|since| cx.now().since(since) > TAKEN_WITHIN);
        if !taken && !late {
            let _ = self.again.start_once(cx, LOOK_AGAIN_AFTER);
            return;
        }
        let told = match self.as_json {
            true => SkVariant::map([
                ("channel", report.name.as_str().into()),
                ("sent", self.sent.into()),
                ("unheard", self.unheard.into()),
                ("listeners", (report.subscribers.len() as u64).into()),
                ("taken", taken.into()),
            ])
            .to_json()
            .map(|json| json + "\n")
            .unwrap_or_default(),
            false => String::new(),
        };
        let printed = print(cx, &told);
        match (taken, printed) {
            (_, Err(failure)) => self.link.fail(cx, failure),
            (false, _) => {
                let failure = format!("those who listen to {} have not taken everything", safe(&report.name));
                self.link.fail(cx, failure);
            }
            (true, Ok(())) if self.sent == 0 => {
                self.link.fail(cx, format!("nobody listened to {}", safe(&report.name)));
            }
            (true, Ok(())) => cx.quit(),
        }
    }
}
