use sk_flat::SkVariant;

#[derive(SkVariant)]
struct Twice {
    first: u8,
    #[variant(rename = "first")]
    second: u8,
}

#[derive(SkVariant)]
enum Cases {
    First,
    #[variant(rename = "First")]
    Second,
}

fn main() {}
