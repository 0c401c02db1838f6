use sk_core::prelude::*;

struct Lamp;
impl Lamp {
    fn switch(&mut self, _cx: &mut Cx, _on: bool) {}
}
object! { Lamp { slots { switch(u32) } } }

fn main() {}
