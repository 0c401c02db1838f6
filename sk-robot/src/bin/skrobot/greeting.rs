//! What the hub says when it is up.

use crate::keeper::Keeper;
use sk_core::flow::HubAddress;
use sk_core::module::ModuleState;
use sk_core::prelude::*;
use sk_robot::module_service;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Whoever started the hub may have closed its output: it runs on all the same.
pub fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    if let Err(error) = out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        tracing::warn!("standard output: {error}");
    }
}

/// What it listens on, what is pulsing and what to type next.
pub fn greeting(cx: &mut Cx, keeper: Handle<Keeper>) -> Result<String, Access> {
    let (server, modules, addresses, token) = cx.with(keeper, |keeper, _| {
        let hub = keeper.hub();
        (hub.server, hub.modules, hub.addresses().to_vec(), hub.places().token())
    })?;
    let (account, fingerprint) = cx.with(keeper, |keeper, _| {
        let hub = keeper.hub();
        (hub.config().hub.account.clone(), hub.fingerprint().map(str::to_owned))
    })?;
    let mut text = format!("skrobot {} is pulsing\n", env!("CARGO_PKG_VERSION"));
    let channels = server.channels(cx)?;
    // Writing to a string cannot fail.
    for address in &addresses {
        let how = match address {
            HubAddress::Unix(_) => "programs of this user come in as they are".to_owned(),
            HubAddress::Udp(_) => "for what satellites publish by datagrams".to_owned(),
            _ => format!("with the token in {}", token.display()),
        };
        let _ = writeln!(text, "  listens on  {address}  ({how})");
    }
    if let Some(fingerprint) = fingerprint {
        let _ = writeln!(text, "  shows       a certificate with the fingerprint {fingerprint}");
    }
    // The service of the modules is there always.
    let own = format!("{account}.{}", module_service::NAME);
    let names: Vec<&str> = channels
        .iter()
        .map(|(name, _)| name.as_str())
        .filter(|name| *name != own)
        .collect();
    let _ = writeln!(
        text,
        "  channels    {}",
        if names.is_empty() { "none yet".into() } else { names.join("  ") }
    );
    for module in modules.list(cx)? {
        if let ModuleState::Failed { reason, .. } = module.state {
            let _ = writeln!(text, "  left out    module {}: {reason}", module.name);
        }
    }
    let sk = tool();
    let first = names
        .iter()
        .find(|name| name.ends_with(".cpu"))
        .or(names.first())
        .copied()
        .unwrap_or("CHANNEL");
    let _ = writeln!(text, "  try         {sk} ls\n              {sk} echo {first}\n  stop        Ctrl-C");
    Ok(text)
}

/// How the tool is called from here: beside this program if it was built, else through cargo.
fn tool() -> String {
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.join("sk")));
    let Some(beside) = beside.filter(|path| path.exists()) else {
        return "cargo run --release --bin sk --".to_owned();
    };
    let on_path = std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join("sk") == beside));
    let here = std::env::current_dir().unwrap_or_default();
    let shown: &Path = beside.strip_prefix(&here).unwrap_or(&beside);
    if on_path { "sk".to_owned() } else { shown.display().to_string() }
}
