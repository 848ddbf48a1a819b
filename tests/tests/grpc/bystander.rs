//! A session beside those that somebody does harm to: neither its step time nor its bits may know of that.

use std::time::Duration;

use kerf_physics::Workers;
use kerf_session::{Reel, Resimulation, TapeEntry, TapeState};
use tokio::task::JoinHandle;

use super::harness::{Harness, Station, connect, hello, pose};

/// Poses a second that drive it.
const RATE_HZ: f64 = 100.0;

/// A session whose blade is pressed into tissue and lifted, over and over, by a client of its own.
pub struct Bystander {
    session: String,
    reel: Reel,
    driving: JoinHandle<()>,
    step: u64,
}

impl Bystander {
    pub async fn start(harness: &mut Harness) -> Self {
        let (session, reel) = harness.create_on_tape().await;
        let channel = connect(harness.server.address()).await;
        let station = Station::open(channel, hello(&session, &[0])).await.unwrap();
        harness.until(&session, |described| described.step > 50).await;
        let step = harness.server.registry().get(&session).unwrap().describe().await.unwrap().step;
        Self { session, reel, driving: tokio::spawn(press(station)), step }
    }

    /// Its steps take no longer than they have, and a replay of its inputs leads to its bits.
    pub async fn check(self, harness: &mut Harness) {
        let session = harness.server.registry().get(&self.session).unwrap();
        self.driving.abort();
        session.pause().await.unwrap();
        let steps = session.query(|inspection| inspection.steps.clone()).await.unwrap();
        let (entries, state) = self.reel.tape.take();
        let is_driven = |entry: &TapeEntry| matches!(entry, TapeEntry::Step(taped) if !taped.inputs.tools.is_empty());
        // The median: other tests share the machine, and take cores from single steps.
        let median_ns = steps.all.duration_ns.value_at_quantile(0.5);
        assert!((median_ns as f64) < 0.5e9 / session.scene().desc.rate_hz, "{median_ns} ns");
        assert!(steps.all.duration_ns.len() > self.step && entries.iter().any(is_driven), "it went on, and was driven");
        assert_eq!(state, TapeState::Running);
        let scene = session.scene().clone().judge().unwrap();
        Resimulation::new(&scene).unwrap().follow(&Workers::serial(), &entries).unwrap();
    }
}

async fn press(mut station: Station) {
    let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / RATE_HZ));
    for seq in 1.. {
        tokio::select! {
            _ = ticks.tick() => {}
            // Read and acknowledged like any other's.
            Some(_) = station.next() => continue,
        }
        let phase = seq as f32 / RATE_HZ as f32;
        let mut down = pose(0, seq, 0.0);
        down.pose.as_mut().unwrap().position_m.as_mut().unwrap().y = 0.0105 - 0.001 * (phase.sin() + 0.5);
        station.send(down).await;
    }
}
