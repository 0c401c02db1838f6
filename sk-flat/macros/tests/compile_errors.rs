//! What the derive refuses, and where its message points.

#[test]
fn unsupported_types_and_attributes_are_refused_at_the_users_line() {
    trybuild::TestCases::new().compile_fail("tests/refused/*.rs");
}
