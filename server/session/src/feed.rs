//! What a session's thread hands over to the one that shows it: the newest shot, of which nobody has seen anything yet.
//!
//! A shot that was not taken in time is taken back and goes on: what has changed in the structure since adds up in it,
//! where everything is is replaced. So whoever shows may be as slow as it likes: it misses states, never structure, and
//! nothing queues. Either side holds the lock for as long as it takes to exchange a box.

use std::sync::{Arc, Condvar, Mutex, PoisonError};

use kerf_physics::view::{Frame, Structure, StructureChange};

use crate::lock::lock;
use crate::view_message::ViewState;

/// What there is to show of a step.
#[derive(Default)]
pub(crate) struct Shot {
    /// What has happened to the structure since the shot before.
    pub structure: Option<News>,
    /// Where everything is.
    pub frame: Frame,
    /// Somebody waits for a keyframe.
    pub wants_keyframe: bool,
    /// The state, but for where the objects are.
    pub state: ViewState,
}

/// What has happened to the structure.
pub(crate) enum News {
    /// It is this: what was known of it before is of no use.
    Whole(Structure),
    /// It has changed.
    Change(StructureChange),
}

#[derive(Default)]
struct State {
    waiting: Option<Box<Shot>>,
    /// The room of one that was shown; two are in use at most.
    spare: Option<Box<Shot>>,
    /// What is known of the scene is to be forgotten, before a shot that waits.
    forgets: bool,
    has_ended: bool,
}

/// The exchange.
#[derive(Default)]
struct Exchange {
    state: Mutex<State>,
    bell: Condvar,
}

/// The session's end. Its end is the other's.
pub(crate) struct Feed(Arc<Exchange>);

/// The end of whoever shows.
pub(crate) struct Shots(Arc<Exchange>);

/// What comes next to whoever shows.
pub(crate) enum Next {
    /// Show this.
    Shot(Box<Shot>),
    /// Forget the scene: nobody views it, or it is another.
    Forget,
    /// The session has ended.
    End,
}

/// Both ends.
pub(crate) fn feed() -> (Feed, Shots) {
    let exchange = Arc::new(Exchange::default());
    (Feed(Arc::clone(&exchange)), Shots(exchange))
}

impl Feed {
    /// A shot to go on with: the one that nobody has taken yet, with what is in it, or one of which nothing but the room
    /// counts.
    pub fn take_back(&self) -> Box<Shot> {
        let mut state = lock(&self.0.state);
        if let Some(waiting) = state.waiting.take() {
            return waiting;
        }
        let spare = state.spare.take();
        drop(state);
        let mut shot = spare.unwrap_or_default();
        (shot.structure, shot.wants_keyframe) = (None, false);
        (shot.state.times, shot.state.is_hastened) = Default::default();
        shot
    }

    pub fn hand_over(&self, shot: Box<Shot>) {
        lock(&self.0.state).waiting = Some(shot);
        self.0.bell.notify_one();
    }

    /// What was handed over is of no use any more.
    pub fn forget(&self) {
        let mut state = lock(&self.0.state);
        state.waiting = None;
        state.forgets = true;
        drop(state);
        self.0.bell.notify_one();
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        lock(&self.0.state).has_ended = true;
        self.0.bell.notify_one();
    }
}

impl Shots {
    /// What comes next, if there is something.
    #[cfg(any(test, feature = "virtual-time"))]
    pub fn try_next(&self) -> Option<Next> {
        lock(&self.0.state).next()
    }

    /// Waits for what comes next.
    pub fn next(&self) -> Next {
        let mut state = lock(&self.0.state);
        loop {
            if let Some(next) = state.next() {
                return next;
            }
            state = self.0.bell.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Gives a shot back, whose room is used again.
    pub fn give_back(&self, shot: Box<Shot>) {
        lock(&self.0.state).spare = Some(shot);
    }
}

impl State {
    fn next(&mut self) -> Option<Next> {
        if self.has_ended {
            return Some(Next::End);
        }
        if std::mem::take(&mut self.forgets) {
            return Some(Next::Forget);
        }
        self.waiting.take().map(Next::Shot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shot_that_was_not_taken_is_gone_on_with_and_one_that_was_comes_back_empty() {
        let (feed, shots) = feed();
        let mut first = feed.take_back();
        (first.state.step, first.wants_keyframe) = (1, true);
        first.state.times.steps = 4;
        feed.hand_over(first);
        let again = feed.take_back();
        assert_eq!((again.state.step, again.wants_keyframe, again.state.times.steps), (1, true, 4));
        feed.hand_over(again);
        let Some(Next::Shot(shown)) = shots.try_next() else { panic!("it waits") };
        shots.give_back(shown);
        assert!(shots.try_next().is_none());
        let next = feed.take_back();
        assert_eq!((next.wants_keyframe, next.state.times.steps), (false, 0));
    }

    #[test]
    fn what_is_forgotten_is_not_shown_and_the_end_comes_before_all_else() {
        let (feed, shots) = feed();
        feed.hand_over(feed.take_back());
        feed.forget();
        feed.hand_over(feed.take_back());
        assert!(matches!(shots.next(), Next::Forget) && matches!(shots.next(), Next::Shot(_)));
        feed.hand_over(feed.take_back());
        drop(feed);
        assert!(matches!(shots.next(), Next::End));
    }
}
