//! A hub that is killed in the middle of uploads has whole files only, and those that it said were saved.

mod program;

use program::{new_folder, sk, skrobot};
use sk_core::flow::{BlobProgress, FlowBlob, SkFlowSat};
use sk_core::prelude::*;
use sk_robot::places::Places;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

/// How often the hub is killed.
const KILLS: u64 = 12;
const FILE_BYTES: usize = 1_500_000;

/// Every version of the file differs from the others in all its parts and says which it is.
fn content(version: u64) -> Vec<u8> {
    let words = (0..FILE_BYTES as u64 / 8).map(|index| version << 32 | index);
    words.flat_map(u64::to_le_bytes).collect()
}

fn version_of(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) >> 32
}

/// Uploads one version after the other, and ends the loop after some events.
struct Client {
    blob: Handle<FlowBlob>,
    version: u64,
    saved: u64,
    events_left: u64,
    refused: Option<String>,
}

impl Client {
    fn upload(&mut self, cx: &mut Cx) {
        self.version += 1;
        assert!(self.blob.upload(cx, "f", content(self.version)));
    }

    fn on_saved(&mut self, cx: &mut Cx, _path: String) {
        self.saved = self.version;
        self.upload(cx);
        self.count(cx);
    }

    fn on_progress(&mut self, cx: &mut Cx, _progress: &BlobProgress) {
        self.count(cx);
    }

    fn on_refused(&mut self, cx: &mut Cx, path: String, why: String) {
        self.refused = Some(format!("{path}: {why}"));
        cx.quit();
    }

    fn count(&mut self, cx: &mut Cx) {
        self.events_left = self.events_left.saturating_sub(1);
        if self.events_left == 0 {
            cx.quit();
        }
    }
}

object! { Client { slots { on_saved(String) on_progress(&BlobProgress) on_refused(String, String) } } }

/// Ended with the test, whatever happens.
struct Robot {
    hub: Option<Child>,
    folder: PathBuf,
}

impl Robot {
    fn start_hub(&mut self) {
        let hub = skrobot(&self.folder)
            .args(["--tcp", "127.0.0.1:0"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        self.hub = Some(hub.expect("the hub starts"));
    }

    fn kill_hub(&mut self) {
        if let Some(mut hub) = self.hub.take() {
            hub.kill().expect("it runs");
            hub.wait().expect("it ended");
        }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.kill_hub();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn an_upload_that_was_said_to_be_saved_survives_the_killing_of_the_hub() {
    let mut robot = Robot { hub: None, folder: new_folder() };
    let address = Places::find(Some(&robot.folder)).expect("a short path").address();
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().expect("a loop");
    let cx = app.cx();
    let blob = SkFlowSat::connect(cx, &address).blob(cx, "maps").expect("a name");
    let client = cx.spawn(Client { blob, version: 0, saved: 0, events_left: 0, refused: None });
    attach!(cx, blob.saved => client.on_saved);
    attach!(cx, blob.progress => client.on_progress);
    attach!(cx, blob.refused => client.on_refused);
    cx.with(client, |client, cx| client.upload(cx)).expect("it is there");
    for kill in 0..KILLS {
        robot.start_hub();
        // At other moments of an upload each time: a piece is an event, and an upload has six and its end.
        app.cx()
            .with(client, |client, _| client.events_left = 5 + kill * 5 % 14)
            .expect("it is there");
        app.run();
        let refused = app.cx().with(client, |client, _| client.refused.take()).expect("it is there");
        assert_eq!(refused, None, "kill {kill}");
        robot.kill_hub();
        let (saved, version) = app
            .cx()
            .with(client, |client, _| (client.saved, client.version))
            .expect("it is there");
        check(&robot.folder.join("blobs/robot.maps/files"), saved, version);
    }
    let saved = app.cx().with(client, |client, _| client.saved).expect("it is there");
    assert!(saved > 0, "some uploads came to their end");
    drop(app);
    robot.start_hub();
    served_again(&robot.folder);
}

/// What readers would see: the version that was saved last, or the one that was on its way.
fn check(files: &Path, saved: u64, version: u64) {
    let names: Vec<_> = std::fs::read_dir(files)
        .map_or(Vec::new(), |folder| folder.map(|entry| entry.expect("readable").file_name()).collect());
    if saved == 0 && names.is_empty() {
        return;
    }
    assert_eq!(names, ["f"], "nothing but the file is seen");
    let bytes = std::fs::read(files.join("f")).expect("it is there");
    let found = version_of(&bytes);
    assert!(
        (saved..=version).contains(&found),
        "version {found}, of {saved} saved and {version} begun"
    );
    assert!(bytes == content(found), "version {found} is not whole");
}

/// The tool finds the file again when somebody opens the channel.
fn served_again(folder: &Path) {
    let name = folder.join("note.txt");
    std::fs::write(&name, "hello").expect("written");
    let mut owner = std::process::Command::new(env!("CARGO_BIN_EXE_sk"));
    owner.arg("--state-dir").arg(folder).args(["blob", "serve", "maps"]).arg(&name);
    // The hub may still be on its way up.
    let mut owner = loop {
        let mut child = owner
            .env_remove("SKROBOT_HUB")
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts");
        let mut line = String::new();
        let out = child.stdout.take().expect("piped");
        std::io::BufRead::read_line(&mut std::io::BufReader::new(out), &mut line).expect("readable");
        if line.contains("Ctrl-C") {
            break child;
        }
        child.wait().expect("it ended");
    };
    let said = |arguments: &[&str]| {
        let output = sk(folder, arguments);
        assert!(output.status.success(), "{arguments:?}: {}", program::text(&output.stderr));
        program::text(&output.stdout)
    };
    let list = said(&["blob", "ls", "maps"]);
    assert!(list.contains("1500000  f\n") && list.contains("5  note.txt\n"), "{list}");
    assert_eq!(said(&["blob", "stat", "robot.maps", "note.txt"]), "5 bytes, CRC-32 3610a686\n");
    let copy = folder.join("copy");
    said(&["blob", "get", "maps", "f", copy.to_str().expect("UTF-8")]);
    let bytes = std::fs::read(&copy).expect("it is there");
    assert!(bytes == content(version_of(&bytes)));
    let missing = sk(folder, &["blob", "get", "maps", "none"]);
    assert!(program::text(&missing.stderr).contains("nothing at this path"), "{missing:?}");
    owner.kill().expect("it runs");
    owner.wait().expect("it ended");
}
