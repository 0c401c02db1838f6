//! A listener together with the layer that its connections begin with.

use crate::world::{Endpoint, Listener, Stream, Token};
use std::io;
use std::rc::Rc;

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
