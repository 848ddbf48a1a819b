//! Who calls, as the door found out, and which sessions are its business.

use std::sync::Arc;

use kerf_session::{Owner, Registry, Session, SessionId};
use tonic::Extensions;
use tracing::Span;

use super::roles::Role;
use crate::status::RequestError;

/// Who calls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caller {
    /// Of its token; `None` where the server asks for none.
    name: Option<Arc<str>>,
    role: Role,
    /// The one session that its token is good for.
    session: Option<SessionId>,
}

impl Caller {
    /// Anybody, on a server that asks for no tokens.
    pub fn anybody() -> Self {
        Self { name: None, role: Role::Operator, session: None }
    }

    /// Who has a token.
    pub fn of_token(name: &str, role: Role, session: Option<SessionId>) -> Self {
        Self { name: Some(name.into()), role, session }
    }

    /// Who the door let in. A call that did not come through it is nobody's.
    pub fn of(extensions: &Extensions) -> Result<Self, RequestError> {
        extensions.get().cloned().ok_or(RequestError::TokenMissing)
    }

    /// The name of its token.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Its role.
    pub fn role(&self) -> Role {
        self.role
    }

    /// Whether it is to know of a session. One that a token names is its business, private or not.
    pub fn knows(&self, session: &Session) -> bool {
        self.knows_of(session.id(), session.owner())
    }

    /// The same of one that is somebody's, or nobody's.
    fn knows_of(&self, session: SessionId, owner: Option<&Owner>) -> bool {
        match self.session {
            Some(own) => own == session,
            None => {
                self.role == Role::Operator
                    || owner.is_none_or(|owner| !owner.is_private || self.name() == Some(&owner.name))
            }
        }
    }

    /// The session of this id, if the caller is to know of it: there is none otherwise.
    pub fn session(&self, registry: &Registry, id: &str) -> Result<Arc<Session>, RequestError> {
        let session = registry.get_if(id, |session, owner| self.knows_of(session, owner))?;
        session.note_in(&Span::current());
        Ok(session)
    }

    /// Ends in an error unless it may end a session that it knows of.
    pub fn check_end(&self, session: &Session) -> Result<(), RequestError> {
        let is_own = session.owner().is_some_and(|owner| self.name() == Some(&owner.name));
        match self.role == Role::Operator || is_own {
            true => Ok(()),
            false => Err(RequestError::NotOwner { session: session.id().to_string() }),
        }
    }

    /// Whose a session is that it creates.
    pub fn owner(&self, is_private: bool) -> Result<Option<Owner>, RequestError> {
        if let Some(session) = self.session {
            return Err(RequestError::OfOneSession { session: session.to_string() });
        }
        match (self.name(), is_private) {
            (Some(name), is_private) => Ok(Some(Owner { name: name.into(), is_private })),
            (None, false) => Ok(None),
            (None, true) => Err(RequestError::NobodysOwn),
        }
    }
}
