use sk_core::prelude::*;

struct Lamp;
impl Lamp {
    fn switch(&mut self, _cx: &mut Cx) -> u32 {
        5
    }
}
object! { Lamp { slots { switch() } } }

fn main() {}
