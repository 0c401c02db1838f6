use sk_flat::SkVariant;

struct Foreign;

#[derive(SkVariant)]
struct Holder {
    foreign: Foreign,
}

fn main() {}
