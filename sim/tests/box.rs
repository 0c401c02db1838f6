//! The simulation itself: it repeats exactly, it finds what is wrong, and its scripts can be read again.

use sk_sim::action::Action;
use sk_sim::run::run;
use sk_sim::script::{Role, Script};
use sk_sim::{generate, log};

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another() {
    let mut hashes = std::collections::BTreeSet::new();
    for seed in 1..=12 {
        let script = generate::script(seed);
        let first = run(&script);
        assert_eq!(first, run(&script), "seed {seed}");
        assert_eq!(first.complaint, None, "seed {seed}");
        hashes.insert(first.hash);
    }
    assert_eq!(hashes.len(), 12);
}

#[test]
fn every_script_can_be_written_down_and_read_again() {
    let mut seen = std::collections::BTreeSet::new();
    for seed in 0..300 {
        let script = generate::script(seed);
        let text = script.to_string();
        assert_eq!(text.parse::<Script>().as_ref(), Ok(&script), "seed {seed}");
        for step in &script.steps {
            seen.insert(step.action.to_string().split(' ').next().unwrap_or_default().to_owned());
        }
    }
    let all = [
        "abort",
        "browse",
        "burst",
        "by-udp",
        "call",
        "close",
        "die",
        "disk",
        "drop",
        "fetch",
        "follow",
        "follow-no-more",
        "hear",
        "hear-all",
        "home",
        "late",
        "link",
        "load",
        "lossy",
        "make-folder",
        "mend",
        "open",
        "part",
        "poll",
        "poll-no-more",
        "put",
        "quit",
        "refuse",
        "repeat",
        "repeat-no-more",
        "reset",
        "rot",
        "save",
        "serve",
        "shift",
        "slow",
        "start",
        "stray",
        "tick",
        "tick-no-more",
        "unhear",
        "unserve",
        "watch",
        "wild",
        "write",
    ];
    assert_eq!(seen.iter().map(String::as_str).collect::<Vec<_>>(), all, "every kind comes up");
}

#[test]
fn a_script_that_is_none_is_refused_with_its_line() {
    for (text, line) in [
        ("seed x\n", 1),
        ("seed 1\nnode 0 hubs\n", 2),
        ("seed 1\n# fine\nat 1.000ms n1 fly\n", 3),
        ("at 2.000ms n1 reset\nat 1.000ms n1 reset\n", 2),
        ("at 2ms n1 reset\n", 1),
        ("seed 1 2\n", 1),
    ] {
        assert_eq!(text.parse::<Script>().map_err(|error| error.line), Err(line), "{text:?}");
    }
}

/// Seeds alone would not tell a simulation in which nothing happens from a hub without faults.
#[test]
fn runs_are_full_of_life() {
    let (mut published, mut heard, mut roles) = (0, 0, Vec::new());
    for seed in 1..=30 {
        let script = generate::script(seed);
        let outcome = run(&script);
        published += outcome.published;
        heard += outcome.heard;
        roles.extend(script.nodes.iter().map(|(_, role)| *role));
    }
    assert!(published > 2000 && heard > 1000, "{published} published, {heard} heard");
    let inside = |role: &Role| matches!(role, Role::Inside { .. });
    assert!(roles.iter().any(inside) && roles.contains(&Role::Wild));
}

/// Steps that make no sense do nothing: what the shrinker leaves is always a script.
#[test]
fn deleting_from_a_script_leaves_a_script_that_runs() {
    log::listen();
    for seed in 1..=6 {
        let mut script = generate::script(seed);
        let mut keep = seed;
        script.steps.retain(|_| {
            keep = keep.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            keep >> 62 != 0
        });
        script.nodes.retain(|(number, _)| *number != 3);
        assert_eq!(run(&script).complaint, None, "seed {seed}");
        script.steps.retain(|step| !matches!(step.action, Action::Open(_)));
        assert_eq!(run(&script).complaint, None, "seed {seed} without channels");
    }
}

/// Without a hub nobody is let in, and that is a complaint: the rules can be broken.
#[test]
fn a_rule_that_is_broken_is_told() {
    let script: Script = "seed 1\nnode 1 satellite tcp\nat 1.000ms n1 open 0\n"
        .parse()
        .expect("a script");
    let complaint = run(&script).complaint.expect("it is lost");
    assert_eq!(complaint.rule, sk_sim::rule::Rule::Restored);
    let shrunk = sk_sim::shrink::shrink(&script, 50).expect("it still fails");
    assert_eq!((shrunk.script.steps.len(), shrunk.script.nodes.len()), (0, 1));
}

/// A process that is started again while the hub takes its predecessor for alive: it is refused its own names for
/// seconds, and has them afterwards, blob channels too.
#[test]
fn a_satellite_takes_its_names_when_the_hub_lets_its_predecessor_go() {
    for role in ["satellite tcp", "plain unix"] {
        let text = format!(
            "seed 1\nnode 0 hub\nnode 3 {role}\nat 30.000ms n3 open 0\nat 500.000ms n3 die vanished\n\
             at 600.000ms n3 start\nat 610.000ms n3 open 0\n"
        );
        assert_eq!(run(&text.parse::<Script>().expect("a script")).complaint, None, "{role}");
    }
    let filer = "seed 1\nnode 0 hub\nnode 3 filer tcp\nat 500.000ms n3 die vanished\nat 600.000ms n3 start\n\
                 at 610.000ms n3 put 0 1 100\n";
    assert_eq!(run(&filer.parse::<Script>().expect("a script")).complaint, None);
}

/// An upload that a hub without power interrupts goes on where it was or begins anew, and what was acknowledged is there.
#[test]
fn an_upload_goes_on_after_the_end_of_the_hub_or_of_its_way() {
    for (death, after_us) in
        [("n0 die power-cut", 300), ("n0 die power-cut", 3000), ("n0 die killed", 900), ("n3 reset", 700)]
    {
        let text = format!(
            "seed 3\nnode 0 hub\nnode 3 filer tcp\nnode 4 filer web\nat 40.000ms n3 put 0 1 9000\n\
             at 60.000ms n3 put 1 2 900000\nat {}.{:03}ms {death}\nat 90.000ms n0 start\n\
             at 400.000ms n4 fetch 3 0\nat 400.000ms n4 fetch 3 1\n",
            60 + after_us / 1000,
            after_us % 1000
        );
        assert_eq!(run(&text.parse::<Script>().expect("a script")).complaint, None, "{death} {after_us}");
    }
}

/// A satellite that calls another hub than its own is let in by user id and not by a token, and either way it has all
/// its own when it is back.
#[test]
fn a_satellite_that_mistakes_a_hub_for_another_does_no_harm_there() {
    for way in ["tcp", "unix", "web"] {
        let text = format!(
            "seed 5\nnode 0 hub\nnode 3 satellite {way}\nnode 4 other-hub\nnode 5 guest {way} 4\n\
             at 40.000ms n3 open 0\nat 40.000ms n5 open 1\nat 41.000ms n5 hear 5 1 0\nat 50.000ms n5 stray\n\
             at 50.000ms n3 stray\nat 400.000ms n5 burst 1 3 99\nat 500.000ms n4 die killed\n\
             at 600.000ms n4 start\nat 900.000ms n5 home\n"
        );
        assert_eq!(run(&text.parse::<Script>().expect("a script")).complaint, None, "{way}");
    }
}

/// Databases are written, saved and watched while the hub dies in each way, with a disk that fails in between.
#[test]
fn nothing_acknowledged_is_lost_however_a_hub_ends() {
    for death in ["die killed", "die vanished", "die power-cut", "quit"] {
        let text = format!(
            "seed 3\nnode 0 hub\nnode 3 scribe tcp\nnode 4 scribe unix\nat 40.000ms n4 watch 3\n\
             at 40.000ms n3 write 9\nat 41.000ms n3 save\nat 60.000ms n0 disk 50 50 50 0\nat 61.000ms n3 write 9\n\
             at 80.000ms n0 disk 0 0 0 0\nat 81.000ms n3 write 9\nat 82.000ms n3 save\nat 83.500ms n0 {death}\n\
             at 90.000ms n0 start\nat 400.000ms n3 load\nat 400.000ms n3 write 3\n"
        );
        assert_eq!(run(&text.parse::<Script>().expect("a script")).complaint, None, "{death}");
    }
}
