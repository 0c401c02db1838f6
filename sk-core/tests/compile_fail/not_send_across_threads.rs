use sk_core::prelude::*;

#[derive(Default)]
struct Source {
    shared: Signal<Rc<str>>,
}
impl Source {
    fn take(&mut self, _cx: &mut Cx, _text: Rc<str>) {}
}
object! { Source { signals { shared(Rc<str>) } slots { take(Rc<str>) } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let source = cx.spawn(Source::default());
    attach!(cx, source.shared => cx.remote(source).take, Queued);
}
