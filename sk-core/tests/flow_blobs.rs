//! Blob channels through the objects of a program: uploads, downloads, lost connections, a hub that is killed.

use bytes::Bytes;
use sk_core::attach;
use sk_core::flow::blob::{BlobEntry, BlobStore};
use sk_core::flow::server::Settings;
use sk_core::flow::{BlobProgress, FlowBlob, FlowDownload, HubAddress, Rights, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

const ADDRESS: &str = "/hub.sock";

fn start_hub(cx: &mut Cx) -> Handle<SkFlowServer> {
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    server.listen(cx, &HubAddress::Unix(ADDRESS.into())).unwrap();
    let store = BlobStore::open(cx.world().storage.clone(), "/state/blobs".into()).unwrap();
    server.keep_blobs(cx, store).unwrap();
    server
}

fn world(seed: u64) -> (Simulation, SkApp) {
    let simulation = Simulation::new(seed);
    let app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    (simulation, app)
}

fn connect(cx: &mut Cx) -> Handle<SkFlowSat> {
    SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()))
}

fn content(length: usize) -> Bytes {
    (0..length)
        .map(|index| (index * 7 + index / 251) as u8)
        .collect::<Vec<u8>>()
        .into()
}

fn seconds(count: u64) -> Duration {
    Duration::from_secs(count)
}

/// Writes down what a blob channel and downloads tell.
#[derive(Default)]
struct Listener {
    saved: Vec<String>,
    refused: Vec<(String, String)>,
    progress: Vec<BlobProgress>,
    data: Vec<u8>,
    done: u32,
    failed: Vec<String>,
}
impl Listener {
    fn saved(&mut self, _cx: &mut Cx, path: String) {
        self.saved.push(path);
    }
    fn refused(&mut self, _cx: &mut Cx, path: String, why: String) {
        self.refused.push((path, why));
    }
    fn progress(&mut self, _cx: &mut Cx, progress: &BlobProgress) {
        self.progress.push(progress.clone());
    }
    fn data(&mut self, _cx: &mut Cx, bytes: &Bytes) {
        self.data.extend_from_slice(bytes);
    }
    fn done(&mut self, _cx: &mut Cx) {
        self.done += 1;
    }
    fn failed(&mut self, _cx: &mut Cx, why: String) {
        self.failed.push(why);
    }
}
object! {
    Listener {
        slots { saved(String) refused(String, String) progress(&BlobProgress) data(&Bytes) done() failed(String) }
    }
}

fn listen(cx: &mut Cx, blob: Handle<FlowBlob>) -> Handle<Listener> {
    let listener = cx.spawn(Listener::default());
    attach!(cx, blob.saved => listener.saved);
    attach!(cx, blob.refused => listener.refused);
    attach!(cx, blob.progress => listener.progress);
    listener
}

fn follow(cx: &mut Cx, download: Handle<FlowDownload>) -> Handle<Listener> {
    let listener = cx.spawn(Listener::default());
    attach!(cx, download.data => listener.data);
    attach!(cx, download.done => listener.done);
    attach!(cx, download.failed => listener.failed);
    listener
}

#[test]
fn s111_files_of_an_owner_are_held_by_the_hub_and_read_by_others() {
    let (simulation, mut app) = world(1);
    let file = content(3_000_000);
    app.cx().world().storage.replace(Path::new("/local.bin"), &file).unwrap();
    let cx = app.cx();
    let server = start_hub(cx);
    let pipe = server.pipe(cx, Rights::ALL).unwrap();
    let (owner, reader) = (connect(cx), SkFlowSat::inside(cx, pipe));
    // All of it before there is a hub or a channel.
    let maps = owner.blob(cx, "maps").unwrap();
    assert_eq!(owner.blob(cx, "maps").unwrap(), maps, "one object for one name");
    let listener = listen(cx, maps);
    assert!(maps.make_dir(cx, "floors"));
    assert!(maps.upload(cx, "small", &b"hello"[..]));
    assert!(maps.upload_file(cx, "local", "/local.bin"));
    simulation.run_for(&mut app, seconds(3));
    let cx = app.cx();
    assert!(maps.move_to(cx, "local", "floors/1.bin"));
    let answers = Rc::new(RefCell::new(Vec::new()));
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    cx.with(listener, |heard, _| {
        heard.saved.sort();
        assert_eq!(heard.saved, ["floors", "floors/1.bin", "local", "small"]);
        assert_eq!(heard.refused, []);
        let last = heard.progress.iter().rfind(|progress| progress.path == "local").unwrap();
        assert_eq!((last.bytes, last.of), (3_000_000, 3_000_000));
    })
    .unwrap();
    let download = reader.download(cx, "robot.maps", "floors/1.bin").unwrap();
    let came = follow(cx, download);
    let kept = reader.download_to(cx, "robot.maps", "floors/1.bin", "/copy.bin").unwrap();
    let kept = follow(cx, kept);
    let told = answers.clone();
    reader
        .list_blob(cx, "robot.maps", "", move |_, list| told.borrow_mut().push(list))
        .unwrap();
    simulation.run_for(&mut app, seconds(3));
    let cx = app.cx();
    for (listener, bytes) in [(came, file.len()), (kept, 0)] {
        cx.with(listener, |heard, _| {
            assert_eq!((heard.done, heard.failed.as_slice(), heard.data.len()), (1, &[][..], bytes));
            assert!(heard.data.is_empty() || heard.data == file);
        })
        .unwrap();
    }
    assert_eq!(app.cx().world().storage.read(Path::new("/copy.bin"), 1 << 24).unwrap(), file);
    let entry = |name: &str, is_folder, bytes| BlobEntry { name: name.into(), is_folder, bytes };
    assert_eq!(*answers.borrow(), [Ok(vec![entry("floors", true, 0), entry("small", false, 5)])]);
}

#[test]
fn s113_what_cannot_be_had_is_said_and_no_path_leads_out() {
    let (simulation, mut app) = world(2);
    let cx = app.cx();
    start_hub(cx);
    let (owner, reader) = (connect(cx), connect(cx));
    let maps = owner.blob(cx, "maps").unwrap();
    let listener = listen(cx, maps);
    for path in ["../secret", "/etc/passwd", "a/../../b", "", "a//b"] {
        assert!(!maps.upload(cx, path, &b"x"[..]), "{path}");
        assert!(!maps.remove(cx, path), "{path}");
        assert!(reader.download(cx, "robot.maps", path).is_err(), "{path}");
    }
    maps.remove(cx, "none");
    maps.upload_file(cx, "a", "/no/such/file");
    maps.upload(cx, "none/a", &b"x"[..]);
    let download = reader.download(cx, "robot.maps", "none").unwrap();
    let came = follow(cx, download);
    simulation.run_for(&mut app, seconds(2));
    let cx = app.cx();
    cx.with(listener, |heard, _| {
        heard.refused.sort();
        let paths: Vec<&str> = heard.refused.iter().map(|(path, _)| path.as_str()).collect();
        assert_eq!(paths, ["a", "none", "none/a"]);
    })
    .unwrap();
    cx.with(came, |heard, _| assert_eq!((heard.done, heard.failed.len()), (0, 1)))
        .unwrap();
    assert!(!cx.is_alive(download), "a download that is over goes by itself");
}

#[test]
fn uploads_and_downloads_go_on_after_the_hub_was_lost() {
    let (simulation, mut app) = world(3);
    let cx = app.cx();
    let server = start_hub(cx);
    let (owner, reader) = (connect(cx), connect(cx));
    let maps = owner.blob(cx, "maps").unwrap();
    let listener = listen(cx, maps);
    let file = content(6_000_000);
    maps.upload(cx, "big", file.clone());
    let download = reader.download(cx, "robot.maps", "big").unwrap();
    // The file is not there at first, so this one fails; the next is asked for when it is.
    let early = follow(cx, download);
    let mut half = 0;
    while half < 2_000_000 {
        simulation.run_for(&mut app, Duration::from_millis(10));
        half = app
            .cx()
            .with(listener, |heard, _| heard.progress.last().map_or(0, |progress| progress.bytes))
            .unwrap();
    }
    assert!(half < 6_000_000, "the upload is under way");
    let cx = app.cx();
    cx.destroy_later(server);
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    start_hub(cx);
    simulation.run_for(&mut app, seconds(10));
    let cx = app.cx();
    cx.with(listener, |heard, _| {
        assert_eq!((heard.saved.as_slice(), heard.refused.as_slice()), (&["big".to_owned()][..], &[][..]));
        let sent: Vec<u64> = heard.progress.iter().map(|progress| progress.bytes).collect();
        assert!(sent.iter().all(|bytes| *bytes > 0) && sent.len() < 30, "it did not begin anew: {sent:?}");
    })
    .unwrap();
    cx.with(early, |heard, _| assert_eq!(heard.failed.len(), 1)).unwrap();
    let download = reader.download(cx, "robot.maps", "big").unwrap();
    let came = follow(cx, download);
    while cx_data(&mut app, came) < 100_000 {
        simulation.run_for(&mut app, Duration::from_millis(2));
    }
    assert!(cx_data(&mut app, came) < 6_000_000, "the download is under way");
    let server = app.cx().find("flow_server").expect("the second hub");
    app.cx().destroy_later(server);
    simulation.run_for(&mut app, seconds(1));
    start_hub(app.cx());
    simulation.run_for(&mut app, seconds(10));
    // Its owner comes back and with him the channel; the download goes on with the rest.
    app.cx()
        .with(came, |heard, _| {
            assert_eq!((heard.done, heard.failed.as_slice()), (1, &[][..]));
            assert!(heard.data == file);
        })
        .unwrap();
}

fn cx_data(app: &mut SkApp, listener: Handle<Listener>) -> usize {
    app.cx().with(listener, |heard, _| heard.data.len()).unwrap()
}

#[test]
fn a_download_that_nobody_wants_any_more_is_given_up() {
    let (simulation, mut app) = world(4);
    let cx = app.cx();
    start_hub(cx);
    let (owner, reader) = (connect(cx), connect(cx));
    let maps = owner.blob(cx, "maps").unwrap();
    maps.upload(cx, "big", content(9_000_000));
    simulation.run_for(&mut app, seconds(5));
    let cx = app.cx();
    let download = reader.download_to(cx, "robot.maps", "big", "/copy.bin").unwrap();
    simulation.run_for(&mut app, Duration::from_millis(20));
    app.cx().destroy_later(download);
    simulation.run_for(&mut app, seconds(5));
    assert!(app.cx().world().storage.read(Path::new("/copy.bin"), 1 << 24).is_err());
    let left = app.cx().world().storage.list(Path::new("/")).unwrap();
    assert!(!left.iter().any(|name| name.to_string_lossy().ends_with(".part")), "{left:?}");
}

#[test]
fn more_downloads_than_a_hub_serves_at_once_take_turns_and_none_fails() {
    let (simulation, mut app) = world(7);
    let cx = app.cx();
    start_hub(cx);
    let (owner, reader) = (connect(cx), connect(cx));
    let maps = owner.blob(cx, "maps").unwrap();
    assert!(maps.upload(cx, "small", &b"hello"[..]));
    simulation.run_for(&mut app, seconds(2));
    let cx = app.cx();
    let came: Vec<_> = (0..40)
        .map(|_| {
            let download = reader.download(cx, "robot.maps", "small").unwrap();
            follow(cx, download)
        })
        .collect();
    simulation.run_for(&mut app, seconds(5));
    for listener in came {
        let told = app
            .cx()
            .with(listener, |heard, _| (heard.done, heard.failed.clone(), heard.data.clone()));
        assert_eq!(told, Ok((1, vec![], b"hello".to_vec())));
    }
}
