use sk_core::prelude::*;

struct Lamp;
object! { Lamp { slots { switch(bool) } } }

fn main() {}
