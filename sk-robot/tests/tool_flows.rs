//! `sk` takes part: it publishes, hears, measures, and asks services.

mod program;

use program::{Hub, Running, failure, lines, new_folder, objects, success, text};
use sk_core::flow::{HubAddress, Request, SkFlowSat};
use sk_core::prelude::*;
use std::path::Path;

fn hub() -> Hub {
    Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host"])
}

#[test]
fn what_is_published_is_heard_as_it_was() {
    let hub = hub();
    let hearer = Running::start(&hub, &["echo", "x", "--wait", "-n", "2"]);
    assert_eq!(
        success(&hub.sk(&["pub", "x", "{\"a\":[1,2.5],\"b\":\"µ\"}", "--wait", "--count", "2"])),
        ""
    );
    assert_eq!(hearer.all(), "{\"a\":[1,2.5],\"b\":\"µ\"}\n".repeat(2));

    let hearer = Running::start(&hub, &["echo", "x", "y", "--wait", "--json", "-n", "2"]);
    let told = objects(&hub.sk(&["pub", "x", "-1", "--wait", "--json"]));
    assert_eq!((&told[0]["sent"], &told[0]["listeners"]), (&1.into(), &1.into()));
    success(&hub.sk(&["pub", "y", "null", "--wait"]));
    let expected = "{\"channel\":\"robot.x\",\"value\":-1}\n{\"channel\":\"robot.y\",\"value\":null}\n";
    assert_eq!(hearer.all(), expected);
}

#[test]
fn who_publishes_to_nobody_is_told_so() {
    let hub = hub();
    let said = failure(&hub.sk(&["pub", "x", "1"]), 1);
    assert_eq!(said, "sk: nobody listens to robot.x (--wait waits for somebody)\n");
    let said = failure(&hub.sk(&["pub", "Not A Name", "1"]), 1);
    assert!(said.contains("name"), "{said}");
    // The name is somebody's already.
    let _owner = Running::start(&hub, &["pub", "x", "1", "--rate", "50"]);
    let mut hearer = Running::start(&hub, &["echo", "x", "--wait"]);
    hearer.line();
    let said = failure(&hub.sk(&["pub", "x", "1"]), 1);
    assert!(said.starts_with("sk: the hub refused: ") && said.contains("exists"), "{said}");
}

#[test]
fn lines_of_standard_input_are_messages() {
    let hub = hub();
    let hearer = Running::start(&hub, &["echo", "x", "--wait", "-n", "3"]);
    let input = "1\n\n{\"n\":2}\n\"three\"\n";
    success(&hub.sk_with_input(&["pub", "x", "-", "--wait"], input));
    assert_eq!(hearer.all(), "1\n{\"n\":2}\n\"three\"\n");
    let said = failure(&hub.sk_with_input(&["pub", "x", "-"], "1\n{no\n"), 1);
    assert!(said.starts_with("sk: line 2 of standard input: this is no JSON"), "{said}");
}

#[test]
fn bytes_are_shown_in_hex_and_images_go_to_files() {
    let hub = hub();
    let folder = hub.folder.join("images");
    std::fs::create_dir_all(&folder).unwrap();
    let image = hub.folder.join("eye.png");
    let bytes: Vec<u8> = b"\x89PNG\r\n".iter().copied().chain(0..40).collect();
    std::fs::write(&image, &bytes).unwrap();
    let source = format!("@{}", image.display());

    let hearer = Running::start(&hub, &["echo", "eye", "--wait", "-n", "1"]);
    success(&hub.sk(&["pub", "eye", &source, "--wait"]));
    let shown = hearer.all();
    assert!(
        shown.starts_with("image/png 46 bytes: 89 50 4e 47 0d 0a 00 01") && shown.ends_with(" …\n"),
        "{shown}"
    );
    let hearer = Running::start(&hub, &["echo", "eye", "--wait", "-n", "1", "--hex"]);
    success(&hub.sk(&["pub", "eye", &source, "--wait"]));
    assert!(hearer.all().ends_with(" 26 27\n"));

    let saved = folder.to_str().unwrap();
    let hearer = Running::start(&hub, &["echo", "eye", "--wait", "-n", "2", "--save", saved]);
    success(&hub.sk(&["pub", "eye", &source, "--wait", "--count", "2"]));
    let files: Vec<String> = hearer.all().lines().map(str::to_owned).collect();
    let path = |number| format!("{saved}/robot.eye-{number:06}.png");
    assert_eq!(files, [1, 2].map(|number| format!("{} (46 B)", path(number))));
    assert_eq!(std::fs::read(path(2)).unwrap(), bytes);
    assert_eq!(
        failure(&hub.sk(&["echo", "eye", "--save", "/nowhere"]), 1),
        "sk: /nowhere is no folder: make it first\n"
    );
}

#[test]
fn hz_measures_rate_jitter_bytes_and_what_was_lost() {
    let hub = hub();
    let _publisher = Running::start(&hub, &["pub", "x", "1", "--rate", "100"]);
    Running::start(&hub, &["echo", "x", "--wait"]).line();
    let told = &objects(&hub.sk(&["hz", "x", "-n", "2", "--json"]))[1];
    let number = |key: &str| told[key].as_f64().unwrap();
    assert!(number("hz") > 0.0 && number("messages") >= 2.0, "{told}");
    assert!(number("interval_min_s") <= number("interval_mean_s"), "{told}");
    assert!(number("interval_mean_s") <= number("interval_max_s"), "{told}");
    assert!((number("hz") * number("interval_mean_s") - 1.0).abs() < 1e-9, "{told}");
    assert_eq!(number("bytes_per_message"), 9.0, "an integer as a variant: {told}");
    let line = &lines(&hub.sk(&["hz", "robot.x", "-n", "1"]))[0];
    assert!(
        line.contains(" Hz (") && line.contains("jitter") && line.ends_with("9 B/message  lost 0"),
        "{line}"
    );
}

/// Counts down to nothing, an answer for each number.
struct Countdown;

object! { Countdown { slots { on_request(&Request) } } }

impl Countdown {
    fn on_request(&mut self, cx: &mut Cx, request: &Request) {
        match request.value().ok().and_then(|value| value.as_u64()) {
            Some(0) => {
                request.answer(cx, "ended");
                cx.quit();
            }
            Some(from) => {
                for number in (1..from).rev() {
                    request.answer_more(cx, number);
                }
                request.answer(cx, "lift off");
            }
            None => drop(request.decline(cx, "a number\u{1b}[2J is wanted")),
        }
    }
}

/// A satellite with that service, until it is asked to count from 0.
fn countdown(socket: &Path) -> std::thread::JoinHandle<()> {
    let address = HubAddress::from(socket);
    std::thread::spawn(move || {
        let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
        let cx = app.cx();
        let hub = SkFlowSat::connect(cx, &address);
        let service = hub.serve(cx, "countdown", "a number; counts down").unwrap();
        let countdown = cx.spawn(Countdown);
        attach!(cx, service.request => countdown.on_request);
        app.run();
        // The last answer goes out.
        for _ in 0..10 {
            app.pulse();
        }
    })
}

#[test]
fn call_prints_every_answer_and_says_why_there_is_none() {
    let hub = hub();
    let said = failure(&hub.sk(&["call", "countdown", "3"]), 1);
    assert_eq!(said, "sk: no service countdown: `sk ls --all` lists them (--wait waits for it)\n");
    let satellite = countdown(&hub.folder.join("hub.sock"));
    assert_eq!(success(&hub.sk(&["call", "countdown", "3", "--wait"])), "2\n1\n\"lift off\"\n");
    let told = objects(&hub.sk(&["call", "robot.countdown", "2", "--json", "--within", "30"]));
    assert_eq!((&told[0]["value"], &told[0]["last"]), (&1.into(), &false.into()));
    assert_eq!(told[1]["last"], true);
    let said = failure(&hub.sk(&["call", "countdown", "\"x\""]), 1);
    assert_eq!(said, "sk: robot.countdown declined: a number\\u{1b}[2J is wanted\n");
    let said = failure(&hub.sk(&["call", "cuontdown"]), 1);
    assert!(said.contains("did you mean robot.countdown?"), "{said}");
    failure(&hub.sk(&["call", "countdown", "1", "--within", "never"]), 2);
    assert_eq!(text(&hub.sk(&["call", "countdown", "0"]).stdout), "\"ended\"\n");
    satellite.join().unwrap();
}

/// Publishes a rising number by datagram at every tick, until it is told to end.
struct Beacon {
    hub: Handle<SkFlowSat>,
    sent: u64,
}

object! { Beacon { slots { tick() on_lost() } } }

impl Beacon {
    fn tick(&mut self, cx: &mut Cx) {
        // Before that it would go over the connection.
        if self.hub.is_udp_open(cx) && self.hub.publish(cx, "pose", self.sent) {
            self.sent += 1;
        }
    }
    fn on_lost(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}

fn beacon(socket: &Path) -> std::thread::JoinHandle<()> {
    let address = HubAddress::from(socket);
    std::thread::spawn(move || {
        let builder = SkApp::builder().mode(TimingMode::SelectIo).interval(Duration::from_millis(5));
        let mut app = builder.build().unwrap();
        let cx = app.cx();
        let hub = SkFlowSat::connect(cx, &address);
        hub.open(cx, "pose", SkVariant::map([("format", "variant".into())])).unwrap();
        hub.publish_by_udp(cx, "pose").unwrap();
        let beacon = cx.spawn(Beacon { hub, sent: 0 });
        attach!(cx, cx.fast_zone().pulse => beacon.tick);
        attach!(cx, hub.lost => beacon.on_lost());
        app.run();
    })
}

#[test]
fn s71_a_hub_that_is_told_so_takes_what_is_published_by_datagram_and_counts_it() {
    let hub =
        Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host", "--listen", "udp:127.0.0.1:0"]);
    let line = hub.greeting.iter().find_map(|line| line.split_once("udp:127.0.0.1:")).unwrap();
    let port: u16 = line.1.split_whitespace().next().unwrap().parse().unwrap();
    let told = &objects(&hub.sk(&["info", "--json"]))[0]["datagrams"];
    assert_eq!((&told["port"], &told["taken"]), (&port.into(), &0.into()));

    let satellite = beacon(&hub.folder.join("hub.sock"));
    let heard = lines(&hub.sk(&["echo", "pose", "--wait", "-n", "5"]));
    let numbers: Vec<u64> = heard.iter().map(|line| line.parse().unwrap()).collect();
    assert!(numbers.is_sorted() && numbers.len() == 5, "{numbers:?}");
    // A stranger's datagram is counted and does nothing else.
    let stranger = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger.send_to(&[0; 60], ("127.0.0.1", port)).unwrap();
    let told = loop {
        let told = objects(&hub.sk(&["info", "--json"])).remove(0);
        if told["datagrams"]["unknown"] == 1 {
            break told;
        }
    };
    assert!(told["datagrams"]["taken"].as_u64() >= Some(5), "{told}");
    assert_eq!((&told["datagrams"]["forged"], &told["spurious"]), (&0.into(), &0.into()));
    let shown = success(&hub.sk(&["info"]));
    assert!(
        shown.contains(&format!("at port {port}: ")) && shown.contains("1 of no session"),
        "{shown}"
    );
    hub.end();
    satellite.join().unwrap();
}
