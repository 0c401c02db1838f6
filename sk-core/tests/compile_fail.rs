//! What must not compile does not, with an error at the user's line that says what to do.

#[test]
fn s40_a_handle_does_not_leave_its_thread() {
    trybuild::TestCases::new().compile_fail("tests/compile_fail/handle_*.rs");
}

#[test]
fn mistakes_are_errors_at_the_users_line() {
    trybuild::TestCases::new().compile_fail("tests/compile_fail/*.rs");
}
