//! Two lines joined by wires that lose, change, repeat and invent bytes.

use super::*;
use crate::world::{Rng, SimulatedRng};
use proptest::prelude::*;
use sk_flat::Instant;
use std::collections::VecDeque;
use std::time::Duration;

const BAUD: u32 = 115_200;
const STEP: Duration = Duration::from_millis(1);

/// What one direction does to each byte, in ten-thousandths.
#[derive(Clone, Copy, Debug, Default)]
struct Noise {
    changed: u64,
    lost: u64,
    invented: u64,
    /// Of each piece of up to 100 bytes.
    repeated: u64,
}

struct Bench {
    caller: Line,
    listener: Line,
    noise: Noise,
    rng: SimulatedRng,
    now: Instant,
    events: [Vec<LineEvent>; 2],
}

impl Bench {
    fn new(seed: u64, noise: Noise) -> Bench {
        let mut rng = SimulatedRng::new(seed, 0);
        let now = Instant::ZERO;
        Bench {
            caller: Line::new(Role::Caller, rng.next_u64(), BAUD, now),
            listener: Line::new(Role::Listener, rng.next_u64(), BAUD, now),
            noise,
            rng,
            now,
            events: [Vec::new(), Vec::new()],
        }
    }

    /// A millisecond: what the speed allows goes over in both directions.
    fn step(&mut self) {
        self.now += STEP;
        let bytes_max = BAUD as usize / 10_000;
        for towards_listener in [true, false] {
            let (from, to) = if towards_listener {
                (&mut self.caller, &mut self.listener)
            } else {
                (&mut self.listener, &mut self.caller)
            };
            from.tick(self.now);
            let ready = from.output(self.now);
            let sent = ready[..ready.len().min(bytes_max)].to_vec();
            from.wrote(sent.len());
            let arrived = spoil(&sent, self.noise, &mut self.rng);
            to.receive(&arrived, self.now);
        }
        for (line, events) in [&mut self.caller, &mut self.listener].into_iter().zip(&mut self.events) {
            events.extend(std::iter::from_fn(|| line.next_event()));
        }
    }

    fn until(&mut self, steps_max: usize, mut done: impl FnMut(&mut Bench) -> bool) -> bool {
        (0..steps_max).any(|_| {
            self.step();
            done(self)
        })
    }

    fn up(&mut self) {
        assert!(
            self.until(20_000, |bench| bench.caller.is_up() && bench.listener.is_up()),
            "the line is up"
        );
    }

    /// A stream with both of its ends.
    fn stream(&mut self) -> (StreamId, StreamId) {
        let near = self.caller.open().expect("a number is free");
        let opened = LineEvent::Opened(near.number);
        assert!(self.until(20_000, |bench| bench.events[1].contains(&opened)), "the stream is opened");
        self.events[1].clear();
        (near, self.listener.opened(near.number).expect("it was just opened"))
    }
}

fn spoil(bytes: &[u8], noise: Noise, rng: &mut SimulatedRng) -> Vec<u8> {
    let mut arrived = Vec::new();
    for byte in bytes {
        if rng.below(10_000) < noise.invented {
            arrived.push(rng.next_u64() as u8);
        }
        if rng.below(10_000) < noise.lost {
            continue;
        }
        let changed = rng.below(10_000) < noise.changed;
        arrived.push(if changed { byte ^ (1 << rng.below(8)) } else { *byte });
    }
    if rng.below(10_000) < noise.repeated {
        arrived.extend_from_within(..);
    }
    arrived
}

fn pattern(salt: u8, length: usize) -> Vec<u8> {
    (0..length)
        .map(|index| (index as u8).wrapping_mul(31).wrapping_add(salt))
        .collect()
}

/// One direction of one stream.
struct Passage {
    id: StreamId,
    other: StreamId,
    to_listener: bool,
    bytes: Vec<u8>,
    sent: usize,
    came: Vec<u8>,
}

impl Passage {
    fn go_on(&mut self, bench: &mut Bench) {
        let (from, to) = match self.to_listener {
            true => (&mut bench.caller, &mut bench.listener),
            false => (&mut bench.listener, &mut bench.caller),
        };
        if let Ok(count) = from.write(self.id, &self.bytes[self.sent..]) {
            self.sent += count;
        }
        let mut room = [0; 300];
        if let Ok(count) = to.read(self.other, &mut room) {
            self.came.extend_from_slice(&room[..count]);
        }
        assert!(self.bytes.starts_with(&self.came), "nothing is changed, lost or repeated on the way");
    }
}

fn passages(bench: &mut Bench, lengths: &[usize]) -> Vec<Passage> {
    let mut all = Vec::new();
    for (salt, length) in lengths.iter().enumerate() {
        let (near, far) = bench.stream();
        for to_listener in [true, false] {
            let (id, other) = if to_listener { (near, far) } else { (far, near) };
            let bytes = pattern(salt as u8 * 2 + u8::from(to_listener), *length);
            all.push(Passage { id, other, to_listener, bytes, sent: 0, came: Vec::new() });
        }
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn t24_every_stream_passes_intact_over_a_line_with_noise(
        seed in any::<u64>(),
        lengths in prop::collection::vec(0_usize..6000, 1..5),
        changed in 0_u64..10, lost in 0_u64..10, invented in 0_u64..10, repeated in 0_u64..2000,
    ) {
        let mut bench = Bench::new(seed, Noise::default());
        bench.up();
        let mut all = passages(&mut bench, &lengths);
        bench.noise = Noise { changed, lost, invented, repeated };
        // Enough time for all of it ten times over.
        let done = bench.until(120_000, |bench| {
            all.iter_mut().for_each(|one| one.go_on(bench));
            !bench.caller.is_up() || all.iter().all(|one| one.came == one.bytes)
        });
        prop_assert!(done, "it goes on or gives up");
        // Three seconds of bad luck in a row bring a line down; what came until then was right. It comes back.
        bench.noise = Noise::default();
        bench.up();
        bench.stream();
    }

    #[test]
    fn whatever_comes_from_a_line_nothing_panics_and_a_call_is_answered_after_it(
        noise in prop::collection::vec(any::<u8>(), 0..3000), as_envelopes: bool, seed in any::<u64>(),
    ) {
        let mut bench = Bench::new(seed, Noise::default());
        bench.up();
        bench.stream();
        let mut bytes = Vec::new();
        for piece in noise.chunks(40) {
            match piece {
                [kind, stream, number, ack, payload @ ..] if as_envelopes => {
                    let mut envelope = vec![((kind % 10) << 4) | (stream % 16), number % 4, ack % 4];
                    envelope.extend_from_slice(payload);
                    envelope.extend(crc32fast::hash(&envelope).to_le_bytes());
                    slip_encode(&envelope, &mut bytes);
                }
                piece => bytes.extend_from_slice(piece),
            }
        }
        bench.listener.receive(&bytes, bench.now);
        bench.caller.receive(&bytes, bench.now);
        prop_assert!(bench.listener.output(bench.now).len() < 16 * 1024);
        bench.until(4_000, |_| false);
        bench.up();
        bench.stream();
    }
}

#[test]
fn one_byte_in_five_thousand_lost_and_one_changed_slow_a_line_down_and_do_not_end_it() {
    let (mut damaged, mut repeated) = (0, 0);
    for seed in 0..8 {
        let mut bench = Bench::new(seed, Noise::default());
        bench.up();
        let mut all = passages(&mut bench, &[6000, 100, 3000]);
        bench.noise = Noise { lost: 2, changed: 2, ..Noise::default() };
        let done = bench.until(60_000, |bench| {
            all.iter_mut().for_each(|one| one.go_on(bench));
            all.iter().all(|one| one.came == one.bytes)
        });
        assert!(
            done && bench.events.iter().flatten().all(|event| *event != LineEvent::Down),
            "seed {seed}"
        );
        for line in [&bench.caller, &bench.listener] {
            damaged += line.damaged();
            repeated += line.repeated();
        }
    }
    assert!(
        damaged > 8 && repeated > 8,
        "the noise was there: {damaged} damaged, {repeated} times again"
    );
}

#[test]
fn a_line_that_nobody_answers_is_given_up_after_three_seconds_and_comes_back() {
    let mut bench = Bench::new(1, Noise::default());
    bench.up();
    let (near, far) = bench.stream();
    bench.noise.lost = 10_000;
    bench.caller.write(near, b"hello?").expect("there is room");
    let began = bench.now;
    assert!(bench.until(10_000, |bench| !bench.caller.is_up()));
    assert_eq!(bench.now.since(began).as_millis() / 10, 300, "one step to send it");
    assert_eq!(bench.caller.write(near, b"more"), Err(StreamError::Ended));
    assert!(bench.listener.is_up(), "it has nothing to send and cannot know");
    bench.noise.lost = 0;
    bench.up();
    assert_eq!(bench.listener.read(far, &mut [0; 9]), Err(StreamError::Ended), "the caller began anew");
    assert!(bench.events[1].contains(&LineEvent::Down) && bench.events[0].contains(&LineEvent::Down));
}

#[test]
fn a_stream_that_nobody_reads_stands_still_and_the_others_go_on() {
    let mut bench = Bench::new(2, Noise::default());
    bench.up();
    let (stuck, stuck_there) = bench.stream();
    let mut written = 0;
    bench.until(5_000, |bench| {
        written += bench.caller.write(stuck, &[7; 1000]).unwrap_or(0);
        false
    });
    assert_eq!(written, 8 * 1024 + 4 * 1024, "the window there and the queue here");
    let (near, far) = bench.stream();
    bench.caller.write(near, b"light").expect("there is room");
    let mut room = [0; 5];
    assert!(bench.until(100, |bench| bench.listener.read(far, &mut room) == Ok(5)));
    bench.events[0].clear();
    let mut big = vec![0; 8192];
    assert_eq!(bench.listener.read(stuck_there, &mut big), Ok(8192));
    let ready = LineEvent::Ready(stuck.number);
    assert!(bench.until(2_000, |bench| bench.events[0].contains(&ready)), "there is room again");
    assert!(bench.caller.is_up());
}

#[test]
fn sixteen_streams_are_open_at_once_and_a_number_is_used_anew_when_both_have_closed() {
    let mut bench = Bench::new(3, Noise { repeated: 1000, ..Noise::default() });
    bench.up();
    let streams: Vec<_> = (0..STREAMS).map(|_| bench.stream()).collect();
    assert_eq!(bench.caller.open(), None);
    let (near, far) = streams[5];
    bench.caller.write(near, b"last words").expect("there is room");
    bench.caller.close(near);
    let mut room = [0; 10];
    assert!(bench.until(1_000, |bench| bench.listener.read(far, &mut room) == Ok(10)));
    assert!(bench.until(1_000, |bench| bench.listener.read(far, &mut room) == Err(StreamError::Ended)));
    assert_eq!((&room, bench.caller.open()), (b"last words", None));
    bench.listener.close(far);
    bench.until(100, |_| false);
    let (again, _) = bench.stream();
    assert_eq!(again.number, 5);
    assert_eq!(
        bench.caller.write(near, b"x"),
        Err(StreamError::Ended),
        "its former user is not its new one"
    );
}

#[test]
fn s80_a_stream_is_heard_in_full_by_either_side_of_a_restart() {
    let mut bench = Bench::new(4, Noise::default());
    bench.up();
    let (near, far) = bench.stream();
    bench.listener.write(far, &[1; 4000]).expect("there is room");
    bench.until(20, |_| false);
    // The listener's process begins anew while its old bytes are still on the line.
    let mut on_the_line: VecDeque<u8> = bench.listener.output(bench.now).iter().copied().collect();
    bench.listener = Line::new(Role::Listener, 99, BAUD, bench.now);
    let rest: Vec<u8> = on_the_line.drain(..).collect();
    bench.caller.receive(&rest, bench.now);
    bench.caller.write(near, b"are you there?").expect("there is room");
    assert!(bench.until(1_000, |bench| !bench.caller.is_up()), "it is told that nobody knows it");
    bench.up();
    let (near, far) = bench.stream();
    bench.caller.write(near, b"anew").expect("there is room");
    let mut room = [0; 9];
    assert!(bench.until(1_000, |bench| bench.listener.read(far, &mut room) == Ok(4)));
    assert_eq!(&room[..4], b"anew");
}
