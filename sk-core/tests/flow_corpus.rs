//! The committed seeds of the fuzz target `flow_frame`, run through the same property as plain tests.

mod seeds;

#[path = "../../fuzz/properties/flow.rs"]
mod flow;

#[test]
fn both_sides_stand_whatever_the_seeds_hold_cut_short_or_with_a_bit_turned() {
    let trial = seeds::Trial {
        target: "flow_frame",
        seeds_min: 20,
        cut_step: 1,
        cut_bytes_max: usize::MAX,
        turned_bytes_max: 160,
    };
    trial.run(flow::frames);
}
