//! The program that is built: objects with a signal and two slots each, and links from each to the next ones.

use sk_benches::BenchError;
use std::fmt::Write;
use std::path::Path;

/// Where this package lies, and with it the workspace.
const HERE: &str = env!("CARGO_MANIFEST_DIR");

/// Writes the package of the program into `folder`.
pub(crate) fn write(folder: &Path, objects: usize, links: usize) -> Result<(), BenchError> {
    std::fs::create_dir_all(folder.join("src"))?;
    let core = Path::new(HERE).join("../sk-core");
    std::fs::write(folder.join("Cargo.toml"), manifest(&core))?;
    // The versions of the workspace, so that nothing else is measured on another day.
    std::fs::copy(Path::new(HERE).join("../Cargo.lock"), folder.join("Cargo.lock"))?;
    Ok(std::fs::write(folder.join("src/main.rs"), source(objects, links))?)
}

/// Makes cargo take the program for changed.
pub(crate) fn touch(folder: &Path) -> Result<(), BenchError> {
    let file = folder.join("src/main.rs");
    let source = std::fs::read_to_string(&file)?;
    Ok(std::fs::write(file, source + "// changed\n")?)
}

fn manifest(core: &Path) -> String {
    format!(
        "[package]\nname = \"generated\"\nversion = \"0.0.0\"\nedition = \"2024\"\npublish = false\n\n\
         [dependencies]\nsk_core = {{ package = \"specialk-core\", path = {core:?} }}\n\n[workspace]\n"
    )
}

fn source(objects: usize, links: usize) -> String {
    let mut text = String::from("use sk_core::prelude::*;\n");
    for n in 0..objects {
        // Writing to a string does not fail.
        let _ = write!(
            text,
            "\n#[derive(Default)]\nstruct Part{n} {{ sum: i64, changed: Signal<i64> }}\nimpl Part{n} {{\n    \
             fn add(&mut self, cx: &mut Cx, number: i64) {{ self.sum += number; if self.sum % {m} == 0 \
             {{ self.changed.emit(cx, self.sum) }} }}\n    \
             fn clear(&mut self, _cx: &mut Cx, _number: i64) {{ self.sum = 0 }}\n}}\n\
             object! {{ Part{n} {{ signals {{ changed(i64) }} slots {{ add(i64) clear(i64) }} }} }}\n",
            m = n + 2
        );
    }
    text.push_str("\nfn main() {\n    let mut app = SkApp::new();\n    let cx = app.cx();\n");
    for n in 0..objects {
        let _ = writeln!(text, "    let part{n} = cx.spawn(Part{n}::default());");
    }
    for link in 0..links {
        let (from, to) = (link % objects, (link + 1 + link / objects) % objects);
        let slot = if link / objects == 1 { "clear" } else { "add" };
        let mode = if link / objects == 2 { ", Queued" } else { "" };
        let _ = writeln!(text, "    attach!(cx, part{from}.changed => part{to}.{slot}{mode});");
    }
    text.push_str("    app.pulse();\n}\n");
    text
}
