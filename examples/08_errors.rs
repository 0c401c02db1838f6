//! Slots that may fail; a slot that panics; which object it was.
use sk_core::prelude::*;

#[derive(Debug)]
enum LidarError {
    Unplugged,
    BadChecksum(u8),
}
impl std::fmt::Display for LidarError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LidarError::Unplugged => f.write_str("the cable is out"),
            LidarError::BadChecksum(b) => write!(f, "bad checksum {b:#x}"),
        }
    }
}

#[derive(Default)]
struct Lidar {
    scans: u32,
    scan: Signal<Vec<u16>>,
}
impl Lidar {
    fn line(&mut self) -> Result<Vec<u16>, LidarError> {
        self.scans += 1;
        match self.scans {
            1 => Err(LidarError::BadChecksum(0x5a)),
            3 => Err(LidarError::Unplugged),
            n => Ok(vec![n as u16]),
        }
    }
    fn on_tick(&mut self, cx: &mut Cx) -> Result<(), LidarError> {
        let points = self.line()?; // early return, logged with object and slot
        self.scan.emit(cx, points);
        Ok(())
    }
}
object! { Lidar { signals { scan(&Vec<u16>) } slots { on_tick() } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let lidar = cx.named("lidar").spawn(Lidar::default());

    attach!(cx, cx.fast_zone().pulse => lidar.on_tick);
    for _ in 0..4 {
        app.pulse()
    }
    println!("{} failures", app.cx().counters().failures);
}
