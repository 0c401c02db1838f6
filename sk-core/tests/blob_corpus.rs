//! The committed seeds of the fuzz target `blob_commands`, run through the same property as plain tests.

mod seeds;

#[path = "../../fuzz/properties/blobs.rs"]
mod blobs;

#[test]
fn t12_files_stay_where_and_whose_they_are_whatever_the_seeds_hold_cut_short_or_with_a_bit_turned() {
    let trial = seeds::Trial {
        target: "blob_commands",
        seeds_min: 20,
        cut_step: 3,
        cut_bytes_max: usize::MAX,
        turned_bytes_max: 60,
    };
    trial.run(blobs::commands);
}
