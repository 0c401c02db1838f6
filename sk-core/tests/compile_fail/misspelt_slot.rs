use sk_core::prelude::*;

#[derive(Default)]
struct Lamp {
    lit: Signal<bool>,
}
impl Lamp {
    fn switch(&mut self, _cx: &mut Cx, _on: bool) {}
    fn label(&mut self, _cx: &mut Cx, _text: &str) {}
    fn place(&mut self, _cx: &mut Cx, _x: f32, _y: f32) {}
}
object! { Lamp { signals { lit(bool) } slots { switch(bool) label(&str) place(f32, f32) } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let lamp = cx.spawn(Lamp::default());
    attach!(cx, lamp.lit => lamp.swich);
}
