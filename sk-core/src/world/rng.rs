//! Randomness.

use crate::sys::random;

/// A source of random bytes: the kernel's in the real world, a seeded sequence in a simulated one.
pub trait Rng {
    /// Fills `bytes`.
    fn fill(&mut self, bytes: &mut [u8]);

    /// The next 64 random bits.
    fn next_u64(&mut self) -> u64 {
        let mut bytes = [0; 8];
        self.fill(&mut bytes);
        u64::from_le_bytes(bytes)
    }
}

/// The kernel's generator, fit for secrets. Nothing is kept between calls.
///
/// ```
/// use sk_core::world::{RealRng, Rng};
///
/// let mut rng = RealRng;
/// assert_ne!((rng.next_u64(), rng.next_u64()), (0, 0));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct RealRng;

impl Rng for RealRng {
    /// # Panics
    /// If the kernel has no generator at all (before Linux 3.17): going on with predictable secrets would
    /// be worse.
    fn fill(&mut self, bytes: &mut [u8]) {
        if let Err(error) = random::fill(bytes) {
            panic!("the kernel refuses randomness: {error}");
        }
    }
}

/// xoshiro256** seeded through SplitMix64: fast, well distributed, and repeating exactly for the same
/// seed and stream. Its output can be predicted from itself: **not for secrets**.
///
/// ```
/// use sk_core::world::{Rng, SimulatedRng};
///
/// let (mut one, mut same, mut other) =
///     (SimulatedRng::new(7, 0), SimulatedRng::new(7, 0), SimulatedRng::new(7, 1));
/// let first = one.next_u64();
/// assert_eq!(first, same.next_u64());
/// assert_ne!(first, other.next_u64());
/// ```
#[derive(Clone, Debug)]
pub struct SimulatedRng {
    state: [u64; 4],
}

impl SimulatedRng {
    /// The sequence number `stream` of `seed`; different streams have nothing to do with each other.
    pub fn new(seed: u64, stream: u64) -> SimulatedRng {
        let mut of_seed = seed;
        let mut mixed = split_mix(&mut of_seed) ^ stream.wrapping_mul(0xD605_BBB5_8C8A_BBFD);
        SimulatedRng { state: std::array::from_fn(|_| split_mix(&mut mixed)) }
    }

    /// A number below `limit`, 0 if that is 0. The bias is below `limit` / 2^64.
    pub fn below(&mut self, limit: u64) -> u64 {
        // The high half of the product is the draw scaled to the limit, and is below it.
        let scaled = (u128::from(self.next_u64()) * u128::from(limit)) >> 64;
        u64::try_from(scaled).unwrap_or(0)
    }
}

fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut mixed = *state;
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    mixed ^ (mixed >> 31)
}

impl Rng for SimulatedRng {
    fn fill(&mut self, bytes: &mut [u8]) {
        for chunk in bytes.chunks_mut(8) {
            chunk.copy_from_slice(&self.next_u64().to_le_bytes()[..chunk.len()]);
        }
    }

    fn next_u64(&mut self) -> u64 {
        let [a, b, c, d] = self.state;
        let result = b.wrapping_mul(5).rotate_left(7).wrapping_mul(9);
        let (c, d) = (c ^ a, d ^ b);
        self.state = [a ^ d, b ^ c, c ^ (b << 17), d.rotate_left(45)];
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first outputs of the reference implementation for the state 1, 2, 3, 4.
    #[test]
    fn xoshiro_gives_the_published_numbers() {
        let mut rng = SimulatedRng { state: [1, 2, 3, 4] };
        let first: [u64; 4] = std::array::from_fn(|_| rng.next_u64());
        assert_eq!(first, [11520, 0, 1_509_978_240, 1_215_971_899_390_074_240]);
    }

    /// The first output of the reference implementation for the state 0.
    #[test]
    fn split_mix_gives_the_published_number() {
        assert_eq!(split_mix(&mut 0), 0xE220_A839_7B1D_CDAF);
    }

    #[test]
    fn a_draw_below_a_limit_stays_below_it_and_reaches_each_value() {
        let mut rng = SimulatedRng::new(1, 0);
        let mut seen = [false; 5];
        for _ in 0..200 {
            seen[rng.below(5) as usize] = true;
        }
        assert_eq!((seen, rng.below(0)), ([true; 5], 0));
    }

    #[test]
    fn odd_lengths_are_filled_to_the_last_byte() {
        let (mut long, mut short) = ([0; 16], [0; 11]);
        SimulatedRng::new(3, 2).fill(&mut long);
        SimulatedRng::new(3, 2).fill(&mut short);
        assert_eq!(short, long[..11]);
        let mut real = [0; 300];
        RealRng.fill(&mut real);
        assert_ne!(real[292..], [0; 8], "one chance in 2^64");
    }
}
