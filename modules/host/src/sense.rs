//! What a sense is, and the table of all of them.

use crate::{Cpu, Disk, Frequency, Kernel, Load, Memory, Network, Power, SenseError, Temperature, Uptime};
use sk_flat::{Instant, IntoVariant, SkVariant};
use std::time::Duration;

/// A part of a reading: where it stands, its unit and its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Its place in the map: keys joined by points; `*` stands for the name of a device, `[]` for the items of
    /// a list.
    pub key: &'static str,
    /// Its unit; `1` for shares and plain counts, empty for texts and truths.
    pub unit: &'static str,
    /// What it means.
    pub doc: &'static str,
}

/// What a channel needs to know of a sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct About {
    /// The name of its channel.
    pub name: &'static str,
    /// One line for people.
    pub doc: &'static str,
    /// How often it is worth reading unless somebody asks for something else.
    pub period: Duration,
    /// The parts of a reading.
    pub parts: &'static [Part],
}

impl About {
    /// The units of the parts as a map from key to unit, for the properties of a channel. Texts and truths
    /// have none and are left out.
    pub fn units(&self) -> SkVariant {
        let with_unit = self.parts.iter().filter(|part| !part.unit.is_empty());
        SkVariant::map(with_unit.map(|part| (part.key, part.unit.into())))
    }
}

/// One sense of the machine, as a type.
///
/// A reader keeps the previous counters where a reading is a rate and never reads a clock: the present is
/// handed in.
///
/// ```
/// use sk_flat::Instant;
/// use sk_host::{Kernel, Sense, Uptime};
///
/// let uptime = Uptime::default().read(&Kernel::default(), Instant::ZERO)?;
/// assert!(uptime.is_some_and(|uptime| uptime.seconds > 0.0));
/// # Ok::<(), sk_host::SenseError>(())
/// ```
pub trait Sense {
    /// What is read; as a variant it is a map with the keys of [`About::parts`].
    type Reading: IntoVariant;

    /// The name, the units and the meaning.
    const ABOUT: About;

    /// Reads the sense at `now`. `None` means that there is nothing to say yet: a rate needs two readings at
    /// different times.
    ///
    /// # Errors
    /// The file that the sense stands on cannot be read or understood.
    fn read(&mut self, kernel: &Kernel, now: Instant) -> Result<Option<Self::Reading>, SenseError>;

    /// Forgets the previous reading. To be called when reading pauses: a rate over the whole pause would say
    /// nothing about the present.
    fn forget(&mut self) {}

    /// Whether this machine has the sense at all.
    fn is_present(&self, kernel: &Kernel) -> bool;
}

/// A sense whose type is forgotten, so that a list can hold all of them.
pub trait AnySense {
    /// The name, the units and the meaning.
    fn about(&self) -> &'static About;

    /// [`Sense::read`], with the reading as a variant.
    ///
    /// # Errors
    /// Those of [`Sense::read`].
    fn read_variant(&mut self, kernel: &Kernel, now: Instant) -> Result<Option<SkVariant>, SenseError>;

    /// [`Sense::forget`].
    fn forget(&mut self);

    /// [`Sense::is_present`].
    fn is_present(&self, kernel: &Kernel) -> bool;
}

impl<T: Sense> AnySense for T {
    fn about(&self) -> &'static About {
        &T::ABOUT
    }

    fn read_variant(&mut self, kernel: &Kernel, now: Instant) -> Result<Option<SkVariant>, SenseError> {
        Ok(self.read(kernel, now)?.map(IntoVariant::into_variant))
    }

    fn forget(&mut self) {
        Sense::forget(self);
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        Sense::is_present(self, kernel)
    }
}

/// All senses, each as new: whether the machine has it is a question to ask of each.
///
/// ```
/// use sk_flat::Instant;
/// use sk_host::Kernel;
///
/// let kernel = Kernel::default();
/// for mut sense in sk_host::senses() {
///     if sense.is_present(&kernel) {
///         let reading = sense.read_variant(&kernel, Instant::ZERO)?;
///         println!("{}: {reading:?}", sense.about().name);
///     }
/// }
/// # Ok::<(), sk_host::SenseError>(())
/// ```
pub fn senses() -> Vec<Box<dyn AnySense>> {
    vec![
        Box::new(Cpu::default()),
        Box::new(Frequency::default()),
        Box::new(Memory::default()),
        Box::new(Load::default()),
        Box::new(Temperature::default()),
        Box::new(Network::default()),
        Box::new(Disk::default()),
        Box::new(Uptime::default()),
        Box::new(Power::default()),
    ]
}
