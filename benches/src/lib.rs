//! The instruments of the benches: how a measurement is run beside its peers, and how it is told.
//!
//! A bench compares *sides*: ours, and peers that do the same work. Every side of every run is a process of
//! its own, started in turn, so that a busy moment of the machine meets all sides and no side inherits the
//! heap or the scheduling of another. A side writes what it measured, line by line, in the form of
//! [`Sheet`]; peers in other languages write the same lines. The bench gathers them into a [`Report`]:
//! medians over the runs, the lowest and the highest, and our share of each peer's figure.
#![forbid(unsafe_code)]

mod chart;
mod limited;
mod options;
mod pace;
mod peers;
mod report;
mod run;
mod sheet;
mod spread;

pub use chart::{histogram_text, plot_svg};
pub use options::{Amount, Options};
pub use pace::ns_per_unit;
pub use peers::{folder as peers_folder, program as peer_program};
pub use report::{Figure, Report};
pub use run::{Bench, BenchError, Side};
pub use sheet::{Line, Sheet};
pub use spread::Spread;
