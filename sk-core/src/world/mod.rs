//! The world a loop lives in: everything that comes from outside, handed in as traits.
//!
//! Nothing else in the workspace asks the operating system for time, sockets, durable storage,
//! randomness or blocking work. Each trait has a real and a simulated implementation; with the
//! simulated ones a whole program, several loops included, runs on one thread under a virtual clock
//! and repeats exactly for the same seed.

pub mod clock;
pub mod net;
pub mod rng;
pub mod storage;
pub mod worker;

pub use clock::Clock;
pub use net::{Datagram, Endpoint, Listener, Net, Readiness, Stream, Token, Wake};
pub use rng::Rng;
pub use storage::{Storage, StoredFile};
pub use worker::{Job, Worker};
