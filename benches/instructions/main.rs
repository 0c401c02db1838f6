//! How many instructions the hot paths take, and the most they may take.
//!
//! `cargo bench -p sk-benches --bench instructions`, with valgrind and `gungraun-runner` installed.
//!
//! Time says little on a shared machine, but instructions can be counted: the same program takes the same number
//! every time. Each function here does its work a thousand times under callgrind; above its limit the run fails.
//! The limits lie a tenth above what was counted when they were written. Who makes a path cheaper lowers its
//! limit; who has a reason to make it dearer raises it and says why.
#![allow(missing_docs, reason = "the macros of gungraun make public items without any")]

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use sk_core::prelude::*;
use std::hint::black_box;

/// How often each function does its work.
const TIMES: usize = 1_000;

#[derive(Default)]
struct Sender {
    number: Signal<i64>,
}
object! { Sender { signals { number(i64) } } }

impl Sender {
    #[inline(never)]
    fn send(&mut self, cx: &mut Cx) {
        for i in 0..TIMES {
            self.number.emit(cx, black_box(i as i64));
        }
    }
}

#[derive(Default)]
struct Receiver {
    sum: i64,
}
impl Receiver {
    fn take(&mut self, _cx: &mut Cx, number: i64) {
        self.sum = self.sum.wrapping_add(number);
    }
}
object! { Receiver { slots { take(i64) } } }

/// A program that is ready to be counted, and whom it is about.
type Ready = (SkApp, Vec<(Handle<Sender>, Handle<Receiver>)>);

/// A loop that pulses when it is told to, with so many senders that have a receiver each.
fn pairs(count: usize) -> Ready {
    let built = SkApp::builder().mode(TimingMode::NoTiming).build();
    let mut app = built.expect("a loop needs a few descriptors");
    let pairs = (0..count)
        .map(|_| (app.cx().spawn(Sender::default()), app.cx().spawn(Receiver::default())))
        .collect();
    // The first round makes what a loop keeps from then on.
    app.pulse();
    app.pulse();
    (app, pairs)
}

/// One sender and so many receivers, linked.
fn linked(slots: usize) -> Ready {
    let (mut app, pairs) = pairs(slots.max(1));
    for (_, receiver) in &pairs[..slots] {
        attach!(app.cx(), pairs[0].0.number => receiver.take);
    }
    app.pulse();
    (app, pairs)
}

/// One sender with a queued link, whose queues have grown to what they need.
fn queued(_: usize) -> Ready {
    let (mut app, pairs) = pairs(1);
    attach!(app.cx(), pairs[0].0.number => pairs[0].1.take, Queued);
    app.pulse();
    send(&mut app, pairs[0].0);
    app.pulse();
    (app, pairs)
}

fn send(app: &mut SkApp, sender: Handle<Sender>) {
    app.cx().with(sender, Sender::send).expect("the sender lives");
}

fn limit(instructions: u64) -> LibraryBenchmarkConfig {
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, instructions)]);
    let mut config = LibraryBenchmarkConfig::default();
    config.tool(callgrind);
    config
}

#[library_benchmark]
#[bench::to_none(args = (0), setup = linked, config = limit(5_700))]
#[bench::to_1(args = (1), setup = linked, config = limit(39_800))]
#[bench::to_100(args = (100), setup = linked, config = limit(2_915_000))]
fn direct_emits((mut app, pairs): Ready) -> Ready {
    send(&mut app, pairs[0].0);
    (app, pairs)
}

#[library_benchmark]
#[bench::in_one_thread(args = (1), setup = queued, config = limit(275_000))]
fn queued_calls((mut app, pairs): Ready) -> Ready {
    send(&mut app, pairs[0].0);
    app.pulse();
    (app, pairs)
}

#[library_benchmark]
#[bench::each_its_own_pair(args = (TIMES), setup = pairs, config = limit(1_617_000))]
fn attach_and_detach((mut app, pairs): Ready) -> Ready {
    for (sender, receiver) in &pairs {
        attach!(app.cx(), sender.number => receiver.take);
    }
    app.pulse();
    for (sender, receiver) in &pairs {
        detach!(app.cx(), sender.number => receiver.take);
    }
    app.pulse();
    (app, pairs)
}

#[library_benchmark]
#[bench::flat(args = (TIMES), setup = pairs, config = limit(590_000))]
fn burials((mut app, pairs): Ready) -> Ready {
    for (sender, _) in &pairs {
        app.cx().destroy_later(*sender);
    }
    app.pulse();
    (app, pairs)
}

#[library_benchmark]
#[bench::of_an_idle_loop(args = (1), setup = pairs, config = limit(711_000))]
fn empty_pulses((mut app, pairs): Ready) -> Ready {
    for _ in 0..TIMES {
        app.pulse();
    }
    (app, pairs)
}

library_benchmark_group!(
    name = hot_paths,
    benchmarks = [direct_emits, queued_calls, attach_and_detach, burials, empty_pulses]
);
main!(library_benchmark_groups = hot_paths);
