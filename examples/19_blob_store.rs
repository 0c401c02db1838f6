//! A blob store: a map is uploaded to the hub, which keeps it; then it is downloaded as anybody may who may read it.
//!
//! xtask: run by `example_blob_store_keeps_a_map`
use bytes::Bytes;
use sk_core::{flow::SkFlowSat, prelude::*};
use sk_robot::places::Places;

struct Mapper {
    hub: Handle<SkFlowSat>,
    map: Vec<u8>,
}
impl Mapper {
    fn on_saved(&mut self, cx: &mut Cx, path: String) -> std::io::Result<()> {
        println!("{path} is on the hub's disk"); // and stays there when this program ends
        if path == "floors/1.txt" {
            let download = self.hub.download(cx, "robot.maps", &path)?;
            let this = cx.this(self);
            attach!(cx, download.data => this.on_data);
            attach!(cx, download.done => this.on_done);
        }
        Ok(())
    }
    fn on_data(&mut self, _cx: &mut Cx, bytes: &Bytes) {
        self.map.extend_from_slice(bytes);
    }
    fn on_done(&mut self, cx: &mut Cx) {
        println!("{}", String::from_utf8_lossy(&self.map));
        cx.quit();
    }
    fn on_refused(&mut self, _cx: &mut Cx, path: String, why: String) {
        println!("{path}: {why}"); // the folder may be there from an earlier run
    }
}
object! { Mapper { slots { on_saved(String) on_data(&Bytes) on_done() on_refused(String, String) } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    let maps = hub.blob(cx, "maps")?;
    let mapper = cx.spawn(Mapper { hub, map: Vec::new() });
    attach!(cx, maps.saved => mapper.on_saved);
    attach!(cx, maps.refused => mapper.on_refused);
    maps.make_dir(cx, "floors");
    maps.upload(cx, "floors/1.txt", "here be dragons");
    app.run();
    Ok(())
}
