//! What the hub needs to be built and to run.

use std::process::Command;

fn output(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().unwrap();
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn s16_the_program_needs_only_the_c_library() {
    let allowed =
        ["linux-vdso", "ld-linux", "libc.", "libm.", "libgcc_s.", "libpthread.", "libdl.", "librt."];
    for program in [env!("CARGO_BIN_EXE_skrobot"), env!("CARGO_BIN_EXE_sk")] {
        let needed = output("ldd", &[program]);
        assert!(needed.lines().count() > 1, "{needed}");
        let name =
            |line: &str| line.split_whitespace().next().unwrap().rsplit('/').next().unwrap().to_owned();
        let strangers: Vec<String> = needed
            .lines()
            .map(name)
            .filter(|library| !allowed.iter().any(|known| library.starts_with(known)))
            .collect();
        assert!(strangers.is_empty(), "{program} needs {strangers:?}");
    }
}

#[test]
fn s19_the_default_build_has_no_optional_module() {
    let tree =
        output(env!("CARGO"), &["tree", "--package", "skrobot", "--edges", "normal", "--prefix", "none"]);
    let names: Vec<&str> = tree.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.contains(&"specialk-core"), "{tree}");
    let heavy =
        ["opencv", "cpal", "portaudio", "fftw", "realfft", "vorbis", "ogg", "fltk", "tokio", "openssl-sys"];
    let found: Vec<&&str> = names.iter().filter(|name| heavy.contains(*name)).collect();
    assert!(found.is_empty(), "{found:?}");
}
