//! A session beside those that somebody does harm to: neither its step time nor its bits may know of that.

use std::time::{Duration, Instant};

use kerf_physics::Workers;
use tokio::task::JoinHandle;

use super::harness::{Harness, Station, connect, hello, pose};

/// Poses a second that drive it.
const RATE_HZ: f64 = 100.0;

/// A session whose blade is pressed into tissue and lifted, over and over, by a client of its own.
pub struct Bystander {
    session: String,
    driving: JoinHandle<()>,
    since: Instant,
    step: u64,
}

impl Bystander {
    pub async fn start(harness: &mut Harness) -> Self {
        let session = harness.create().await.unwrap();
        let channel = connect(harness.server.address()).await;
        let station = Station::open(channel, hello(&session, &[0])).await.unwrap();
        harness.until(&session, |described| described.step > 50).await;
        let step = harness.server.registry().get(&session).unwrap().describe().await.unwrap().step;
        Self { session, driving: tokio::spawn(press(station)), since: Instant::now(), step }
    }

    /// It has kept its rate, and a replay of its inputs leads to its bits.
    pub async fn check(self, harness: &mut Harness) {
        let session = harness.server.registry().get(&self.session).unwrap();
        let (steps, elapsed_s) =
            (session.describe().await.unwrap().step - self.step, self.since.elapsed().as_secs_f64());
        self.driving.abort();
        let rate_hz = session.scene().desc.rate_hz;
        // A tenth is the machine's, which runs other tests at the same time.
        assert!(steps as f64 > 0.9 * rate_hz * elapsed_s, "{steps} steps of {rate_hz} Hz in {elapsed_s} s");
        session.pause().await.unwrap();
        let (log, hash) =
            session.query(|inspection| (inspection.log.clone(), inspection.world.state_hash())).await.unwrap();
        assert!(log.motions().len() as f64 > 0.5 * RATE_HZ * elapsed_s, "it was driven");
        assert_eq!(log.replay(session.scene(), &Workers::serial()).unwrap().state_hash(), hash);
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
