//! The network of a simulation, in the place of the system's.

use std::cell::RefCell;
use std::pin::Pin;

use tonic::transport::{Channel, Error};

/// A connection on its way.
pub type Dialled = Pin<Box<dyn Future<Output = Result<Channel, Error>> + Send>>;

/// What dials, whatever the server's address.
pub(crate) type Dial = Box<dyn Fn() -> Dialled>;

thread_local! {
    static NETWORK: RefCell<Option<Dial>> = const { RefCell::new(None) };
}

/// Links of this thread dial so from now on; `None`: over the system's network.
pub(crate) fn dial_by(dial: Option<Dial>) {
    NETWORK.with_borrow_mut(|network| *network = dial);
}

pub(super) fn dial() -> Option<Dialled> {
    NETWORK.with_borrow(|network| network.as_ref().map(|dial| dial()))
}
