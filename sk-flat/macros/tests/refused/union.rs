use sk_flat::SkVariant;

#[derive(SkVariant)]
union Overlaid {
    whole: u32,
    parts: [u8; 4],
}

fn main() {}
