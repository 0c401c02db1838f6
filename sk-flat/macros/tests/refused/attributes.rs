use sk_flat::SkVariant;

#[derive(SkVariant)]
struct Misspelt {
    #[variant(renamed = "x")]
    field: u8,
}

#[derive(SkVariant)]
struct Contradiction {
    #[variant(skip, default)]
    field: u8,
}

#[derive(SkVariant)]
struct Tuple(#[variant(skip)] u8, u8);

#[derive(SkVariant)]
#[variant(default)]
struct Whole {
    field: u8,
}

#[derive(SkVariant)]
enum Case {
    #[variant(skip)]
    Only,
}

fn main() {}
