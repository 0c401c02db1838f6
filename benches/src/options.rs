//! What every bench can be told on its command line.

/// Options that all benches share; a bench flattens them into its own.
///
/// ```
/// use clap::Parser;
/// use sk_benches::{Amount, Options};
///
/// #[derive(Parser)]
/// struct Mine { #[command(flatten)] shared: Options }
///
/// let mine = Mine::parse_from(["bench", "--smoke"]);
/// assert_eq!(mine.shared.runs(), 1);
/// assert_eq!(mine.shared.amount(), Amount::Smoke);
/// ```
#[derive(clap::Args, Clone, Debug)]
pub struct Options {
    /// Write one JSON object a line to the standard output; the table then goes to the standard error.
    #[arg(long)]
    pub json: bool,
    /// A tiny amount of work, once and without peers: shows that the bench runs and measures nothing.
    #[arg(long)]
    pub smoke: bool,
    /// How often every side is run; medians are over these.
    #[arg(long, default_value_t = 5, value_name = "N")]
    runs: usize,
    /// Leave the peers out.
    #[arg(long)]
    pub no_peers: bool,
    /// Only these sides: `ours` or the name of a peer. Can be given several times.
    #[arg(long, value_name = "NAME")]
    pub only: Vec<String>,
    /// The side this process plays; given by the bench when it starts itself anew.
    #[arg(long, hide = true, value_name = "NAME")]
    pub side: Option<String>,
    /// Given by `cargo bench` to everything it runs.
    #[arg(long, hide = true)]
    bench: bool,
}

/// How much work a measurement does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Amount {
    /// Enough for a figure to mean something.
    Full,
    /// Enough for the code to have run.
    Smoke,
}

impl Amount {
    /// The one or the other.
    pub fn pick<T>(self, full: T, smoke: T) -> T {
        match self {
            Amount::Full => full,
            Amount::Smoke => smoke,
        }
    }

    /// The word by which peers in other languages are told.
    pub fn word(self) -> &'static str {
        self.pick("full", "smoke")
    }
}

impl Options {
    /// How much work is to be done.
    pub fn amount(&self) -> Amount {
        if self.smoke { Amount::Smoke } else { Amount::Full }
    }

    /// How often every side is run: once at least, and once only in a smoke run.
    pub fn runs(&self) -> usize {
        if self.smoke { 1 } else { self.runs.max(1) }
    }

    /// Whether a side is to be run at all. `peer` is `None` for ours.
    pub fn wants(&self, peer: Option<&str>) -> bool {
        let left_out = (self.smoke || self.no_peers) && peer.is_some();
        let named = self.only.is_empty() || self.only.iter().any(|only| only == peer.unwrap_or("ours"));
        named && !left_out
    }
}
