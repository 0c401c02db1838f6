//! A listener together with the layer that its connections begin with.

use crate::world::{Endpoint, Listener, Stream, Token};
use sk_flat::Instant;
use std::io;
use std::rc::Rc;
use std::time::Duration;

/// Puts a layer over a connection that was accepted.
pub(crate) type Wrap = Rc<dyn Fn(Box<dyn Stream>) -> io::Result<Box<dyn Stream>>>;

/// Where connections come in.
pub(crate) struct Door {
    listener: Box<dyn Listener>,
    wrap: Option<Wrap>,
}

impl Door {
    pub(crate) fn new(listener: Box<dyn Listener>, wrap: Option<Wrap>) -> Door {
        Door { listener, wrap }
    }

    /// Where it listens, with the port that was chosen.
    pub(crate) fn local(&self) -> Endpoint {
        self.listener.local()
    }

    /// As [`Listener::accept`].
    pub(crate) fn accept(&mut self, token: Token) -> io::Result<Box<dyn Stream>> {
        let stream = self.listener.accept(token)?;
        match &self.wrap {
            // That no layer could be put over this connection says nothing of the next.
            Some(wrap) => {
                wrap(stream).map_err(|error| io::Error::new(io::ErrorKind::ConnectionAborted, error))
            }
            None => Ok(stream),
        }
    }
}

/// After so long without a shortage the next one is another one.
const SHORTAGE_IS_OVER_AFTER: Duration = Duration::from_secs(60);

/// A time in which connections cannot be taken in, because no descriptors are left.
#[derive(Debug, Default)]
pub(crate) struct Shortage {
    felt: Option<Instant>,
}

impl Shortage {
    /// Notes that a connection could not be taken in. Answers whether that is news.
    pub(crate) fn is_news(&mut self, now: Instant) -> bool {
        let before = self.felt.replace(now);
        before.is_none_or(|before| now.since(before) >= SHORTAGE_IS_OVER_AFTER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shortage_is_told_once_however_often_it_is_felt() {
        let mut shortage = Shortage::default();
        let at = |seconds| Instant::ZERO + Duration::from_secs(seconds);
        let told: Vec<u64> = (0..200).filter(|second| shortage.is_news(at(*second))).collect();
        assert_eq!(told, [0]);
        assert!(!shortage.is_news(at(258)) && shortage.is_news(at(318)));
    }
}
