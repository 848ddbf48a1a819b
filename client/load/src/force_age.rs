//! How old the force in a hand is: from the time of the motion that it answers until now.
//!
//! A force that comes in is at its youngest, and a force that does not come in is not counted where contacts are. So
//! the age is asked for by the clock, at the rate of a device's servo, whatever comes in or does not.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use kerf_proto::v1;

use crate::durations::durations_ns;
use crate::script::Script;
use crate::timetable::Timetable;

/// Time between two askings, ns: haptic devices are served at 1 kHz.
const SERVO_PERIOD_NS: u64 = 1_000_000;

/// Ages of the forces in all hands.
pub struct ForceAge {
    age_ns: Histogram<u64>,
    hands: BTreeMap<u32, Hand>,
}

/// What a hand feels.
#[derive(Clone, Copy, Debug, Default)]
struct Hand {
    /// Askings since the script began.
    asked: u64,
    /// When the motion was due that the force answers, ns; `None` without a force.
    answers_ns: Option<u64>,
    /// When the tool was out of the scene last, ns: what answers an earlier motion is over.
    lifted_ns: u64,
}

impl Default for ForceAge {
    fn default() -> Self {
        Self { age_ns: durations_ns(), hands: BTreeMap::new() }
    }
}

impl ForceAge {
    /// Ages, ns.
    #[must_use]
    pub fn ns(&self) -> &Histogram<u64> {
        &self.age_ns
    }

    /// Adds the ages of forces in other hands.
    pub fn add(&mut self, other: &Self) {
        self.age_ns += &other.age_ns;
    }

    /// A force came in at `now_ns`.
    pub fn contact(&mut self, contact: &v1::Contact, now_ns: u64, script: &Script, timetable: &Timetable) {
        let hand = self.hands.entry(contact.tool_id).or_default();
        hand.ask_until(now_ns, contact.tool_id, (script, timetable), &mut self.age_ns);
        let answers_ns = Timetable::tick_of_seq(contact.echo_seq).map(|tick| timetable.due_ns(tick));
        if let Some(answers_ns) = answers_ns.filter(|answers_ns| *answers_ns > hand.lifted_ns) {
            hand.answers_ns = Some(answers_ns);
        }
    }

    /// Nothing came in any more until `now_ns`.
    pub fn finish(&mut self, now_ns: u64, script: &Script, timetable: &Timetable) {
        for (tool_id, hand) in &mut self.hands {
            hand.ask_until(now_ns, *tool_id, (script, timetable), &mut self.age_ns);
        }
    }
}

impl Hand {
    fn ask_until(
        &mut self,
        now_ns: u64,
        tool_id: u32,
        (script, timetable): (&Script, &Timetable),
        age_ns: &mut Histogram<u64>,
    ) {
        let end_ns = now_ns.min(timetable.end_ns());
        loop {
            let at_ns = timetable.start_ns + self.asked * SERVO_PERIOD_NS;
            if at_ns > end_ns {
                return;
            }
            self.asked += 1;
            let time_s = (at_ns - timetable.start_ns) as f64 * 1e-9;
            match script.track(tool_id).and_then(|track| track.at(time_s)) {
                None => (self.answers_ns, self.lifted_ns) = (None, at_ns),
                Some(_) => {
                    let age = self.answers_ns.map(|answers_ns| at_ns.saturating_sub(answers_ns));
                    age.into_iter().for_each(|age| age_ns.saturating_record(age));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use kerf_script::{Key, Pose, Track};
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    const MS: u64 = 1_000_000;
    const TIMETABLE: Timetable = Timetable { start_ns: 1000 * MS, rate_hz: 250.0, duration_s: 0.1 };

    /// In the scene from 0 to `lifted_s`, and again from `back_s` on.
    fn script(lifted_s: f64, back_s: f64) -> Script {
        let pose = Pose { position_m: Vector3::zeros(), orientation: UnitQuaternion::identity() };
        let key = |time_s, is_down: bool| Key { time_s, placement: is_down.then_some(pose.into()) };
        let keys = vec![key(0.0, true), key(lifted_s, false), key(back_s, true), key(1.0, true)];
        Script { tracks: vec![Track { tool_id: 0, keys }], datums: Vec::new() }
    }

    fn answer_to_tick(tick: u64) -> v1::Contact {
        v1::Contact { echo_seq: Timetable::seq_of_tick(tick), ..Default::default() }
    }

    #[test]
    fn a_force_ages_until_the_next_one_comes_in() {
        let (script, mut ages) = (script(10.0, 11.0), ForceAge::default());
        // Poses at 0, 4, 8 ms; the answers come 2.5 ms later, but the last one does not come at all.
        for tick in 0..2 {
            ages.contact(&answer_to_tick(tick), TIMETABLE.due_ns(tick) + 5 * MS / 2, &script, &TIMETABLE);
        }
        let ms = |ns: u64| (ns as f64 / MS as f64).round();
        assert_eq!((ages.ns().len(), ms(ages.ns().min()), ms(ages.ns().max())), (4, 3.0, 6.0));
        ages.finish(TIMETABLE.start_ns + 500 * MS, &script, &TIMETABLE);
        // Asked at 0, 1, ..., 100 ms; nothing was felt at 0, 1 and 2.
        assert_eq!((ages.ns().len(), ms(ages.ns().max())), (98, 96.0), "a force that does not come is counted");
    }

    #[test]
    fn a_tool_that_was_lifted_feels_nothing_until_its_new_motion_is_answered() {
        let (script, mut ages) = (script(0.0195, 0.0595), ForceAge::default());
        ages.contact(&answer_to_tick(0), TIMETABLE.start_ns + MS / 2, &script, &TIMETABLE);
        // Contacts go on to tell of the pose before the tool was lifted.
        ages.contact(&answer_to_tick(0), TIMETABLE.start_ns + 61 * MS, &script, &TIMETABLE);
        ages.contact(&answer_to_tick(16), TIMETABLE.start_ns + 133 * MS / 2, &script, &TIMETABLE);
        assert!(ages.ns().max() < 21 * MS, "{}", ages.ns().max());
        ages.finish(TIMETABLE.start_ns + 70 * MS, &script, &TIMETABLE);
        assert!(ages.ns().max() < 21 * MS, "{}", ages.ns().max());
        assert_eq!(ages.ns().len(), 19 + 4, "1 to 19 ms, and 67 to 70");
    }
}
