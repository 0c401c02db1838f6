//! What `sk doctor` finds on this machine, without a hub.

use super::finding::{Finding, Mark};
use crate::table::{bytes, span};
use nix::sys::resource::{Resource, getrlimit};
use nix::sys::statvfs::statvfs;
use sk_core::eventloop::SchedulingPolicy;
use sk_core::prelude::*;
use sk_core::world::World;
use sk_robot::places::Places;
use std::path::Path;

/// With fewer descriptors a hub cannot serve many satellites.
const DESCRIPTORS_MIN: u64 = 1_024;
/// With less room on the disk databases cannot be trusted to be saved.
const DISK_BYTES_MIN: u64 = 100_000_000;
/// How long the waits are that are measured.
const WAIT: Duration = Duration::from_millis(1);
const WAITS: u32 = 20;
/// A wait that is later than this needs a word.
const LATE_MAX: Duration = Duration::from_millis(2);

/// All checks that need no hub.
pub fn checks(places: &Places, world: &World) -> Vec<Finding> {
    let mut found = vec![state_folder(places, world)];
    found.push(token(places, world));
    found.push(descriptors());
    found.push(disk(places.state()));
    found.extend(timing());
    found
}

fn state_folder(places: &Places, world: &World) -> Finding {
    let what = "state folder";
    let shown = places.state().display();
    let Ok((_, mode)) = world.storage.owner_and_mode(places.state()) else {
        let says = format!("{shown} is not there yet");
        return Finding::new(Mark::Warn, what, says, "start skrobot once; it makes the folder");
    };
    let uid = nix::unistd::geteuid().as_raw();
    match places.check_owner(&*world.storage, uid) {
        Ok(()) => Finding::ok(what, format!("{shown}, mode {:03o}", mode & 0o777)),
        Err(error) => Finding::new(Mark::Fail, what, error.to_string(), ""),
    }
}

fn token(places: &Places, world: &World) -> Finding {
    let what = "owner's token";
    let path = places.token();
    let shown = path.display();
    match world.storage.owner_and_mode(&path) {
        Err(_) => {
            let says = format!("{shown} is not there");
            Finding::new(
                Mark::Warn,
                what,
                says,
                "start skrobot once; it makes the token of the owner's account",
            )
        }
        Ok((_, mode)) if mode & 0o077 != 0 => {
            let says = format!("others may read {shown}, its mode is {:03o}", mode & 0o777);
            Finding::new(
                Mark::Fail,
                what,
                says,
                "remove the file, since it may be known; the next start makes another",
            )
        }
        Ok((_, mode)) => Finding::ok(what, format!("{shown}, mode {:03o}", mode & 0o777)),
    }
}

fn descriptors() -> Finding {
    let what = "descriptors";
    match getrlimit(Resource::RLIMIT_NOFILE) {
        Ok((now, _)) if now >= DESCRIPTORS_MIN => Finding::ok(what, format!("{now} for a process")),
        Ok((now, most)) => {
            let says = format!("{now} for a process, of {most} that are possible");
            Finding::new(Mark::Warn, what, says, "raise them where the hub is started: `ulimit -n 65536`")
        }
        Err(error) => Finding::new(Mark::Warn, what, error.to_string(), ""),
    }
}

/// The room where the state folder is, or will be.
fn disk(state: &Path) -> Finding {
    let what = "disk";
    let Some(Ok(room)) = state.ancestors().map(statvfs).find(Result::is_ok) else {
        return Finding::new(Mark::Warn, what, format!("the room for {} is not known", state.display()), "");
    };
    // The types of these differ between kinds of machines.
    #[expect(clippy::unnecessary_cast, reason = "they are of other types on 32-bit machines")]
    let (free, total) = (
        room.blocks_available() as u64 * room.fragment_size() as u64,
        room.blocks() as u64 * room.fragment_size() as u64,
    );
    let says = format!("{} free of {}", bytes(free as f64), bytes(total as f64));
    match free >= DISK_BYTES_MIN {
        true => Finding::ok(what, says),
        false => Finding::new(Mark::Fail, what, says, "make room: databases are saved there"),
    }
}

/// What the kernel grants a realtime loop, and how late this machine wakes.
fn timing() -> Vec<Finding> {
    let mut findings = Vec::new();
    let measured = std::thread::spawn(|| {
        let wishes = |settings: &mut LoopSettings| {
            settings.mode = TimingMode::Realtime;
            settings.interval = WAIT;
            settings.slow_interval = settings.slow_interval.max(WAIT);
            settings.realtime.policy = SchedulingPolicy::Fifo(10);
            settings.realtime.no_cpu_sleep = true;
        };
        let mut app = SkApp::builder()
            .name("doctor")
            .configure(wishes)
            .build()
            .map_err(|error| error.to_string())?;
        for _ in 0..WAITS {
            app.pulse();
        }
        let stats = app.cx().stats();
        Ok::<_, String>((stats.refused_wishes, stats.wake_error.max))
    });
    let (refused, latest) = match measured.join() {
        Ok(Ok(measured)) => measured,
        Ok(Err(error)) => return vec![Finding::new(Mark::Warn, "timing", error, "")],
        Err(_) => return vec![Finding::new(Mark::Warn, "timing", "could not be measured".to_owned(), "")],
    };
    let known = [
        ("timer slack", "timer slack", "wakes exactly", ""),
        (
            "scheduling class",
            "realtime class",
            "a loop may run before others (SCHED_FIFO)",
            "for tight loops: `rtprio` in /etc/security/limits.conf, LimitRTPRIO= of the service, or CAP_SYS_NICE",
        ),
        (
            "cpu_dma_latency",
            "CPU sleep",
            "the processor can be kept awake",
            "for tight loops: write access to /dev/cpu_dma_latency",
        ),
    ];
    for (word, what, granted, todo) in known {
        findings.push(match refused.iter().find(|refused| refused.contains(word)) {
            Some(refused) => Finding::new(Mark::Warn, what, format!("refused {refused}"), todo),
            None => Finding::ok(what, granted.to_owned()),
        });
    }
    let says = format!("{WAITS} waits of {}, at most {} late", span(WAIT), span(latest));
    findings.push(match latest <= LATE_MAX {
        true => Finding::ok("clock", says),
        false => Finding::new(Mark::Warn, "clock", says, "the machine is busy, or a guest of another one"),
    });
    findings
}
