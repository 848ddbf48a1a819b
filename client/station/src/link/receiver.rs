//! What comes from the server becomes updates for the servo.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use kerf_load::clock;
use kerf_proto::v1::{self, control_response::Message};

use super::estimates::{ClockOffset, RoundTrip};
use super::status::{LinkState, SharedStatus};
use super::wire;
use crate::servo::model::Update;

/// Round trip to reckon with before one was measured, s.
const UNKNOWN_ROUND_TRIP_S: f64 = 0.2;

/// Age from which no force is rendered where the server names none, s.
const UNKNOWN_MAX_AGE_S: f64 = 0.1;

/// What a message means for the stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// It goes on.
    Goes,
    /// The session ends.
    SessionCloses,
}

/// Takes messages. It lives longer than a stream: numbers go on rising.
pub(super) struct Receiver {
    updates: triple_buffer::Input<Update>,
    status: SharedStatus,
    round_trip: RoundTrip,
    clock_offset: ClockOffset,
    number: u64,
    /// Until then nothing is published: the scene was set back, and what the tool feels next is not what it felt.
    quiet_until_ns: u64,
    /// The tool that is kept out of tissue.
    waiting: Option<u32>,
    /// What the tissue is since a tool was in the scene last, where it is not as it was then.
    made_anew: Option<&'static str>,
    blend_s: f64,
    max_age_s: f64,
    received: Arc<AtomicU64>,
}

impl Receiver {
    pub(super) fn new(updates: triple_buffer::Input<Update>, status: SharedStatus) -> Self {
        Self {
            updates,
            status,
            round_trip: RoundTrip::default(),
            clock_offset: ClockOffset::default(),
            number: 0,
            quiet_until_ns: 0,
            waiting: None,
            made_anew: None,
            blend_s: 0.0,
            max_age_s: 0.0,
            received: Arc::default(),
        }
    }

    /// A stream begins; where its acknowledgements are kept.
    pub(super) fn begin(&mut self, hello: &v1::ServerHello) -> Arc<AtomicU64> {
        self.blend_s = 1.0 / hello.contact_rate_hz.max(1.0);
        let max_age_s = hello.limits.as_ref().map_or(0.0, |limits| limits.max_contact_age_s);
        self.max_age_s = if max_age_s > 0.0 { max_age_s } else { UNKNOWN_MAX_AGE_S };
        // Another server, another clock.
        self.clock_offset = ClockOffset::default();
        self.received = Arc::default();
        Arc::clone(&self.received)
    }

    pub(super) fn take(&mut self, message: Message) -> Result<Heard, wire::Missing> {
        match message {
            Message::Contact(contact) => self.contact(&contact)?,
            Message::Rejected(rejected) => self.status.change(|status| {
                status.rejected += 1;
                let v1::PoseRejected { tool_id, field, limit, .. } = rejected;
                status.fail(format!("a pose of tool {tool_id} was refused: {field}: {limit}"));
            }),
            Message::LeaseLost(lost) if lost.reason() == v1::LeaseLostReason::SessionClosing => {
                return Ok(Heard::SessionCloses);
            }
            // By a newer stream of this station: the older one is not read any more.
            Message::LeaseLost(lost) if lost.reason() == v1::LeaseLostReason::TakenOver => {}
            Message::LeaseLost(_) => self.fault("the lease ran out: poses came too seldom"),
            Message::Fault(fault) => {
                self.fault(&format!("the server rolled `{}` back", fault.object));
                self.is_made_anew("the server rolled the tissue back");
                self.fall_silent();
            }
            Message::CheckpointRestored(restored) => {
                self.fault(&format!("the session went back to checkpoint `{}`", restored.name));
                self.is_made_anew("the tissue is as it was at a checkpoint");
                self.fall_silent();
            }
            Message::Event(event) => self.event(&event),
            Message::ToleranceChanged(_) | Message::Hello(_) => {}
        }
        Ok(Heard::Goes)
    }

    fn contact(&mut self, contact: &v1::Contact) -> Result<(), wire::Missing> {
        let now_ns = clock::now_ns();
        self.received.fetch_max(contact.number, Ordering::Relaxed);
        let model = wire::model(contact)?;
        if contact.echo_seq > 0 {
            // Without the time that the pose was known to the server: a deadband keeps poses for as long as they are good.
            let known_ns = contact.server_ns.saturating_sub(contact.echo_arrived_ns);
            let round_trip_ns = now_ns.saturating_sub(contact.echo_ns).saturating_sub(known_ns);
            self.round_trip.measured(round_trip_ns as f64 * 1e-9);
            self.clock_offset.measured(now_ns, contact.server_ns, contact.echo_ns, contact.echo_arrived_ns);
        }
        self.number += 1;
        let offset_s = self.clock_offset.estimate_s();
        let waits = self.waits(contact);
        self.status.change(|status| {
            status.contacts += 1;
            status.go_well(Instant::now());
            status.waits = waits;
            status.round_trip_s = self.round_trip.mean_s();
            status.clock_offset_s = offset_s;
            let took_s = (now_ns as i64 - contact.server_ns as i64) as f64 * 1e-9;
            status.down_s = offset_s.map(|(offset_s, _)| took_s + offset_s);
        });
        if now_ns >= self.quiet_until_ns {
            self.updates.write(Update {
                number: self.number,
                tool_id: contact.tool_id,
                arrived_ns: now_ns,
                echo_ns: contact.echo_ns,
                model,
                // A contact without a model is of nothing touched: the force goes over a contact's time.
                blend_s: contact.model.as_ref().map_or(self.blend_s, |model| f64::from(model.blend_time_s)),
                round_trip_s: self.round_trip.bound_s().unwrap_or(UNKNOWN_ROUND_TRIP_S),
                max_age_s: self.max_age_s,
            });
        }
        Ok(())
    }

    fn event(&mut self, event: &v1::Event) {
        match event.kind() {
            v1::EventKind::Paused => self.status.change(|status| status.state = LinkState::Paused),
            v1::EventKind::Resumed => self.status.change(|status| status.state = LinkState::Connected),
            v1::EventKind::Reset => {
                self.fault("the session was reset");
                self.is_made_anew("the organ is whole again");
                self.fall_silent();
            }
            v1::EventKind::Overloaded => {
                self.fault(&format!("the server is too slow: {:.0} % of its steps are late", 100.0 * event.late_share));
            }
            _ => {}
        }
    }

    /// Long enough for the force to fade.
    fn fall_silent(&mut self) {
        self.quiet_until_ns = clock::now_ns() + (self.max_age_s * 1e9) as u64;
    }

    /// What the tissue is from now on, until a tool is in the scene again.
    pub(super) fn is_made_anew(&mut self, what: &'static str) {
        self.made_anew = Some(what);
    }

    /// Why the tool in hand feels nothing, if it is kept out of tissue, and what to do.
    fn waits(&mut self, contact: &v1::Contact) -> Option<String> {
        let has = |flag: v1::ContactFlag| contact.flags & flag as u32 != 0;
        if has(v1::ContactFlag::WaitsUntilClear) {
            self.waiting = Some(contact.tool_id);
        } else if self.waiting == Some(contact.tool_id) {
            self.waiting = None;
        }
        if !has(v1::ContactFlag::Lifted) {
            self.made_anew = None;
        }
        let made_anew = self.made_anew.map_or(String::new(), |what| format!("{what}: "));
        self.waiting.map(|_| format!("{made_anew}lift the tool clear of the tissue"))
    }

    fn fault(&self, what: &str) {
        self.status.change(|status| status.fail(what.to_owned()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_the_scene_was_set_back_nothing_is_felt_for_as_long_as_a_contact_may_be_old() {
        let reset = v1::Event { kind: v1::EventKind::Reset.into(), ..Default::default() };
        let set_back = [
            Message::Fault(v1::Fault::default()),
            Message::CheckpointRestored(v1::CheckpointRestored::default()),
            Message::Event(reset),
        ];
        for message in set_back {
            let (updates, mut newest) = triple_buffer::triple_buffer(&Update::default());
            let mut receiver = Receiver::new(updates, SharedStatus::default());
            let limits = v1::Limits { max_contact_age_s: 0.05, ..Default::default() };
            receiver.begin(&v1::ServerHello { limits: Some(limits), ..Default::default() });
            let zero = Some(v1::Vec3::default());
            let wrench = Some(v1::Wrench { force_n: zero, torque_nm: zero });
            let contact = || Message::Contact(v1::Contact { wrench, ..Default::default() });
            assert_eq!(receiver.take(contact()), Ok(Heard::Goes));
            assert_eq!(newest.read().number, 1);
            assert_eq!(receiver.take(message), Ok(Heard::Goes));
            receiver.take(contact()).unwrap();
            assert_eq!(newest.read().number, 1);
            std::thread::sleep(std::time::Duration::from_millis(60));
            receiver.take(contact()).unwrap();
            assert_eq!(newest.read().number, 3);
        }
    }

    #[test]
    fn a_tool_that_is_kept_out_of_tissue_is_told_why_and_what_to_do_until_it_is_clear() {
        let (updates, _newest) = triple_buffer::triple_buffer(&Update::default());
        let status = SharedStatus::default();
        let mut receiver = Receiver::new(updates, status.clone());
        let mut told = |tool_id, flags: &[v1::ContactFlag]| {
            let zero = Some(v1::Vec3::default());
            let wrench = Some(v1::Wrench { force_n: zero, torque_nm: zero });
            let flags = flags.iter().map(|flag| *flag as u32).sum();
            receiver.take(Message::Contact(v1::Contact { tool_id, flags, wrench, ..Default::default() })).unwrap();
            status.get().waits
        };
        let (lifted, waits) = (v1::ContactFlag::Lifted, v1::ContactFlag::WaitsUntilClear);
        assert_eq!(told(0, &[]), None);
        assert_eq!(told(0, &[lifted, waits]).as_deref(), Some("lift the tool clear of the tissue"));
        assert!(told(1, &[lifted]).is_some(), "the other one is not in hand");
        assert_eq!(told(0, &[]), None);
        let reset = v1::Event { kind: v1::EventKind::Reset.into(), ..Default::default() };
        receiver.take(Message::Event(reset)).unwrap();
        let mut told = |flags: u32| {
            let zero = Some(v1::Vec3::default());
            let wrench = Some(v1::Wrench { force_n: zero, torque_nm: zero });
            receiver.take(Message::Contact(v1::Contact { flags, wrench, ..Default::default() })).unwrap();
            status.get().waits
        };
        let anew = told(lifted as u32 + waits as u32);
        assert_eq!(anew.as_deref(), Some("the organ is whole again: lift the tool clear of the tissue"));
        assert_eq!(told(0), None);
        let again = told(lifted as u32 + waits as u32);
        assert_eq!(again.as_deref(), Some("lift the tool clear of the tissue"), "it was felt meanwhile");
    }
}
