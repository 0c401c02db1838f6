//! The protocol's page and its golden vectors are made from the command table. These tests fail when they
//! are out of date; with the environment variable `SK_REWRITE` set they write them anew.

use bytes::Bytes;
use sk_core::flow::definition::Direction;
use sk_core::flow::delivery::DropReason;
use sk_core::flow::limits::*;
use sk_core::flow::login::{NO_PROOF, OwnerToken};
use sk_core::flow::table::samples::{self, CHANNEL, CLIENT_NONCE, HUB_NONCE};
use sk_core::flow::{
    ChannelKind, ClosingReason, Command, Definition, Event, Flags, Form, Header, Message, Policy,
    RefusalCode, Right, Value,
};
use sk_flat::SkVariant;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

const BEGIN: &str = "<!-- made from the command table: begin -->\n";
const END: &str = "<!-- made from the command table: end -->\n";

fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name)
}

fn compare_or_rewrite(path: &Path, found: &str, made: &str) {
    if found == made {
        return;
    }
    assert!(
        std::env::var_os("SK_REWRITE").is_some(),
        "{} is out of date: run this with SK_REWRITE=1",
        path.display()
    );
    fs::write(path, made).expect("the page can be written");
}

#[test]
fn the_page_says_what_the_table_says() {
    let path = docs("flow-protocol.md");
    let page = fs::read_to_string(&path).expect("the page is there");
    let (before, rest) = page.split_once(BEGIN).expect("the page has the first marker");
    let (_, after) = rest.split_once(END).expect("the page has the second marker");
    compare_or_rewrite(&path, &page, &format!("{before}{BEGIN}{}{END}{after}", generated()));
}

fn generated() -> String {
    let mut out = String::new();
    for (title, table) in
        [("Commands: client to hub", Command::TABLE), ("Events: hub to client", Event::TABLE)]
    {
        let _ = write!(out, "\n### {title}\n\n");
        out.push_str("| id | name | legal in | right | cost | body at most |\n|---|---|---|---|---|---|\n");
        table.iter().for_each(|line| summary(&mut out, line));
        table.iter().for_each(|line| details(&mut out, line));
    }
    numbers(
        &mut out,
        "Refusal codes",
        RefusalCode::ALL.iter().map(|(code, name, text)| (code.code(), *name, *text)),
    );
    numbers(
        &mut out,
        "Closing reasons",
        ClosingReason::ALL.iter().map(|(code, name, text)| (code.code(), *name, *text)),
    );
    numbers(
        &mut out,
        "Drop reasons",
        DropReason::ALL.iter().map(|(code, name, text)| (*code as u16, *name, *text)),
    );
    numbers(
        &mut out,
        "Kinds of channel",
        ChannelKind::ALL.iter().map(|(kind, name, text)| (*kind as u16, *name, *text)),
    );
    numbers(
        &mut out,
        "Policies",
        Policy::ALL.iter().map(|(policy, name, text)| (*policy as u16, *name, *text)),
    );
    out.push_str("\n### Limits\n\n| limit | value |\n|---|---|\n");
    for (name, value) in limits() {
        let _ = writeln!(out, "| {name} | {value} |");
    }
    out.push('\n');
    out
}

fn states(line: &Definition) -> String {
    line.states.iter().map(|state| state.to_string()).collect::<Vec<_>>().join(", ")
}

fn summary(out: &mut String, line: &Definition) {
    let right = match line.right {
        Right::Nothing => "–".to_owned(),
        right => format!("{right:?}").to_lowercase(),
    };
    let (id, name, max) = (line.id, line.name, line.bytes_max());
    let cost =
        if line.direction == Direction::ClientToHub { line.cost.to_string() } else { "–".to_owned() };
    let _ = writeln!(out, "| `{id:#04x}` | `{name}` | {} | {right} | {cost} | {max} |", states(line));
}

fn details(out: &mut String, line: &Definition) {
    let fragment = if line.fragment { " A fragment: it has flags." } else { "" };
    let _ = write!(out, "\n#### `{:#04x}` {}\n\n{}{fragment}\n", line.id, line.name, line.meaning.trim());
    if line.fields.is_empty() {
        out.push_str("The body is the tag alone.\n");
        return;
    }
    out.push_str("\n| field | type | meaning |\n|---|---|---|\n");
    for field in line.fields {
        let _ = writeln!(out, "| `{}` | {} | {} |", field.name, field.wire, field.meaning.trim());
    }
}

fn numbers<'a>(out: &mut String, title: &str, rows: impl Iterator<Item = (u16, &'a str, &'a str)>) {
    let _ = write!(out, "\n### {title}\n\n| number | name | meaning |\n|---|---|---|\n");
    for (number, name, text) in rows {
        let _ = writeln!(out, "| {number} | {name} | {} |", text.trim());
    }
}

fn limits() -> Vec<(&'static str, String)> {
    let bytes = |count: usize| format!("{count} bytes");
    vec![
        ("body before login", bytes(BODY_BYTES_MAX_BEFORE_LOGIN)),
        ("fragment payload, largest and default", bytes(FRAGMENT_BYTES_MAX)),
        ("fragment payload, smallest that may be proposed", bytes(FRAGMENT_BYTES_MIN)),
        ("message, largest and default", bytes(MESSAGE_BYTES_MAX)),
        ("unfinished messages of one connection together", bytes(UNFINISHED_BYTES_MAX)),
        ("string", bytes(TEXT_BYTES_MAX)),
        ("path", bytes(PATH_BYTES_MAX)),
        ("properties, as a variant", bytes(PROPERTIES_BYTES_MAX)),
        ("properties, as JSON", bytes(PROPERTIES_JSON_BYTES_MAX)),
        ("value of a variable, in either form", bytes(VALUE_BYTES_MAX)),
        ("variables of a database", DATABASE_KEYS_MAX.to_string()),
        ("keys and values of a database together", bytes(DATABASE_BYTES_MAX)),
        (
            "databases of an account that were created by name or saved",
            DATABASES_PER_ACCOUNT_MAX.to_string(),
        ),
        ("watches of a flow", WATCHES_PER_FLOW_MAX.to_string()),
        ("changes of a flow that wait for the disk", UNSAVED_PER_FLOW_MAX.to_string()),
        ("what they hold together", bytes(UNSAVED_BYTES_PER_FLOW_MAX)),
        ("downloads under way on one connection", BLOB_READS_PER_CONNECTION_MAX.to_string()),
        (
            "bytes of uploads of one connection that wait for the disk",
            format!("{BLOB_BYTES_AHEAD_MAX} bytes"),
        ),
        (
            "requests of one connection that wait for the disk of blobs",
            BLOB_REQUESTS_PER_CONNECTION_MAX.to_string(),
        ),
        ("channels of a hub", CHANNELS_MAX.to_string()),
        ("of them only for the hub, the lowest identifiers", CHANNELS_RESERVED_FOR_HUB.to_string()),
        ("channels of a flow", CHANNELS_PER_FLOW_MAX.to_string()),
        ("subscriptions of a flow", SUBSCRIPTIONS_PER_FLOW_MAX.to_string()),
        ("depth of a subscription, default", SUBSCRIPTION_DEPTH_DEFAULT.to_string()),
        ("depth of a subscription, largest", SUBSCRIPTION_DEPTH_MAX.to_string()),
        ("open requests of one connection", REQUESTS_PER_ASKER_MAX.to_string()),
        ("open requests to the services of one owner", REQUESTS_PER_OWNER_MAX.to_string()),
        ("deadline of a request, default", format!("{DEADLINE_DEFAULT:?}")),
        ("deadline of a request, largest", format!("{DEADLINE_MAX:?}")),
        ("channels that repeat one another in a row", REPLICA_LEVELS_MAX.to_string()),
        ("waiting for one connection, and kept of its channels", bytes(CONNECTION_BYTES_MAX)),
        ("waiting for all, kept and held, shared payloads once", bytes(HUB_BYTES_MAX)),
        ("of that, held of unfinished messages", bytes(UNFINISHED_BYTES_MAX_IN_ALL)),
        ("of that, kept", bytes(KEPT_BYTES_MAX)),
        (
            "credit of a reliable channel beyond what its slowest subscriber took",
            format!("{CREDIT_BYTES} bytes"),
        ),
        ("waiting control frames of one connection", bytes(CONTROL_BYTES_MAX)),
        ("connections of one account, but for the owner's", CONNECTIONS_PER_ACCOUNT_MAX.to_string()),
        ("connections of one address at once", CONNECTIONS_PER_ADDRESS_BURST.to_string()),
        ("and then each second", CONNECTIONS_PER_ADDRESS_PER_SECOND.to_string()),
        ("from opening to login", format!("{LOGIN_TIME_MAX:?}")),
        ("silence before a ping", format!("{PING_AFTER:?}")),
        ("silence before the end", format!("{SILENCE_MAX:?}")),
        ("a frame from its first byte to its last", format!("{FRAME_TIME_MAX:?}")),
    ]
}

#[test]
fn the_golden_vectors_are_what_this_build_writes() {
    let path = docs("flow-vectors.txt");
    let mut made = String::from(
        "# Golden vectors of the flow protocol: a name, a space, bytes in hexadecimal.\n\
         # Names begin with command., event., variant. or login. See flow-protocol.md.\n",
    );
    let mut names = BTreeSet::new();
    for (name, bytes) in vectors() {
        assert!(names.insert(name.clone()), "{name} stands twice");
        let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let _ = writeln!(made, "{name} {hex}");
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    compare_or_rewrite(&path, &found, &made);
}

#[test]
fn the_fuzz_dictionary_has_the_header_of_every_kind() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/dictionaries/flow_frame.dict");
    let mut made = String::from(
        "# Headers of the flow protocol, for libFuzzer: -dict=fuzz/dictionaries/flow_frame.dict\n",
    );
    let mut seen = BTreeSet::new();
    for (name, bytes) in vectors() {
        if (name.starts_with("command.") || name.starts_with("event.")) && seen.insert(bytes[0]) {
            let hex: String = bytes[..6].iter().map(|byte| format!("\\x{byte:02x}")).collect();
            let _ = writeln!(made, "{}=\"{hex}\"", name.replace('.', "_"));
        }
    }
    compare_or_rewrite(&path, &fs::read_to_string(&path).unwrap_or_default(), &made);
}

#[test]
fn the_fuzz_dictionary_of_blobs_has_their_commands_whole_and_what_paths_are_made_of() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/dictionaries/blob_commands.dict");
    let mut made = String::from(
        "# Commands of blob channels, for libFuzzer: -dict=fuzz/dictionaries/blob_commands.dict\n",
    );
    let mut line = |name: &str, bytes: &[u8]| {
        let hex: String = bytes.iter().map(|byte| format!("\\x{byte:02x}")).collect();
        let _ = writeln!(made, "{name}=\"{hex}\"");
    };
    for (name, bytes) in vectors() {
        if name.starts_with("command.") && name.contains("blob_") {
            line(&name.replace('.', "_"), &bytes);
            line(&format!("{}_head", name.replace('.', "_")), &bytes[..6]);
        }
    }
    for (name, part) in
        [("here", "."), ("up", "../"), ("root", "/"), ("part", "a/"), ("null", "\0"), ("back", "\\")]
    {
        line(&format!("path_{name}"), part.as_bytes());
    }
    compare_or_rewrite(&path, &fs::read_to_string(&path).unwrap_or_default(), &made);
}

/// What Python satellites know of the protocol is made from the same table.
#[test]
fn the_python_table_is_the_same_table() {
    let path = docs("../python/pysketch/src/pysketch/table.py");
    let mut made = String::from(
        "# Made from the hub's command table by its tests; do not edit by hand.\n\
         \"\"\"What the flow protocol's commands, events and codes are: names, numbers and layouts.\"\"\"\n",
    );
    for (title, table) in [("COMMANDS", Command::TABLE), ("EVENTS", Event::TABLE)] {
        let _ = write!(
            made,
            "\n# name: (kind, comes in fragments, states, fields after the tag as (name, type))\n{title} = {{\n"
        );
        for line in table {
            python_line(&mut made, line);
        }
        made.push_str("}\n");
    }
    python_numbers(
        &mut made,
        "REFUSALS",
        RefusalCode::ALL.iter().map(|(code, name, _)| (code.code(), *name)),
    );
    python_numbers(
        &mut made,
        "CLOSINGS",
        ClosingReason::ALL.iter().map(|(code, name, _)| (code.code(), *name)),
    );
    python_numbers(&mut made, "DROPS", DropReason::ALL.iter().map(|(code, name, _)| (*code as u16, *name)));
    python_numbers(&mut made, "KINDS", ChannelKind::ALL.iter().map(|(kind, name, _)| (*kind as u16, *name)));
    python_numbers(
        &mut made,
        "POLICIES",
        Policy::ALL.iter().map(|(policy, name, _)| (*policy as u16, *name)),
    );
    let _ = write!(
        made,
        "\nMAGIC = b\"{}\"\nVERSION = {VERSION}\nVERSION_OLDEST = {VERSION_OLDEST}\n\
         FRAGMENT_BYTES_MAX = {FRAGMENT_BYTES_MAX}\nMESSAGE_BYTES_MAX = {MESSAGE_BYTES_MAX}\n\
         CONNECTION_BYTES_MAX = {CONNECTION_BYTES_MAX}\nDEPTH_MAX = {SUBSCRIPTION_DEPTH_MAX}\n\
         PING_AFTER_S = {}\nSILENCE_MAX_S = {}\nLOGIN_TIME_MAX_S = {}\n",
        String::from_utf8_lossy(&MAGIC),
        PING_AFTER.as_secs_f64(),
        SILENCE_MAX.as_secs_f64(),
        LOGIN_TIME_MAX.as_secs_f64(),
    );
    compare_or_rewrite(&path, &fs::read_to_string(&path).unwrap_or_default(), &made);
}

fn python_line(out: &mut String, line: &Definition) {
    let (name, id, fragment) = (line.name, line.id, if line.fragment { "True" } else { "False" });
    let states: String = line.states.iter().map(|state| format!("\"{state}\", ")).collect();
    let fields: Vec<String> = line
        .fields
        .iter()
        .map(|field| format!("(\"{}\", \"{}\")", field.name, field.wire))
        .collect();
    let _ = write!(out, "    \"{name}\": ({id:#04x}, {fragment}, ({}), (", states.trim_end());
    match fields.len() {
        0 => out.push_str(")),\n"),
        _ => {
            let _ = write!(out, "\n        {},\n    )),\n", fields.join(",\n        "));
        }
    }
}

fn python_numbers(out: &mut String, title: &str, rows: impl Iterator<Item = (u16, &'static str)>) {
    let _ = write!(out, "\n{title} = {{\n");
    for (number, name) in rows {
        let _ = writeln!(out, "    {number}: \"{name}\",");
    }
    out.push_str("}\n");
}

#[test]
fn every_kind_has_a_vector_that_reads_back() {
    let mut seen = BTreeSet::new();
    for (name, bytes) in vectors() {
        if !name.starts_with("command.") && !name.starts_with("event.") {
            continue;
        }
        let header = Header::parse(&bytes).expect("a header");
        assert_eq!(header.length as usize + 6, bytes.len(), "{name}");
        let body = Bytes::from(bytes.clone()).slice(6..);
        let again = if name.starts_with("command.") {
            let read = Command::decode(header, body, Bytes::new()).expect("a command");
            read.message.encode(read.tag, read.flags)
        } else {
            let read = Event::decode(header, body, Bytes::new()).expect("an event");
            read.message.encode(read.tag, read.flags)
        };
        assert_eq!(again.to_vec(), bytes, "{name}");
        seen.insert(header.kind);
    }
    let table: BTreeSet<u8> = Command::TABLE.iter().chain(Event::TABLE).map(|line| line.id).collect();
    assert_eq!(seen, table);
}

fn token() -> OwnerToken {
    OwnerToken::new(std::array::from_fn(|index| index as u8))
}

fn vectors() -> Vec<(String, Vec<u8>)> {
    let mut vectors = Vec::new();
    let commands = samples::commands(token().client_proof(&CLIENT_NONCE, &HUB_NONCE)).expect("small");
    for (tag, command) in commands.iter().enumerate() {
        add(&mut vectors, "command", tag as u32 + 1, command);
    }
    for event in samples::events(token().hub_proof(&CLIENT_NONCE, &HUB_NONCE)).expect("small") {
        add(&mut vectors, "event", 7, &event);
    }
    let json = |value: Value| value.in_form(Form::Json);
    let set = Command::VarSet { key: "gain.p".into(), value: json(Value::new(&1.5.into()).expect("small")) };
    vectors.push(("command.var_set.json".into(), set.encode(7, Flags::NONE).to_vec()));
    let properties = samples::properties().expect("small").in_form(Form::Json);
    let create = Command::CreateStream { name: "imu".into(), properties: properties.clone() };
    vectors.push(("command.create_stream.json".into(), create.encode(7, Flags::NONE).to_vec()));
    let changed = Event::HeaderChanged { channel: CHANNEL, properties };
    vectors.push(("event.header_changed.json".into(), changed.encode(7, Flags::NONE).to_vec()));
    let payload = Bytes::from_static(samples::PAYLOAD);
    for (name, flags) in fragments() {
        let payload = if flags == Flags::ABORT { Bytes::new() } else { payload.clone() };
        let publish = Command::Publish { channel: CHANNEL, message: 9, payload: payload.clone() };
        vectors.push((format!("command.publish.{name}"), publish.encode(0, flags).to_vec()));
        let data = Event::Data { channel: CHANNEL, message: 9, payload };
        vectors.push((format!("event.data.{name}"), data.encode(0, flags).to_vec()));
    }
    for (code, name, _) in RefusalCode::ALL {
        let event = Event::Refused { code: code.code(), text: code.to_string() };
        vectors.push((format!("event.refused.{name}"), event.encode(7, Flags::NONE).to_vec()));
    }
    for (reason, name, _) in ClosingReason::ALL {
        let event = Event::Closing { reason: reason.code(), text: reason.to_string() };
        vectors.push((format!("event.closing.{name}"), event.encode(0, Flags::NONE).to_vec()));
    }
    for (reason, name, _) in DropReason::ALL {
        let event = Event::Dropped { channel: CHANNEL, reason: reason as u8, total: 3 };
        vectors.push((format!("event.dropped.{name}"), event.encode(0, Flags::NONE).to_vec()));
    }
    for (name, variant) in variants() {
        vectors.push((format!("variant.{name}"), variant.encode().expect("small")));
    }
    vectors.push(("login.token".into(), (0..32).collect()));
    vectors.push(("login.client_nonce".into(), CLIENT_NONCE.to_vec()));
    vectors.push(("login.hub_nonce".into(), HUB_NONCE.to_vec()));
    vectors.push(("login.client_proof".into(), token().client_proof(&CLIENT_NONCE, &HUB_NONCE).to_vec()));
    vectors.push(("login.hub_proof".into(), token().hub_proof(&CLIENT_NONCE, &HUB_NONCE).to_vec()));
    vectors
}

/// Kinds that travel in fragments stand here as a message of one.
fn add<M: Message>(vectors: &mut Vec<(String, Vec<u8>)>, side: &str, tag: u32, message: &M) {
    let line = message.definition();
    let flags = if line.fragment { Flags::WHOLE } else { Flags::NONE };
    vectors.push((format!("{side}.{}", line.name), message.encode(tag, flags).to_vec()));
}

fn fragments() -> [(&'static str, Flags); 5] {
    [
        ("whole", Flags::WHOLE),
        ("first", Flags::FIRST),
        ("middle", Flags::NONE),
        ("last", Flags::LAST),
        ("abort", Flags::ABORT),
    ]
}

fn variants() -> Vec<(&'static str, SkVariant)> {
    assert_ne!(token().client_proof(&CLIENT_NONCE, &HUB_NONCE), NO_PROOF);
    vec![
        ("null", SkVariant::Null),
        ("bool", SkVariant::Bool(true)),
        ("i8", SkVariant::I8(-1)),
        ("i16", SkVariant::I16(-2)),
        ("i32", SkVariant::I32(-3)),
        ("i64", SkVariant::I64(-4)),
        ("u8", SkVariant::U8(1)),
        ("u16", SkVariant::U16(2)),
        ("u32", SkVariant::U32(3)),
        ("u64", SkVariant::U64(4)),
        ("f32", SkVariant::F32(1.5)),
        ("f64", SkVariant::F64(-0.25)),
        ("string", SkVariant::from("pulse")),
        ("bytes", SkVariant::Bytes(std::sync::Arc::new(Bytes::from_static(&[0, 255])))),
        ("list", SkVariant::list([1_u8, 2])),
        ("map", SkVariant::map([("a", SkVariant::Null), ("b", SkVariant::Bool(false))])),
    ]
}
