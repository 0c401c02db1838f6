use sk_core::prelude::*;

struct Lamp;
impl Lamp {
    fn on_start(&mut self, _cx: &mut Cx) {}
}
object! { Lamp { hooks { on_start } } }

fn main() {}
