//! Camera thread -> detector thread and display on the main loop; the newest frame wins.
use sk_core::prelude::*;
use std::sync::Arc;

#[derive(Clone)]
struct Frame {
    number: u64,
    pixels: Arc<[u8]>,
}

#[derive(Default)]
struct Camera {
    taken: u64,
    frame: Signal<Frame>,
}
impl Camera {
    fn grab(&mut self, cx: &mut Cx) {
        self.taken += 1;
        self.frame
            .emit(cx, Frame { number: self.taken, pixels: Arc::from(vec![self.taken as u8; 1 << 20]) });
    }
}
object! { Camera { signals { frame(&Frame) } slots { grab() } } }

#[derive(Default)]
struct Detector {
    found: Signal<(u64, u32)>,
}
impl Detector {
    fn look(&mut self, cx: &mut Cx, frame: &Frame) {
        std::thread::sleep(Duration::from_millis(15)); // slower than the camera
        self.found.emit(cx, (frame.number, frame.pixels[0] as u32));
    }
}
object! { Detector { signals { found(u64, u32) } slots { look(&Frame) } } }

#[derive(Default)]
struct Display {
    shown: u32,
}
impl Display {
    fn show(&mut self, _cx: &mut Cx, frame: &Frame) {
        self.shown += 1;
        let _ = frame.pixels.len();
    }
    fn mark(&mut self, cx: &mut Cx, frame: u64, box_: u32) {
        println!("frame {frame}: box {box_}, {} frames shown", self.shown);
        if frame > 60 {
            cx.quit()
        }
    }
}
object! { Display { signals {} slots { show(&Frame) mark(u64, u32) } } }

fn main() -> Result<(), ThreadError> {
    let mut app = SkApp::new();
    let cx = app.cx();
    let display = cx.spawn(Display::default());

    let vision = SkThread::new("vision").start(cx)?;
    let detector = vision.build(|cx| {
        let detector = cx.spawn(Detector::default());
        cx.remote(detector)
    })?;
    let grabber = SkThread::new("camera").interval(Duration::from_millis(5)).start(cx)?;
    let camera = grabber.build(|cx| {
        let camera = cx.spawn(Camera::default());
        attach!(cx, cx.fast_zone().pulse => camera.grab);
        cx.remote(camera)
    })?;

    attach!(cx, camera.frame => detector.look, Latest); // remote to remote
    attach!(cx, camera.frame => cx.remote(display).show, Latest); // remote to local
    attach!(cx, detector.found => cx.remote(display).mark, Queued);
    app.run();
    grabber.stop();
    vision.stop();
    Ok(())
}
