//! Sockets as objects, in the real and in the simulated world.

mod actors;
mod both_worlds;
mod scarce;
mod simulated_only;
